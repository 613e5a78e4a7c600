"""A small study from beginning to end, over the functions and by the command."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from dask_cluster import cluster
from pages import Page

from ballscrew.cli import main
from ballscrew.orchestration.study.plan import read_plan
from ballscrew.orchestration.study.study import PARTS, Work, do_study
from ballscrew.orchestration.study.workers import Processes
from ballscrew.solver.errors import UserError
from ballscrew.study_results import SwapStudy

STUDY = """version = 1
plants = 3
[controllers.pid]
tune = {Kp = [50.0, 2000.0]}
[controllers.nctf]
tune = {c = [5.0, 60.0]}
[[vary]]
parameters = ["Fc", "Fs"]
uniform = [0.7, 1.3]
[[duty]]
name = "there"
reference = "move:distance=0.01,speed=0.1,start=0,dwell=0.1,back=0"
stop = 0.4
tune = true
[[duty]]
name = "back"
reference = "move:distance=-0.005,speed=0.1,start=0,dwell=0.1,back=0"
stop = 0.4
[tuning]
budget = 3
plants = 1
seeds = 2
"""

pytestmark = pytest.mark.xdist_group("study")  # which is done once


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "study.toml"
    path.write_text(STUDY)
    return read_plan(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def result(plan, folder):
    return do_study(plan, folder, Processes(1))


def test_every_run_is_there_and_has_its_figures(result):
    assert result.figures["rms_error"].shape == (2, 2, 1, 3)
    assert np.isfinite(result.figures["rms_error"]).all()
    rows = result.rows()
    assert {len(column) for column in rows.values()} == {12}
    assert set(rows["factor_Fc_Fs"]) == set(result.plan.draws("judge").ravel())
    assert result.answers[0].duty == "back"
    assert set(result.answers[0].order) == {"pid", "nctf"}


def test_runs_over_fmus_come_out_as_in_one_solver(result):
    assert len(result.checks) == 1
    assert result.disagreed == 0
    ((place, check),) = result.checks.items()
    assert 0 < check.apart <= check.allowed < 1e-6  # what the master's steps take from the curve
    rows = result.rows()
    (again,) = (k for k, verdict in enumerate(rows["coupling"]) if verdict)
    assert {name: rows[name][again] for name in result.run(place)} == result.run(place)
    assert rows["coupling"][again] == check.coupling
    assert result.not_converged == (check.coupling == "not converged")


@pytest.mark.ci
def test_a_study_that_goes_on_after_a_kill_gives_the_same_numbers(plan, folder, result, tmp_path):
    shutil.copytree(folder / PARTS, tmp_path / PARTS)
    (tmp_path / PARTS / "tuning-0-0.json").unlink()
    (tmp_path / PARTS / "judging-1-1-0-0.json").write_text(
        '{"of": "0", "found": [[1.0,'
    )  # half of it
    again = do_study(plan, tmp_path, Processes(1), resume=True)
    assert json.dumps(again.to_dict()) == json.dumps(result.to_dict())  # NaN and all


@pytest.mark.prove
@pytest.mark.filterwarnings("ignore")  # of Dask's, as it ends
def test_a_study_over_dask_gives_the_same_numbers(plan, result, tmp_path):
    with cluster(tmp_path) as (workers, _):
        again = do_study(plan, tmp_path / "out", workers)
    assert json.dumps(again.to_dict()) == json.dumps(result.to_dict())


def test_a_table_of_the_set_point_that_changed_makes_another_study(plan, folder, result, tmp_path):
    """Judged or tuned on: its name is the same, its content is not."""
    for k, duty in enumerate(plan.duties):
        table, out = tmp_path / "ref.csv", tmp_path / f"out{k}"
        table.write_text("time,x_d\n0,0\n0.4,0.01\n")
        changed = replace(duty, reference=str(table))
        now = replace(plan, duties=(*plan.duties[:k], changed, *plan.duties[k + 1 :]))
        parts = Work.of(now, out / PARTS, Processes(1)).parts
        list(parts.results({"a.json": (1,)}, abs, Processes(1)))
        table.write_text("time,x_d\n0,0\n0.4,0.02\n")
        with pytest.raises(UserError, match="contains another study"):
            do_study(now, out, Processes(1), resume=True)


@pytest.mark.ci
def test_a_table_that_is_not_that_of_its_runs_is_found_over_fmus(plan, folder, result, tmp_path):
    """Whatever put it there: the runs over FMUs are beside the table, and not beside new runs."""
    shutil.copytree(folder / PARTS, tmp_path / PARTS)
    for part in (tmp_path / PARTS).iterdir():
        kept = json.loads(part.read_text())
        if part.name.startswith("judging-"):
            kept["found"] = [[1.01 * figure for figure in row] for row in kept["found"]]
            part.write_text(json.dumps(kept))
        elif part.name.startswith("over-fmus-"):
            part.unlink()
    found = do_study(plan, tmp_path, Processes(1), resume=True)
    assert found.disagreed == len(found.checks) == 1
    assert not SwapStudy.of(found).trusted


def test_the_command_writes_all_files_and_says_who_is_best(tmp_path, capsys, folder, result):
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(STUDY)
    shutil.copytree(folder / PARTS, out / PARTS)
    assert main(["study", str(study), "--workers", "1", "--out", str(out), "--resume"]) == 0
    printed = capsys.readouterr().out
    assert "2 controllers, 1 duties, 12 runs" in printed
    assert "Repeated over FMUs: " in printed
    files = {"report.html", "study.json", "runs.parquet", "study.png", "courses.png"}
    assert {p.name for p in out.iterdir()} >= files
    told = json.loads((out / "study.json").read_text())
    assert [a["order"] for a in told["answers"]] == [list(a.order) for a in result.answers]
    page = Page((out / "report.html").read_text())
    assert page.headline == SwapStudy.of(result).headline()
    assert page.pictures == 2
    (figures,) = (rows for title, rows in page.tables.items() if title.startswith("Figures: "))
    assert "rms error [mm]" in figures[0]
    assert told["verdict"] == result.verdict == printed.splitlines()[0].partition(". ")[0]
    assert not (out / PARTS).exists()

"""A small study from beginning to end, over the functions and by the command."""

import json
import re
import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest
from browser import PROGRAM, opened
from dask_cluster import cluster
from hostile import ALL, check_in_browser, check_text
from long_commands import Command, interrupted
from waiting import wait_for

from ballscrew.cli import main
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_motions import read_motion
from ballscrew.orchestration.study.loop import StudyLoop
from ballscrew.orchestration.study.pictures import COLOURS
from ballscrew.orchestration.study.plan import read_plan
from ballscrew.orchestration.study.reading import BadPlan
from ballscrew.orchestration.study.report import report
from ballscrew.orchestration.study.study import PARTS, do_study
from ballscrew.orchestration.study.verdict import sentence
from ballscrew.orchestration.whole_loop import loop_kernel, run_monolithic
from ballscrew.orchestration.workers import Processes
from ballscrew.results.swap_study import SwapStudy

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


def test_tuned_controllers_cost_no_more_than_the_published_rules(result):
    for tunings in result.tunings.values():
        assert len(tunings) == 2
        for t in tunings:
            assert t.doubled_cost <= t.cost <= t.published_cost


def test_runs_over_fmus_come_out_as_in_one_solver(result):
    assert len(result.checks) == 1
    assert result.disagreed == 0
    ((run, check),) = result.checks.items()
    assert 0 < check.apart <= check.allowed < 1e-6  # what the master's steps take from the curve
    rows = result.rows()
    again = [k for k, verdict in enumerate(rows["coupling"]) if verdict]
    assert [tuple(rows[name][k] for name in run._fields) for k in again] == [run]
    assert [rows["coupling"][k] for k in again] == [check.coupling]
    assert result.not_converged == (check.coupling == "not converged")


def test_every_figure_has_its_interval_over_plants(result):
    for figure, geometric in (("rms_error", True), ("steady_error", False)):
        found = result.interval(figure, "pid", "back")
        assert found.geometric == geometric
        assert found.low < found.mean < found.high
    assert result.interval("rms_error", "pid", "back").mean == pytest.approx(
        result.mean("rms_error", "pid", "back")
    )
    assert np.isnan(result.interval("reversal_error", "pid", "back").mean)  # nothing turns


def test_every_run_has_a_verdict_on_hunting(result):
    said = result.rows()["hunting"]
    assert set(said) <= {"hunting", "none", "undecided"}
    for name in ("pid", "nctf"):
        counts = result.hunting(name, "back")
        assert sum(counts.values()) == 6
        own = [v for v, c in zip(said, result.rows()["controller"], strict=True) if c == name]
        assert counts == {word: own.count(word) for word in counts}


def test_the_courses_are_those_of_the_nominal_plant_under_the_best_tuning(plan, result):
    assert {d: set(by) for d, by in result.courses.items()} == {"back": {"pid", "nctf"}}
    motion = plan.judged_duties[0].signal()
    for name, course in result.courses["back"].items():
        best = min(result.tunings[name], key=lambda t: t.cost)
        loop = Loop(f"{name}+sampled", reference=motion, stop=0.4, controller_values=best.values)
        own = run_monolithic(replace(loop, plant_values={"voltage_limit": 36.0}), 1e-3)
        x_d = motion.on(own.time, 0)
        shown = np.isin(own.time.round(9), np.round(course.time, 9))
        assert shown.sum() == len(course.time) >= 200
        error = (x_d - own.outputs["x"])[shown]
        np.testing.assert_allclose(course.error, error, rtol=1e-4, atol=1e-8)
        command = own.commands["u"][shown]  # which gains make of what the study's solver leaves
        np.testing.assert_allclose(course.command, command, rtol=0, atol=1e-3 * np.ptp(command))


def test_a_controller_has_one_colour_in_every_figure_of_the_page(result):
    page = report(SwapStudy.of(result))
    figures = json.loads(re.search(r"^  const FIGURES = (.*);$", page, re.M)[1])
    assert [f["name"] for f in figures] == ["errors", "course0", "command0", "effort0"]
    for figure in figures:
        assert {t["name"]: t["meta"] for t in figure["data"]} == {"pid": "c0", "nctf": "c1"}
    for k, colour in enumerate(COLOURS):  # of the page that is light, as of pictures
        assert "#" + re.search(rf"--c{k}: #(\w+)", page)[1].ljust(6, "0") == colour


@pytest.fixture(scope="module")
def evil(tmp_path_factory):
    """The page of a study whose controllers and duties have names that are meant badly."""
    folder = tmp_path_factory.mktemp("evil")
    plain = STUDY.replace("plants = 3", "plants = 2").replace("seeds = 2", "seeds = 1")
    plain = plain.replace("budget = 3", "budget = 2")
    text = plain.replace("[controllers.pid]", f"[controllers.{NAMED}]\ncomponent = 'pid'")
    text = text.replace('"there"', NAMED).replace('"back"', NAMED.replace('"', '"back ', 1))
    (folder / "study.toml").write_text(text)
    done = do_study(read_plan(folder / "study.toml"), folder / "out", Processes(1))
    SwapStudy.of(done).save(folder)
    return folder / "report.html"


NAMED = json.dumps(ALL)  # as TOML has it, too


def test_names_that_are_meant_badly_stay_text(evil):
    check_text(evil.read_text(encoding="utf-8"))


@pytest.mark.skipif(PROGRAM is None, reason="no chromium here: apt-get install chromium")
def test_names_that_are_meant_badly_do_nothing_in_a_browser(evil):
    check_in_browser(evil)


@pytest.mark.skipif(PROGRAM is None, reason="no chromium here: apt-get install chromium")
def test_the_page_is_no_wider_than_a_telephone(result, tmp_path):
    SwapStudy.of(result).save(tmp_path)
    with opened(tmp_path / "report.html", width=390) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.errors == []


def test_a_study_that_goes_on_after_a_kill_gives_the_same_numbers(plan, folder, result, tmp_path):
    shutil.copytree(folder / PARTS, tmp_path / PARTS)
    (tmp_path / PARTS / "tune-0-0.json").unlink()
    (tmp_path / PARTS / "run-1-1-0-0.json").write_text('{"of": "0", "found": [[1.0,')  # half of it
    again = do_study(plan, tmp_path, Processes(1), resume=True)
    assert json.dumps(again.to_dict()) == json.dumps(result.to_dict())  # NaN and all


@pytest.mark.filterwarnings("ignore")  # of Dask's, as it ends
def test_a_study_over_dask_gives_the_same_numbers(plan, result, tmp_path):
    with cluster(tmp_path) as (workers, _):
        again = do_study(plan, tmp_path / "out", workers)
    assert json.dumps(again.to_dict()) == json.dumps(result.to_dict())


def test_a_folder_of_another_study_is_left_alone(plan, folder, result):
    with pytest.raises(BadPlan, match="add --resume to continue"):
        do_study(plan, folder, Processes(1))
    with pytest.raises(BadPlan, match="contains another study"):
        do_study(replace(plan, seed=2), folder, Processes(1), resume=True)


def test_parts_of_another_study_are_never_taken(plan, folder, result, tmp_path):
    """As where one was stopped with Ctrl-Z, or killed before it wrote which study it is."""
    shutil.copytree(folder / PARTS, tmp_path / "own" / PARTS)
    for part in (tmp_path / "own" / PARTS).iterdir():
        kept = json.loads(part.read_text())
        part.write_text(json.dumps(kept["found"]))  # as an earlier version kept it
    for resume in (False, True):
        with pytest.raises(BadPlan, match="contains another study"):
            do_study(plan, tmp_path / "own", Processes(1), resume=resume)
    # a part of each in one folder: this study goes on with its own, and does the other's again
    shutil.copytree(folder / PARTS, tmp_path / "both" / PARTS)
    part = tmp_path / "both" / PARTS / "run-0-0-0-0.json"
    other = {
        "of": "another",
        "found": [[7.0] * len(row) for row in json.loads(part.read_text())["found"]],
    }
    part.write_text(json.dumps(other))
    again = do_study(plan, tmp_path / "both", Processes(1), resume=True)
    assert json.dumps(again.to_dict()) == json.dumps(result.to_dict())


def test_a_table_that_is_not_that_of_its_runs_is_found_over_fmus(plan, folder, result, tmp_path):
    """Whatever put it there: the runs over FMUs are beside the table, and not beside new runs."""
    shutil.copytree(folder / PARTS, tmp_path / PARTS)
    for part in (tmp_path / PARTS).iterdir():
        kept = json.loads(part.read_text())
        if part.name.startswith("run-"):
            kept["found"] = [[1.01 * figure for figure in row] for row in kept["found"]]
            part.write_text(json.dumps(kept))
        elif part.name.startswith("fmu-"):
            part.unlink()
    found = do_study(plan, tmp_path, Processes(1), resume=True)
    assert found.disagreed == len(found.checks) == 1
    assert not SwapStudy.of(found).trusted


def test_an_interrupt_says_what_is_kept_and_before_the_first_part_nothing_blocks(
    folder, result, tmp_path
):
    path, out = tmp_path / "study.toml", tmp_path / "out"
    path.write_text(STUDY.replace("budget = 3", "budget = 3000"))
    words = ["study", str(path), "--workers", "1"]
    for _ in range(2):  # the first leaves nothing that refuses the second
        command = Command.of(words, out)
        command.wait_until_busy(1.5)
        ending = interrupted(command, signal.SIGINT)
        assert ending.fault() == ""
        assert f"nothing of this run is kept in {out}" in ending.said
        assert not (out / PARTS).exists()
    path.write_text(STUDY)
    shutil.copytree(folder / PARTS, out / PARTS)
    for part in (out / PARTS).glob("run-*"):
        part.unlink()
    command = Command.of([*words, "--resume"], out)
    wait_for(lambda: list((out / PARTS).glob("run-*")), 60.0, command.process)
    ending = interrupted(command, signal.SIGINT)
    assert ending.fault() == ""
    assert "finished tasks are kept, continue with --resume" in ending.said


def test_the_command_writes_all_files_and_says_who_is_best(tmp_path, capsys, folder, result):
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(STUDY)
    shutil.copytree(folder / PARTS, out / PARTS)
    given = ["study", str(study), "--workers", "1", "--out", str(out), "--resume"]
    assert main(given) == 0
    printed = capsys.readouterr().out
    assert "2 controllers, 1 duties, 12 runs" in printed
    assert "repeated over FMUs" in printed
    assert {p.name for p in out.iterdir()} >= {
        "report.html",
        "study.json",
        "runs.parquet",
        "study.png",
    }
    told = json.loads((out / "study.json").read_text())
    assert [a["order"] for a in told["answers"]] == [list(a.order) for a in result.answers]
    page = (out / "report.html").read_text()
    assert "Which controller for which duty" in page
    assert f"<h1>{sentence(result)}</h1>" in page
    assert "rms error [um]" in page
    assert "rms error [m]" not in page
    assert told["verdict"] == sentence(result) == printed.splitlines()[0].partition(". ")[0]
    assert not (out / PARTS).exists()


@pytest.mark.skipif(PROGRAM is None, reason="no chromium here: apt-get install chromium")
def test_a_browser_draws_the_page_zooms_and_asks_for_nothing(result, tmp_path):
    path = tmp_path / "report.html"
    SwapStudy.of(result).save(tmp_path)
    area = "document.querySelector('#effort0 .nsewdrag').getBoundingClientRect()"
    shown = "document.querySelector('#effort0 .plot').layout.xaxis.range"
    with opened(path) as page:
        assert page.errors == []
        assert page.requests == [path.resolve().as_uri()]
        for name in ("course0", "command0"):
            lines = f"document.querySelectorAll('#{name} .scatterlayer .js-line').length"
            assert page.evaluate(lines) == 2
        for name in ("errors", "effort0"):
            points = f"document.querySelectorAll('#{name} .points path').length"
            assert page.evaluate(points) == 2  # controllers
        page.evaluate("document.getElementById('effort0').scrollIntoView()")
        x, y, width, height = page.evaluate(f"(r => [r.x, r.y, r.width, r.height])({area})")
        low, high = page.evaluate(shown)
        page.mouse("mouseMoved", x + 0.3 * width, y + 0.3 * height)
        held = {"button": "left", "clickCount": 1}
        page.mouse("mousePressed", x + 0.3 * width, y + 0.3 * height, **held)
        page.mouse("mouseMoved", x + 0.7 * width, y + 0.7 * height, button="left", buttons=1)
        page.mouse("mouseReleased", x + 0.7 * width, y + 0.7 * height, **held)
        wait_for(lambda: page.evaluate(shown) != [low, high])
        closer = np.subtract(*page.evaluate(shown)[::-1])
        assert closer == pytest.approx(0.4 * (high - low), rel=0.03)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[controllers.pid]", "[controllers.pidd]", "pidd"),
        ("Kp =", "Kpp =", "no parameter 'Kpp'; there are Kd, Ki, Kp"),
        ("[controllers.pid]", '[controllers.pid]\ncomponent = "no.py:f"', "there is no file no.py"),
        ("plants = 3", 'plants = 3\nplant = "no.py:f"', "there is no file no.py"),
        (
            "plants = 3",
            "plants = 3\nvoltage_limit = 36.0",
            "voltage_limit is now called command_limit",
        ),
        ("plants = 3", 'plants = 3\ninstruments = ["encodr"]', "no instrument 'encodr'"),
        ("uniform = [0.7, 1.3]", "uniform = [-1.0, 1.0]", "Fc would be -1"),
        ("uniform = [0.7, 1.3]", "normal = [1.0, 3.0]", "Fc would be -"),
        ("[5.0, 60.0]", "[-5.0, 60.0]", "c would be -5, expected within [0, inf]"),
        ('"Fc", "Fs"', '"Fc", "Fz"', "vary: no parameter 'Fz'; there are Fc, Fs"),
    ],
)
def test_a_study_of_what_is_not_there_is_one_line_and_exit_code_2(
    tmp_path, capsys, old, new, message
):
    study = tmp_path / "study.toml"
    study.write_text(STUDY.replace(old, new))
    assert main(["study", str(study), "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert heard.count("\n") == 1


@pytest.mark.parametrize("controller", ["pid_sampled", "nctf"])
def test_a_run_is_that_of_the_monolithic_reference(controller):
    """Sampled on its own grid, and continuous with ramps in between."""
    motion = read_motion("move:distance=0.005,start=0.01,dwell=0.05,back=0")
    own = StudyLoop(loop_kernel("plant", controller)).run({}, motion, 0.3, 1e-8)
    other = run_monolithic(Loop(controller, reference=motion, stop=0.3), 1e-3)
    np.testing.assert_allclose(own.position, other.outputs["x"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(own.command, other.commands["u"], rtol=0, atol=1e-6)

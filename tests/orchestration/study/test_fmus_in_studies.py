"""FMUs and controllers of one's own in `tune` and `study`: the same answers as by equations."""

import shutil

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.study.plan import read_plan
from ballscrew.orchestration.study.study import Work
from ballscrew.orchestration.study.workers import Processes

pytestmark = pytest.mark.ci
STUDY = """version = 1
plants = 2
[controllers.pid]
tune = {Kp = [50.0, 2000.0]}
[controllers.file]
component = "PATH"
tune = {Kp = [50.0, 2000.0]}
[[duty]]
name = "there"
reference = "step:size=1e-3"
stop = 0.2
tune = true
[[duty]]
name = "back"
reference = "step:size=-1e-3"
stop = 0.2
[tuning]
budget = 2
plants = 0
seeds = 1
"""
OWN = """from dataclasses import replace

from ballscrew.controllers.pid import pid


def mine():
    kp, *others = pid().parameters
    limited = replace(kp, minimum=100.0, maximum=900.0)
    return replace(pid(), name="mine", parameters=(limited, *others))
"""
MOVE = "move:distance=0.01,speed=0.1"


@pytest.fixture(params=["mine.py:mine", "mine.fmu"])
def own(request, tmp_path, monkeypatch):
    """A controller of one's own, as equations and as an FMU."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(OWN)
    ballscrew.export("mine.py:mine", tmp_path / "mine.fmu")
    return request.param


def test_an_fmu_is_judged_like_the_equations_that_it_holds(tmp_path, capsys):
    path = tmp_path / "study.toml"
    theirs = shutil.copy(fmu("pid"), tmp_path / "theirs.fmu")
    path.write_text(STUDY.replace("PATH", str(theirs)))
    plan = read_plan(path)
    work = Work.of(plan, tmp_path / "parts", Processes(1))
    values = {"controller_Kp": 300.0, "controller_Ki": 0.0, "plant_m": 1.4}  # no state: held alone
    own, file = (c.loop.run(values, plan.duties[0].motion, 1e-8) for c in work.contenders)
    np.testing.assert_allclose(file.position, own.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(file.command[:-1], own.command[:-1], rtol=0, atol=1e-6)
    tunings = work.tunings()
    costs = [tunings[name][0].published_cost for name in ("pid", "file")]
    assert costs[1] == pytest.approx(costs[0], rel=1e-2)
    words = ["study", str(path), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(words) == 0, capsys.readouterr().err


def test_what_is_ones_own_is_tuned_within_the_limits_of_its_parameters(own):
    """The errors are those of a run in one solver."""
    how = {"reference": MOVE, "stop": 0.4}
    found = ballscrew.tune(own, budget=2, **how)
    (gain,) = found.gains
    assert (gain.name, gain.low, gain.high) == ("Kp", 100.0, 900.0)
    assert bool(found.margins) == (own == "mine.py:mine")
    assert found.margins or found.no_margins == (f"{own}: no margins, an FMU has no equations",)
    values = {"controller_values": found.values, "fmus": False}
    error = ballscrew.run("pid", **how, **values).figures()["rms_error"]
    assert found.motions[0].figures.rms_error == pytest.approx(error, rel=0.01)


def test_a_study_of_one_controller_finds_what_tune_finds(own, tmp_path):
    """Motion, budget and seed are the same, and no limit is met: the costs differ by a factor."""
    tuned = ballscrew.tune(own, reference=MOVE, stop=0.4, budget=6, seed=3)
    path = tmp_path / "study.toml"
    one = STUDY.replace("[controllers.pid]\ntune = {Kp = [50.0, 2000.0]}\n", "")
    one = one.replace("tune = {Kp = [50.0, 2000.0]}\n", "").replace("PATH", own)
    one = one.replace("step:size=1e-3", MOVE).replace("stop = 0.2", "stop = 0.4", 1)
    one = one.replace("version = 1", "version = 1\nperiod = 0\nseed = 3")
    path.write_text(one.replace("budget = 2", "budget = 6"))
    plan = read_plan(path)
    assert plan.entrants[0].tune == {"Kp": (100.0, 900.0)}
    (study,) = Work.of(plan, tmp_path / "parts", Processes(1)).tunings()["file"]
    assert study.values == tuned.values
    size = study.published_cost / tuned.tuned.published_cost
    assert study.cost / tuned.tuned.cost == pytest.approx(size, rel=1e-12)
    assert study.doubled_cost / tuned.tuned.doubled_cost == pytest.approx(size, rel=1e-12)

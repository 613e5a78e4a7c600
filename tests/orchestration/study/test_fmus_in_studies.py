"""FMUs and controllers of one's own in `tune` and `study`: the same answers as by equations."""

import shutil
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study.figures import figures_of
from ballscrew.orchestration.study.loop import StudyLoop, check_over_fmus
from ballscrew.orchestration.study.plan import Duty, read_plan
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


@pytest.fixture(scope="module")
def pid_file(tmp_path_factory):
    """The PID as an FMU of somebody."""
    return shutil.copy(fmu("pid"), tmp_path_factory.mktemp("theirs") / "theirs.fmu")


def test_an_fmu_is_judged_like_the_equations_that_it_holds(tmp_path, pid_file):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("PATH", str(pid_file)))
    plan = read_plan(path)
    work = Work.of(plan, tmp_path / "parts", Processes(1))
    loops = {name: contender.loop for name, contender in work.contenders.items()}
    values = {"controller_Kp": 300.0, "controller_Ki": 0.0, "plant_m": 1.4}  # no state: held alone
    own, file = (loops[n].run(values, plan.duties[0].signal(), 0.2, 1e-8) for n in ("pid", "file"))
    np.testing.assert_allclose(file.position, own.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(file.command[:-1], own.command[:-1], rtol=0, atol=1e-6)
    tunings = work.tunings()
    figures = work.figures(tunings)
    costs = [tunings[name][0].published_cost for name in ("pid", "file")]
    assert costs[1] == pytest.approx(costs[0], rel=1e-2)
    assert np.isfinite(figures["rms_error"]).all()


def test_a_study_with_an_fmu_is_done_by_the_command(tmp_path, pid_file, capsys):
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("PATH", str(pid_file)))
    words = ["study", str(path), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(words) == 0, capsys.readouterr().err


def test_what_is_ones_own_is_tuned_within_the_limits_of_its_parameters(tmp_path, monkeypatch):
    """As equations, and as an FMU; the errors are those of a run in one solver."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(OWN)
    ballscrew.export("mine.py:mine", tmp_path / "mine.fmu")
    how = {"reference": "move:distance=0.01,speed=0.1", "stop": 0.4}
    for part in ("mine.py:mine", "mine.fmu"):
        found = ballscrew.tune(part, budget=2, **how)
        (gain,) = found.gains
        assert (gain.name, gain.low, gain.high) == ("Kp", 100.0, 900.0)
        assert bool(found.margins) == (part == "mine.py:mine")
        values = {"controller_values": found.values, "fmus": False}
        error = ballscrew.run("pid", **how, **values).figures()["rms_error"]
        assert found.motions[0].figures.rms_error == pytest.approx(error, rel=0.01)
    assert found.no_margins == ("mine.fmu: no margins, an FMU has no equations",)


@pytest.mark.parametrize("part", ["mine.py:mine", "mine.fmu"])
def test_a_study_of_one_controller_finds_what_tune_finds(tmp_path, monkeypatch, part):
    """Motion, budget and seed are the same, and no limit is met: the costs differ by a factor."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(OWN)
    ballscrew.export("mine.py:mine", tmp_path / "mine.fmu")
    move = "move:distance=0.01,speed=0.1"
    tuned = ballscrew.tune(part, reference=move, stop=0.4, budget=6, seed=3)
    path = tmp_path / "study.toml"
    one = STUDY.replace("[controllers.pid]\ntune = {Kp = [50.0, 2000.0]}\n", "")
    one = one.replace("tune = {Kp = [50.0, 2000.0]}\n", "").replace("PATH", part)
    one = one.replace("step:size=1e-3", move).replace("stop = 0.2", "stop = 0.4", 1)
    one = one.replace("version = 1", "version = 1\nperiod = 0\nseed = 3")
    path.write_text(one.replace("budget = 2", "budget = 6"))
    plan = read_plan(path)
    assert plan.entrants[0].tune == {"Kp": (100.0, 900.0)}
    (study,) = Work.of(plan, tmp_path / "parts", Processes(1)).tunings()["file"]
    assert study.values == tuned.values
    assert study.tried == 12
    sizes = [study.published_cost / tuned.start_cost, study.doubled_cost / tuned.doubled_cost]
    assert study.cost / tuned.cost == pytest.approx(sizes[0], rel=1e-12)
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-12)


DUTY = Duty("there", "move:distance=0.005,speed=0.1,start=0,dwell=0.1,back=0", 0.2)


def table_of(loop, values, duty):
    """What a study says of this run."""
    course = loop.run(values, duty.signal(), duty.stop, 1e-6)
    return asdict(figures_of(course, count=2e-6, limit=36.0))


def checked(loop, controller, values, duty):
    fmus = str(fmu("plant")), str(fmu(controller))
    return check_over_fmus(loop, fmus, values, duty, 1e-6, table_of(loop, values, duty))


@pytest.mark.parametrize(
    "wrong",
    [{"rms_error": 1.001}, {"peak_error": 0.999}, {"rms_error": np.nan, "peak_error": np.nan}],
)
def test_a_table_that_says_other_figures_than_the_run_over_fmus_disagrees(wrong):
    loop = StudyLoop(loop_kernel("plant", "pid_sampled"))
    table = table_of(loop, {}, DUTY)
    other = table | {name: table[name] * factor for name, factor in wrong.items()}
    fmus = str(fmu("plant")), str(fmu("pid_sampled"))
    assert check_over_fmus(loop, fmus, {}, DUTY, 1e-6, table).agrees
    assert not check_over_fmus(loop, fmus, {}, DUTY, 1e-6, other).agrees


@pytest.mark.parametrize(
    ("controller", "values", "most"),
    [
        ("pid_sampled", {}, 1e-11),  # m
        ("nctf+sampled", {"controller_sample_time": 5e-5}, 1e-7),
        ("nctf", {}, 1e-6),
    ],
)
def test_a_loop_that_converges_is_trusted_and_agrees(controller, values, most):
    loop = StudyLoop(loop_kernel("plant", controller))
    found = checked(loop, controller, values, DUTY)
    assert found.coupling == "trusted"
    assert found.agrees
    assert found.allowed < most


class OneCount:
    """A loop whose position is a count further where the solver's tolerance says so."""

    parameters = ()

    def __init__(self, flips):
        self.flips = flips

    def run(self, values, reference, stop, tolerance):
        time = np.linspace(0.0, stop, 5)
        position = np.full(5, 1e-9 if self.flips(tolerance) else 0.0)
        return SimpleNamespace(time=time, position=position, reference=0 * time, stopped="")


@pytest.mark.parametrize(
    ("apart", "flips", "agrees"),
    [
        (1e-9, lambda tolerance: 3e-8 < tolerance < 5e-8, True),  # as a few tolerances do, too
        (1e-9, lambda tolerance: False, False),
        (2e-8, lambda tolerance: 3e-8 < tolerance < 5e-8, False),  # more than ten times as much
    ],
)
def test_a_count_that_few_tolerances_see_is_no_difference(monkeypatch, apart, flips, agrees):
    """Such runs were called different: one of eighty behind the encoder of `docs/swap-study.md`."""
    loop = OneCount(flips)

    def over_fmus(study):
        time = np.linspace(0.0, study.stop, 5)
        verdict = SimpleNamespace(word="trusted", reason="", error_estimate={"x": 0.0})
        return SimpleNamespace(
            run=SimpleNamespace(time=time, outputs={"x": np.full(5, apart)}, verdict=verdict)
        )

    monkeypatch.setattr("ballscrew.orchestration.study.loop.run_closed_loop", over_fmus)
    table = {"rms_error": 0.0, "peak_error": 0.0, "failed": 0.0}
    assert check_over_fmus(loop, ("plant", "pid"), {}, DUTY, 1e-6, table).agrees is agrees

"""An FMU as a digital controller: stepped at its samples alone, its commands held between."""

import numpy as np
import pytest
from third_party_fmus import proportional

import ballscrew
from ballscrew.cli import main
from ballscrew.fmus.native.export import export_native
from ballscrew.orchestration.fmu_instance import FmuInstance
from ballscrew.orchestration.sampled_fmu import sampled_every

PERIOD = 2e-3
MINE = """
from ballscrew import Component, Input, Output, symbol

LAW = 400.0 * (symbol("x_d") - symbol("x")) - 2.0 * symbol("v")


def pd():
    return Component(
        name="pd",
        description="the law of the FMU, as equations",
        inputs=(
            Input("x", "m", "position", role="measurement", nominal=0.1),
            Input("v", "m/s", "velocity", role="measurement", nominal=0.1),
            Input("x_d", "m", "set-point", role="reference", nominal=0.1),
        ),
        outputs=(Output("u", "V", "motor voltage", LAW),),
    )
"""


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    path = tmp_path_factory.mktemp("mine") / "mine.py"
    path.write_text(MINE)
    return f"{path}:pd"


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    return proportional(tmp_path_factory.mktemp("theirs"), "Theirs")


@pytest.mark.parametrize("step", [None, PERIOD, PERIOD / 3])
def test_it_runs_as_the_same_law_sampled_in_equations(mine, theirs, step):
    given = {"stop": 0.5, "sampled": PERIOD, "step": step}
    fmu, equations = (ballscrew.run(part, **given) for part in (theirs, mine))
    assert fmu.run.sampling_period == equations.run.sampling_period == PERIOD
    assert fmu.trusted
    for name in ("x", "v", "i"):
        ours = np.interp(fmu.run.time, equations.run.time, equations.run.outputs[name])
        size = np.ptp(ours)
        assert np.abs(fmu.run.outputs[name] - ours).max() <= 1e-2 * size
    assert (
        np.abs(
            fmu.run.outputs["x"]
            - np.interp(fmu.run.time, equations.run.time, equations.run.outputs["x"])
        ).max()
        <= 1e-6
    )


def test_without_a_period_the_same_fmu_is_another_controller_and_a_note_tells_what_to_do(theirs):
    continuous = ballscrew.run(theirs, stop=0.1, step=1e-3)
    assert not continuous.trusted
    assert any("--sampled" in note for note in continuous.notes)
    digital = ballscrew.run(theirs, stop=0.1, step=1e-3, sampled=1e-3)
    assert digital.trusted
    assert not any("--sampled" in note for note in digital.notes)


def test_it_is_stepped_once_in_each_period_whatever_the_steps_and_the_end_of_the_run(tmp_path):
    counts = proportional(
        tmp_path,
        "Counts",
        in_step="assert abs(step_size - 0.003) < 1e-12; "
        "self.n = getattr(self, 'n', -1) + 1; "
        "assert abs(current_time - 0.003 * self.n) < 1e-12",
    )
    for step in (3e-3, 1e-3, 7e-4):
        result = ballscrew.run(counts, stop=0.05, step=step, sampled=3e-3)
        assert not result.run.stopped
        assert result.run.time[-1] == pytest.approx(0.05)
        commands = result.run.commands["u"]
        changes = result.run.time[1:][np.diff(commands) != 0]
        assert np.allclose(changes / 3e-3, np.round(changes / 3e-3), atol=1e-6)


def test_the_feedback_law_of_an_exported_fmu_is_not_applied_between_its_samples(tmp_path):
    export_native(ballscrew.component("pid"), tmp_path / "pid.fmu")
    fmu = ballscrew.run(tmp_path / "pid.fmu", stop=0.5, sampled=PERIOD)
    assert fmu.trusted
    held = fmu.run.commands["u"]
    points = np.round(fmu.run.time / PERIOD, 6)
    assert not np.diff(held)[points[1:] % 1 != 0].any()
    equations = ballscrew.run("pid", stop=0.5, sampled=PERIOD)
    x = np.interp(fmu.run.time, equations.run.time, equations.run.outputs["x"])
    assert np.abs(fmu.run.outputs["x"] - x).max() < 2e-3 * np.ptp(x)


def test_a_restored_state_goes_on_as_the_saved_one(tmp_path):
    export_native(ballscrew.component("pid"), tmp_path / "pid.fmu")
    part = sampled_every(FmuInstance(tmp_path / "pid.fmu", "controller"), PERIOD)
    part.initialize({}, 1.0)
    put, got = part.writer(["x", "v", "x_d"]), part.reader(["u"])

    def moved(first):
        seen = []
        for k in range(first, first + 6):
            put(np.array([0.01 * k, 0.1, 0.08]))
            part.step(k * PERIOD / 3, PERIOD / 3)
            seen.append(got()[0])
        return seen

    moved(0)
    state = part.save()
    once = moved(6)
    part.restore(state)
    again = moved(6)
    part.release(state)
    part.close()
    assert once == again
    assert len(set(once)) == 2


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan")])
def test_a_period_that_is_none_is_refused(theirs, period):
    with pytest.raises(ValueError, match="sampled"):
        ballscrew.run(theirs, stop=0.1, sampled=period)


def test_the_command_samples_names_and_fmus_alike(theirs, tmp_path, capsys):
    asked = ["swap", "--controllers", "pid", str(theirs), "--sampled", "1e-3", "--stop", "0.2"]
    assert main([*asked, "--out", str(tmp_path / "out")]) == 0
    table = capsys.readouterr().out
    assert "pid+sampled" in table
    assert table.count("0.001 ") >= 2


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (["run", "--controller", "{fmu}", "--sampled", "0"], "--sampled is 0 s"),
        (["run", "--controller", "{fmu}", "--sampled", "1e-3", "--set", "controller.q=1"], "q"),
        (["run", "--system", "loop.ssp", "--sampled", "1e-3"], "--sampled cannot be used"),
        (["swap", "--controllers", "{fmu}", "--noise", "--sampled", "1e-3"], "instruments"),
    ],
)
def test_a_wrong_use_is_one_line(theirs, tmp_path, capsys, asked, words):
    asked = [a.format(fmu=theirs) for a in asked]
    assert main([*asked, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_exponents_and_maps_of_it_are_refused(theirs, tmp_path):
    loop = ballscrew.Loop(theirs, stop=0.1, step=1e-3, sampled=1e-3)
    with pytest.raises(ValueError, match="cannot sample an FMU"):
        ballscrew.lyapunov(loop)
    axes = {"x": "plant.Fs=2.2:2.4:2", "y": "plant.Fc=2.0:2.1:2"}
    with pytest.raises(ValueError, match="cannot sample an FMU"):
        ballscrew.stability_map(loop, **axes, folder=tmp_path / "map")

"""An FMU as a digital controller: stepped at its samples alone, its commands held between."""

import numpy as np
import pytest
import small_fmus
from third_party_fmus import proportional

import ballscrew
from ballscrew import Component, Input, Output, symbol
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.fmu.trials import Sampled

PERIOD = 2e-3
ROLES = {"x": "measurement", "v": "measurement", "x_d": "reference"}
LAW = 400.0 * (symbol("x_d") - symbol("x")) - 2.0 * symbol("v")


def by_equations(**given):
    """A run with the law of `proportional`, sampled."""
    units = {"x": "m", "v": "m/s", "x_d": "m"}
    inputs = tuple(Input(n, units[n], n, role=role, nominal=0.1) for n, role in ROLES.items())
    output = Output("u", "V", "motor voltage", LAW)
    pd = Component(name="pd", description="equations", inputs=inputs, outputs=(output,))
    return ballscrew.run(pd, **given).run


@pytest.mark.parametrize("step", [PERIOD / 3, pytest.param(None, marks=pytest.mark.ci)])
def test_it_runs_as_the_same_law_sampled_in_equations(tmp_path, step):
    given = {"stop": 0.3, "sampled": PERIOD, "step": step}
    fmu = ballscrew.run(proportional(tmp_path, "Theirs"), **given)
    equations = by_equations(**given)
    assert fmu.run.sampling_period == equations.sampling_period == PERIOD
    assert fmu.trusted
    ours = np.interp(fmu.run.time, equations.time, equations.outputs["x"])
    np.testing.assert_allclose(fmu.run.outputs["x"], ours, rtol=0, atol=1e-6)
    points = np.round(fmu.run.time / PERIOD, 6)
    assert not np.diff(fmu.run.commands["u"])[points[1:] % 1 != 0].any()


@pytest.mark.ci
def test_a_sampled_controller_with_a_clock_of_its_own_is_stepped_by_communication_steps(tmp_path):
    """It says that its output is discrete, and its clock samples at every fifth of them."""
    path = str(tmp_path / "clock.fmu")
    ticks = "ceil((t + h) / 0.005 - 1e-6) > ceil(t / 0.005 - 1e-6)"
    small_fmus.pd(path, out="", step=f"if ({ticks}) $u$ = 400 * ($x_d$ - $x$) - 2 * $v$;")
    small_fmus.edited(path, ('"continuous" initial', '"discrete" initial'))
    fmu = ballscrew.run(path, stop=0.1, step=1e-3)
    assert "with the communication step of 0.001 s as its period" in " ".join(fmu.notes)
    assert fmu.trusted
    equations = by_equations(stop=0.1, sampled=0.005)
    ours = np.interp(fmu.run.time, equations.time, equations.outputs["x"])
    np.testing.assert_allclose(fmu.run.outputs["x"], ours, rtol=0, atol=1e-6)


def test_it_is_stepped_once_in_each_period_whatever_the_steps_and_the_end_of_the_run(tmp_path):
    counts = proportional(
        tmp_path,
        "Counts",
        in_step="assert abs(step_size - 0.003) < 1e-12; "
        "self.n = getattr(self, 'n', -1) + 1; "
        "assert abs(current_time - 0.003 * self.n) < 1e-12",
    )
    for step in (3e-3, 7e-4):
        result = ballscrew.run(counts, stop=0.05, step=step, sampled=3e-3)
        assert not result.run.stopped
        assert result.run.time[-1] == pytest.approx(0.05)
    continuous = ballscrew.run(proportional(tmp_path, "Theirs"), stop=0.02, step=1e-3)
    assert any("sampling period" in note for note in continuous.notes)
    assert not any("sampling period" in note for note in result.notes)


def test_a_restored_state_goes_on_as_the_saved_one(native):
    part = Sampled(FmuInstance(native("pid"), "controller"), PERIOD)
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
    assert moved(6) == once
    assert len(set(once)) == 2
    part.release(state)
    part.close()

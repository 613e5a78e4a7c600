"""The master over FMUs against the whole loop in one solver."""

from functools import cache

import numpy as np
import pytest

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.couplings import Coupling


@cache
def truth(controller):
    """The nominal loop in one solver, on a grid of 1e-4 s."""
    return run_monolithic(Loop(controller, reference=0.08, stop=2.0), 1e-4)


def error(run, reference, name="x"):
    exact = np.interp(run.time, reference.time, reference.outputs[name])
    return np.abs(run.outputs[name] - exact).max()


@pytest.fixture
def run(native):
    """Function that runs native FMUs, which give the same bits a dozen times as fast."""

    def run_them(controller, step, stop=2.0, **options):
        loop = Loop(str(native(controller)), str(native("plant")), step=step, stop=stop, **options)
        return run_closed_loop(loop).run

    return run_them


@pytest.mark.ci
@pytest.mark.parametrize(("corrections", "order", "bound"), [(0, 2.0, 7.3e-5), (1, 2.2, 8.4e-6)])
def test_tangent_coupling_of_iol_converges_with_second_order(run, corrections, order, bound):
    """The bounds are those of a step of a millisecond."""
    steps = np.array([2e-3, 1e-3, 5e-4, 2e-4, 1e-4])
    runs = [run("iol", h, 0.5, corrections=corrections) for h in steps]
    errors = [error(found, truth("iol")) for found in runs]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(order, abs=0.2)
    assert 0.9 * bound < errors[1] < bound


def test_held_iol_at_ten_microseconds_is_not_converged(run):
    held = run("iol", 1e-5, 0.5, coupling=Coupling.GAUSS_SEIDEL)
    assert not held.verdict.trusted
    assert abs(held.outputs["x"][50_000] - 0.08 + 0.034736) > 0.03  # it is indeed far off
    assert held.effect_rate_max["i"] > 0.05  # ampere per second, by steps of ten microseconds


# others, whose commands leave the limit within a step, ask for shorter ones: docs/controllers.md
LONG = "nctf iol_true_acceleration pid_sampled adaptive_friction"


@pytest.mark.parametrize(
    "controller",
    [
        "iol",
        *(pytest.param(c, marks=pytest.mark.ci) for c in ("pid", "p_pi")),
        *(pytest.param(c, marks=pytest.mark.prove) for c in LONG.split()),
    ],
)
def test_every_controller_is_trusted_by_default_and_close_to_the_reference(run, controller):
    result = run(controller, 1e-3)
    assert result.verdict.trusted, result.verdict
    assert result.coupling is Coupling.INTERFACE_JACOBIAN
    reference = truth(controller)
    for name, share in {"x": 5e-4, "v": 2e-3, "z": 1e-2, "i": 2e-3}.items():
        assert error(result, reference, name) < share * np.ptp(reference.outputs[name]), name


@pytest.mark.ci
def test_a_sampled_controller_is_met_at_its_samples_and_its_hold_is_no_defect(run):
    result = run("pid_sampled", 6e-4)
    assert result.step_range == pytest.approx((5e-4, 5e-4))
    assert "meet its samples" in result.coupling_reason
    assert result.residual_max["u"] == 0.0
    assert result.verdict.trusted
    assert truth("pid_sampled").step_range == pytest.approx((1e-4, 1e-4))
    held = result.commands["u"][:-1].reshape(-1, 2)
    assert np.all(held == held[:, :1])
    assert error(result, truth("pid_sampled")) < 1e-7

"""The master over FMUs against the whole loop in one solver."""

import numpy as np
import pytest

from ballscrew.controllers import CONTROLLERS
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.reference_signal import Reference


@pytest.fixture(scope="module")
def truth():
    """Reference courses of the nominal loops on a grid of 1e-4 s."""
    kept = {}

    def course(controller, stop, goal=0.08, **values):
        key = (controller, stop, goal, str(values))
        if key not in kept:
            reference = Reference.constant(goal)
            kept[key] = run_monolithic(
                Loop(controller, reference=reference, stop=stop, **values), 1e-4
            )
        return kept[key]

    return course


def error(run, reference, name="x"):
    exact = np.interp(run.time, reference.time, reference.outputs[name])
    return np.abs(run.outputs[name] - exact).max()


def run(controller, step, stop=2.0, **options):
    return run_closed_loop(Loop(controller, step=step, stop=stop, **options)).run


@pytest.fixture
def run_native(native):
    """As `run`, over native FMUs, which give the same bits a dozen times as fast."""

    def run_them(controller, step, stop=2.0, **options):
        plant = str(native("plant"))
        return run(str(native(controller)), step, stop, plant=plant, **options)

    return run_them


@pytest.mark.ci
@pytest.mark.parametrize(("corrections", "order", "bound"), [(0, 2.0, 7.3e-5), (1, 2.2, 8.4e-6)])
def test_tangent_coupling_of_iol_converges_with_second_order(
    run_native, truth, corrections, order, bound
):
    """The bounds are those of a step of a millisecond."""
    steps = np.array([2e-3, 1e-3, 5e-4, 2e-4, 1e-4])
    runs = [run_native("iol", h, 0.5, corrections=corrections) for h in steps]
    errors = [error(run, truth("iol", 2.0)) for run in runs]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(order, abs=0.2)
    assert 0.9 * bound < errors[1] < bound


def test_held_iol_at_ten_microseconds_is_not_converged(run_native):
    held = run_native("iol", 1e-5, 0.5, coupling=Coupling.GAUSS_SEIDEL)
    assert not held.verdict.trusted
    assert abs(held.outputs["x"][50_000] - 0.08 + 0.034736) > 0.03  # it is indeed far off
    assert held.effect_rate_max["i"] > 0.05  # ampere per second, by steps of ten microseconds
    assert "range" in held.verdict.reason
    assert held.verdict.advice


# Commands that jump to the limit and leave it within a step ask for shorter ones than 1e-3 s, which
# docs/controllers.md has.
NOT_AT_A_MILLISECOND = (
    "sliding_mode pid_dob lqi super_twisting pid_lugre iol_observed fuzzy_pd_i relay"
)
ELSEWHERE = {"iol", "pid", "p_pi", *NOT_AT_A_MILLISECOND.split()}


@pytest.mark.parametrize(
    "controller",
    [
        "iol",
        *(pytest.param(c, marks=pytest.mark.ci) for c in ("pid", "p_pi")),
        *(pytest.param(c, marks=pytest.mark.prove) for c in CONTROLLERS if c not in ELSEWHERE),
    ],
)
def test_every_controller_is_trusted_by_default_and_close_to_the_reference(
    run_native, truth, controller
):
    result = run_native(controller, 1e-3)
    assert result.verdict.trusted, result.verdict
    assert result.coupling is Coupling.INTERFACE_JACOBIAN
    reference = truth(controller, 2.0)
    for name, share in {"x": 5e-4, "v": 2e-3, "z": 1e-2, "i": 2e-3}.items():
        assert error(result, reference, name) < share * np.ptp(reference.outputs[name]), name


def test_parameters_and_initial_states_reach_both_sides(run_native, truth):
    values = {
        "plant_values": {"m": 1.5, "sigma0": 5e4, "x_start": 0.03},
        "controller_values": {"m": 1.5, "sigma0_hat": 5e4 + 0.2, "sigma1_hat": 346.0},
    }
    result = run_native("iol", 5e-4, **values)
    reference = truth("iol", 2.0, **values)
    assert error(result, reference) < 2e-5
    assert abs(reference.outputs["x"][-1] - 0.08) > 1e-6  # the wrong estimates show
    assert result.outputs["x"][0] == 0.03


@pytest.mark.ci
def test_a_sampled_controller_is_met_at_its_samples_and_its_hold_is_no_defect(truth):
    result = run("pid_sampled", 6e-4)
    assert result.step_range == pytest.approx((5e-4, 5e-4))
    assert "meet its samples" in result.coupling_reason
    assert result.residual_max["u"] == 0.0
    assert result.verdict.trusted
    assert truth("pid_sampled", 2.0).step_range == pytest.approx((1e-4, 1e-4))
    held = result.commands["u"][:-1].reshape(-1, 2)
    assert np.all(held == held[:, :1])
    assert error(result, truth("pid_sampled", 2.0)) < 1e-7

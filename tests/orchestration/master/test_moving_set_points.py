"""Set-points that jump and bend anywhere are followed as functions of time.

The truth comes from scipy, which meets each jump with the end of an integration, and which asks for
the set-point as a function written here.
"""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.orchestration.loop.closed_loop import metrics, run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.reference_signal import Reference

STOP = 0.5
TURNS, PLACES = np.array([0.0, 0.1037, 0.2041, 0.3513, 0.4]), np.array([0.0, 0.0, 0.01, 0.01, 0.0])


def step_at(at, length):
    return f"step:size=0.08,at={at}", lambda t: 0.08 * (np.asarray(t) >= at), [at], length


def sine(size, frequency):
    def moved(t):
        return 0.5 * size * (1 - np.cos(2 * np.pi * frequency * t))

    return f"sine:amplitude={size},frequency={frequency}", moved, [], 0.1


def trapezoid(t):
    return np.interp(t, TURNS, PLACES)


SET_POINTS = {
    # motion, the same as a function, where it is not smooth, communication step
    "step": step_at(0.1, 1e-3),
    "step off the grid": step_at(0.10037, 5e-4),
    "sine": sine(0.01, 1),
    "sine of the steps' frequency": sine(1e-3, 10),
    "trapezoid": (Reference(TURNS, PLACES), trapezoid, [*TURNS[1:]], 1e-2),
}


def truth(name, times):
    """x''' + 18 x'' + 107 x' + 210 (x - x_d) = 0, which the linearizing controller makes of it."""
    _, goal, ends, _ = SET_POINTS[name]
    state, parts = np.zeros(3), []
    for start, end in itertools.pairwise([0.0, *ends, STOP]):

        def rates(t, s, start=start, end=end):
            x_d = goal(min(max(t, start), end - 1e-12 * (end < STOP)))
            return [s[1], s[2], 210 * (x_d - s[0]) - 107 * s[1] - 18 * s[2]]

        how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "dense_output": True}
        part = solve_ivp(rates, (start, end), state, **how)
        state = part.y[:, -1]
        parts.append((end, part.sol))
    found = [next(sol for end, sol in parts if t <= end + 1e-12)(t) for t in times]
    return np.array(found).T[:2]


def check(run, name, round_off):
    """At rest before the set-point moves, and never called trusted beyond the stated error."""
    first = next(iter(SET_POINTS[name][2]), 0.0)
    before = run.time < first - 1e-9
    assert not run.outputs["x"][before].any()
    assert not run.outputs["v"][before].any()
    rows = slice(None, None, max(1, len(run.time) // 200))
    errors = {}
    for output, exact in zip("xv", truth(name, run.time[rows]), strict=True):
        errors[output] = np.abs(run.outputs[output][rows] - exact).max()
        if run.verdict.trusted:
            assert errors[output] <= run.verdict.error_estimate[output] + round_off, output
    return errors


@pytest.mark.parametrize("name", SET_POINTS)
def test_in_one_solver_whatever_the_step(name):
    motion, goal, _, step = SET_POINTS[name]
    run = run_monolithic(Loop("iol", reference=motion, stop=STOP), step)
    assert run.verdict.trusted
    errors = check(run, name, 2e-10)
    assert errors["x"] < 2e-10
    assert errors["v"] < 2e-9
    np.testing.assert_allclose(run.reference, goal(run.time + 1e-12), atol=1e-12)
    fine = np.linspace(0.0, STOP, 10_001)
    error = goal(fine) - truth(name, fine)[0]  # its largest value lies between the points
    figures = metrics(run)
    assert figures["largest_error"] == pytest.approx(np.abs(error).max(), rel=1e-3)
    assert figures["rms_error"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=5e-3)


@pytest.mark.parametrize(
    "coupling",
    [Coupling.INTERFACE_JACOBIAN, pytest.param(Coupling.GAUSS_SEIDEL, marks=pytest.mark.ci)],
)
@pytest.mark.parametrize("name", SET_POINTS)
def test_over_fmus_no_error_is_larger_than_the_one_a_trusted_run_states(coupling, name, native):
    motion, goal, _, step = SET_POINTS[name]
    fmus = str(native("iol")), str(native("plant"))
    result = run_closed_loop(Loop(*fmus, motion, STOP, step=step, coupling=coupling))
    run = result.run
    check(run, name, 1e-9)
    coarse = any("coarse for the figures" in note for note in result.notes)
    assert coarse == ("frequency" in name)
    if name.startswith("step") and coupling is Coupling.INTERFACE_JACOBIAN:
        assert run.verdict.trusted  # the jump itself costs nothing, wherever it is
        assert len(run.time) == round(STOP / step) + 1
        np.testing.assert_array_equal(run.reference, goal(run.time + 1e-12))
    if name.startswith("sine"):
        assert not run.verdict.trusted  # which a grid of 0.1 s does not see


@pytest.mark.parametrize(
    "controller", ["pid_sampled", pytest.param("nctf+velocity_estimate", marks=pytest.mark.ci)]
)
def test_what_is_sampled_sees_a_jump_no_sooner_and_at_the_next_sample(controller):
    """A jump between two samples, in one solver and over FMUs."""
    motion = "step:size=0.01,at=0.01037"
    whole = run_monolithic(Loop(controller, reference=motion, stop=0.05), 1e-3)
    over = run_closed_loop(Loop(controller, reference=motion, stop=0.05, step=1e-3)).run
    assert over.verdict.trusted is (controller == "pid_sampled")  # the other moves in between, too
    at = np.searchsorted(over.time, whole.time - 1e-9)
    estimate = over.verdict.error_estimate["x"] + 1e-10
    np.testing.assert_allclose(over.outputs["x"][at], whole.outputs["x"], atol=estimate)
    first = whole.time[np.flatnonzero(whole.outputs["v"])[0]]
    assert first > 0.01037
    assert not whole.commands["u"][whole.time < 0.01037].any()

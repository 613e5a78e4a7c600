"""Set-points that jump and bend anywhere are followed as functions of time.

The truth comes from scipy, which meets each jump with the end of an integration, and which asks for
the set-point as a function written here.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_motions import move, read_motion
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.study.loop import StudyLoop
from ballscrew.orchestration.whole_loop import loop_kernel, run_monolithic
from ballscrew.solver.kernel import Model

STOP = 0.5
TURNS, PLACES = np.array([0.0, 0.1037, 0.2041, 0.3513, 0.4]), np.array([0.0, 0.0, 0.01, 0.01, 0.0])


def after(t, at):
    return 0.08 * (np.asarray(t) >= at)


SET_POINTS = {
    # motion, the same as a function, where it is not smooth, communication step
    "step": (read_motion("step:size=0.08,at=0.1"), lambda t: after(t, 0.1), [0.1], 1e-3),
    "step off the grid": (
        read_motion("step:size=0.08,at=0.10037"),
        lambda t: after(t, 0.10037),
        [0.10037],
        5e-4,
    ),
    "sine": (
        read_motion("sine:amplitude=0.01,frequency=1"),
        lambda t: 0.005 * (1 - np.cos(2 * np.pi * t)),
        [],
        0.1,
    ),
    "trapezoid": (
        Reference(TURNS, PLACES),
        lambda t: np.interp(t, TURNS, PLACES),
        [*TURNS[1:]],
        1e-2,
    ),
}


@pytest.fixture(scope="module")
def truth():
    """Positions and velocities at times, by an implicit method between the given ends."""
    kept = {}

    def course(controller, name, times):
        if (controller, name) in kept:
            return [s(times) for s in kept[controller, name]]
        _, goal, ends, _ = SET_POINTS[name]
        model = Model(loop_kernel("plant", controller))
        at, state = [i.name for i in model.kernel.inputs].index("x_d"), model.x.copy()
        parts = []
        for start, end in zip([0.0, *ends], [*ends, STOP], strict=True):
            if not end > start:
                continue

            def moved(t, x, start=start, end=end):
                model.u[at] = goal(min(max(t, start), end - 1e-12 * (end < STOP)))
                return model.derivatives(t, x)

            def slopes(t, x, start=start, end=end):
                moved(t, x, start, end)
                return model.jacobian(t, x)

            part = solve_ivp(
                moved,
                (start, end),
                state,
                method="Radau",
                jac=slopes,
                rtol=1e-10,
                atol=1e-11 * model.kernel.nominal,
                dense_output=True,
            )
            state = part.y[:, -1]
            parts.append((end, part.sol))
        states = [s.name for s in model.kernel.states]

        def read(name):
            row = states.index(f"plant_{name}")
            return lambda times: np.array(
                [next(sol for end, sol in parts if t <= end + 1e-12)(t)[row] for t in times]
            )

        kept[controller, name] = read("x"), read("v")
        return [s(times) for s in kept[controller, name]]

    return course


def check(run, truth, controller, name, round_off):
    """At rest before the set-point moves, and never called trusted beyond the stated error."""
    first = next(iter(SET_POINTS[name][2]), 0.0)
    before = run.time < first - 1e-9
    assert not run.outputs["x"][before].any()
    assert not run.outputs["v"][before].any()
    rows = slice(None, None, max(1, len(run.time) // 200))
    errors = {}
    for output, exact in zip("xv", truth(controller, name, run.time[rows]), strict=True):
        errors[output] = np.abs(run.outputs[output][rows] - exact).max()
        if run.verdict.trusted:
            assert errors[output] <= run.verdict.error_estimate[output] + round_off, output
    return errors


@pytest.mark.parametrize("name", SET_POINTS)
@pytest.mark.parametrize("controller", ["pid", "nctf", "iol"])
def test_in_one_solver_whatever_the_step(controller, name, truth):
    motion, goal, _, step = SET_POINTS[name]
    run = run_monolithic(Loop(controller, reference=motion, stop=STOP), step)
    assert run.verdict.trusted
    errors = check(run, truth, controller, name, 2e-11)
    assert errors["x"] < 2e-11
    assert errors["v"] < 2e-10
    np.testing.assert_allclose(run.reference, goal(run.time + 1e-12), atol=1e-12)


@pytest.mark.parametrize("name", SET_POINTS)
@pytest.mark.parametrize("coupling", [Coupling.INTERFACE_JACOBIAN, Coupling.GAUSS_SEIDEL])
@pytest.mark.parametrize("controller", ["pid", "nctf", "iol"])
def test_over_fmus_no_error_is_larger_than_the_one_a_trusted_run_states(
    controller, coupling, name, truth, native
):
    motion, _, ends, step = SET_POINTS[name]
    fmus = str(native(controller)), str(native("plant"))
    run = run_closed_loop(Loop(*fmus, motion, STOP, step=step, coupling=coupling)).run
    check(run, truth, controller, name, 1e-10)
    if name.startswith("step") and coupling is Coupling.INTERFACE_JACOBIAN:
        assert run.verdict.trusted  # the jump itself costs nothing, wherever it is
        assert len(run.time) == round(STOP / step) + 1
        np.testing.assert_array_equal(run.reference, after(run.time + 1e-12, ends[0]))
    if name == "sine":
        assert not run.verdict.trusted  # which a grid of 0.1 s does not see


def test_a_jump_that_the_linearized_loop_answers_as_the_linear_one():
    """x''' + 18 x'' + 107 x' + 210 (x - x_d) = 0, solved by hand."""
    run = run_monolithic(
        Loop("iol", reference=read_motion("step:size=0.08,at=0.10037"), stop=2.0), 0.05
    )
    t = np.maximum(run.time - 0.10037, 0.0)
    exact = 0.08 * (1 - 21 * np.exp(-5 * t) + 35 * np.exp(-6 * t) - 15 * np.exp(-7 * t))
    np.testing.assert_allclose(run.outputs["x"], exact, atol=2e-10)


def test_steps_that_adapt_themselves_end_at_a_jump_and_see_a_curve(native):
    """As they see everything else: by what the run and its co-run differ by in a step."""
    for text, trusted in (("step:size=0.01,at=0.10037", True), ("move:distance=0.01", True)):
        motion = read_motion(text)
        fmus = str(native("pid")), str(native("plant"))
        run = run_closed_loop(Loop(*fmus, motion, STOP, step=5e-3, adaptive=True)).run
        exact = run_monolithic(Loop("pid", reference=motion, stop=STOP), 1e-3)
        apart = np.interp(run.time, exact.time, exact.outputs["x"]) - run.outputs["x"]
        assert not run.outputs["x"][run.time < 0.1].any()
        assert run.verdict.trusted is trusted
        assert np.abs(apart).max() <= 1e-5  # of which linear reading between rows is most
        assert run.step_range[0] < 5e-3


@pytest.mark.parametrize("controller", ["pid_sampled", "nctf+velocity_estimate"])
def test_what_is_sampled_sees_a_jump_no_sooner_and_at_the_next_sample(controller):
    """A jump between two samples, in one solver, over FMUs and in a study's loop."""
    motion = read_motion("step:size=0.01,at=0.01037")
    whole = run_monolithic(Loop(controller, reference=motion, stop=0.05), 1e-3)
    study = StudyLoop(loop_kernel("plant", controller)).run({}, motion, 0.05, 1e-10)
    over = run_closed_loop(Loop(controller, reference=motion, stop=0.05, step=1e-3)).run
    assert over.verdict.trusted is (controller == "pid_sampled")  # the other moves in between, too
    rows = np.searchsorted(study.time, whole.time - 1e-9)
    np.testing.assert_allclose(study.position[rows], whole.outputs["x"], atol=1e-12)
    at = np.searchsorted(over.time, whole.time - 1e-9)
    estimate = over.verdict.error_estimate["x"] + 1e-10
    np.testing.assert_allclose(over.outputs["x"][at], whole.outputs["x"], atol=estimate)
    first = whole.time[np.flatnonzero(whole.outputs["v"])[0]]
    assert first > 0.01037
    assert not whole.commands["u"][whole.time < 0.01037].any()


def test_a_studys_loop_follows_a_curve_whatever_its_grid():
    loop, motion = StudyLoop(loop_kernel("plant", "p_pi")), move(0.01, start=0.0137)
    fine, coarse = (loop.run({}, motion, 0.5, 1e-10, h) for h in (1e-3, 1e-2))
    np.testing.assert_allclose(coarse.position, fine.position[::10], atol=1e-13)

"""Couplings step by step: linear parts, whose own solutions are exact, joined by hand in NumPy."""

import itertools
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from verdict.parts import LawSlave, LinearSlave, law_inputs

from ballscrew.orchestration.fmu import compiled
from ballscrew.orchestration.fmu.fmu_instance import StepFailed
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.march import UNKNOWN
from ballscrew.orchestration.master.master import choose_step, judged, run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.runs import Runs
from ballscrew.orchestration.master.sides import Sides
from ballscrew.solver.errors import CouplingError

A = np.array([[0.0, 1.0], [-4.0, -1.0]])
B = np.array([[0.0], [3.0]])
AC, BC = np.array([[-2.0]]), np.array([[0.7, -0.4, 1.1]])
C, D = np.array([[1.3]]), np.array([[-2.0, -0.6, 2.5]])
K = D[:, :2]
START, OWN_START = np.array([0.3, -0.2]), np.array([0.1])
STEP, STOP = 0.05, 1.02  # the last step is shorter
JACOBI, GAUSS_SEIDEL, LAW = Coupling.JACOBI, Coupling.GAUSS_SEIDEL, Coupling.INTERFACE_JACOBIAN
# rises, jumps between two communication points, and stays
GOAL = Reference(np.array([0.0, 0.4, 0.63, 0.63, 2.0]), np.array([0.0, 1.0, 1.0, -0.5, -0.5]))
STILL = Reference.constant(1.0)


def parts(law=True, **how):
    """A plant and a controller u = C z + D (y, x_d), z' = AC z + BC (y, x_d)."""
    ports = law_inputs(2) if law else ["u"]
    wide = np.hstack([B, np.zeros((2, len(ports) - 1))])
    kind, names = LawSlave if law else LinearSlave, ["y0", "y1"]
    none = np.zeros((2, len(ports)))
    plant = kind("plant", A, wide, np.eye(2), none, ports, names, START)
    plant.can_save = how.get("can_save", True)
    shown = np.vstack([C, [[1.0]]]), np.vstack([D, 0.0 * D]), [*names, "x_d"], ["u", "z"]
    return plant, LinearSlave("controller", AC, BC, *shown, OWN_START, **how)


def follow(a, b, h, x, given, ramp=0.0):
    """The solution of x' = a x + b (given + ramp t) after a time."""
    given = np.broadcast_to(given, b.shape[1])
    ramps = np.broadcast_to(ramp, b.shape[1])
    moved = solution(a.tobytes(), b.tobytes(), len(a), float(h))
    return moved @ np.concatenate([x, given, ramps])


@cache
def solution(a, b, n, h):
    a, b = np.frombuffer(a).reshape(n, n), np.frombuffer(b).reshape(n, -1)
    m = b.shape[1]
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n : n + m], whole[n : n + m, n + m :] = a, b, np.eye(m)
    return expm(whole * h)[:n]


def command(y, z, goal):
    return (C @ z + D @ [*y, goal])[0]


class Pair:
    """The two parts, moved by one coupling."""

    def __init__(self, coupling, corrected, averaged):
        self.law, self.late = coupling is LAW, coupling is JACOBI and not corrected
        self.corrected, self.averaged = corrected, averaged
        self.y, self.z = START, OWN_START
        self.held = np.nan  # the late command
        self.probed = None  # the length of the step that the law in force was found with
        self.residual, self.effect, self.contraction = 0.0, np.zeros(2), np.nan

    def both(self, h, before, after, applied, rate):
        """Plant, then controller; the residual is the true command at the end minus the applied."""
        y, z = self.y, self.z
        if self.law:
            end = follow(A + B @ K, B, h, y, applied - (K @ y)[0], rate)
        else:
            end = follow(A, B, h, y, applied)
        seen = [*y, before] if self.late else [*end, after]
        if self.averaged:
            seen = [*(y + end) / 2, (before + after) / 2]
        z = follow(AC, BC, h, z, seen)
        given = applied + self.law * ((K @ (end - y))[0] + rate * h)
        return end, z, command(end, z, after) - given

    def step(self, h, before, after):
        y, z = self.y, self.z
        true = command(y, z, before)
        applied, rate = self.held if self.late else true, 0.0
        if self.law:
            little = (self.probed or h) / 64
            rate = (command(y, follow(AC, BC, little, z, [*y, before]), before) - true) / little
            rate += (command(y, z, after) - true) / h
        end, self.z, residual = self.both(h, before, after, applied, rate)
        if self.corrected:
            first, end_before = residual, end
            self.z = z
            if self.law:
                share, rate = 2 / 3, rate + 2 / 3 * first / h
            else:
                share, applied = 1 / 2, applied + first / 2
            end, self.z, residual = self.both(h, before, after, applied, rate)
            self.effect = np.abs(end - end_before)
            self.contraction = abs(residual - (1 - share) * first) / abs(share * first)
        elif abs(true - applied) > abs(residual):
            residual = true - applied
        self.held, self.y, self.residual, self.probed = command(y, self.z, before), end, residual, h


def by_hand(pair, times, goal):
    """What the pair does from time to time, in steps that end at jumps of the set-point, too."""
    rows, commands, own = [START], [command(START, OWN_START, *goal.all_at(0, [0]))], [OWN_START[0]]
    pair.held = commands[0]
    seen = {name: [] for name in ("y", "residual", "effect", "contraction")}
    for start, end in itertools.pairwise(times):
        inside = [start, *(j for j in goal.jumps((0,)) if start < j < end), end]
        for begin, until in itertools.pairwise(inside):
            at = np.array([begin, until])
            (before, _), (left, after) = goal.on(at, 0), goal.on(at, 0, before=True)
            if before != left:
                pair.probed = None
            pair.step(until - begin, before, after)
            seen["effect"].append(pair.effect / (until - begin))
            for name in ("y", "residual", "contraction"):
                seen[name].append(getattr(pair, name))
        rows.append(pair.y)
        own.append(pair.z[0])
        commands.append(command(pair.y, pair.z, *goal.all_at(end, [0])))
    seen = {name: np.array(values) for name, values in seen.items()}
    return SimpleNamespace(rows=np.array(rows), commands=np.array(commands), own=own, **seen)


def outputs(run):
    return np.column_stack([run.outputs["y0"], run.outputs["y1"]])


def contraction_of(run, corrected, lengths):
    """The mean over the steps, weighted by the effect as a share of the range up to there."""
    seen = np.vstack([START, run.y])
    ranges = np.maximum.accumulate(seen) - np.minimum.accumulate(seen)
    shares = corrected.effect * lengths[:, None] / np.maximum(ranges[1:], 0.1)
    return np.average(corrected.contraction, weights=shares.max(axis=1))


@pytest.mark.parametrize("corrections", [0, 1])
@pytest.mark.parametrize("coupling", [JACOBI, GAUSS_SEIDEL, LAW])
def test_a_run_is_its_recursion_and_its_effect_that_of_a_correction(coupling, corrections):
    """Probed derivatives are differences, which are right to 1e-8 here; the rest is round-off."""
    law = coupling is LAW
    size = 1e-7 if law else 1e-11
    plant, controller = parts(law)
    plant.nominal = lambda name: 10.0
    run = run_loop(Sides(plant, controller, GOAL, STOP, coupling, corrections), STEP, look=False)
    times = np.append(np.arange(21) * STEP, STOP)
    lengths = np.diff(np.sort(np.append(times, 0.63)))
    np.testing.assert_allclose(run.time, times, rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.reference, GOAL.on(times, 0), rtol=0, atol=1e-15)
    exact = by_hand(Pair(coupling, corrections, law or corrections), times, GOAL)
    np.testing.assert_allclose(outputs(run), exact.rows, rtol=0, atol=size)
    np.testing.assert_allclose(run.commands["u"], exact.commands, rtol=0, atol=10 * size)
    np.testing.assert_allclose(run.others["controller.z"], exact.own, rtol=0, atol=size)
    corrected = by_hand(Pair(coupling, True, True), times, GOAL)
    residual, effect = np.abs(exact.residual).max(), corrected.effect.max(axis=0)
    assert run.residual_max["u"] == pytest.approx(residual, abs=10 * size)
    assert list(run.effect_rate_max.values()) == pytest.approx(effect, rel=1e-9, abs=100 * size)
    contraction = contraction_of(exact, corrected, lengths)
    assert run.verdict.contraction == pytest.approx(contraction, rel=1e-9 + 100 * size)


@pytest.mark.parametrize(
    ("coupling", "can_save"),
    [(JACOBI, True), (JACOBI, False), (GAUSS_SEIDEL, True), (GAUSS_SEIDEL, False), (LAW, True)],
)
def test_rungs_with_other_steps_are_corrected_if_possible_and_judge(coupling, can_save):
    """The difference from the finest rung, and what all halvings to come may move."""
    law = coupling is LAW
    how = {} if can_save else {"can_save": False}
    run = run_loop(Sides(*parts(law, **how), STILL, 1.0, coupling), 0.01)
    best = (can_save, law or can_save)

    def rung(step):
        times = np.append(np.arange(round(1.0 / step)) * step, 1.0)
        return by_hand(Pair(coupling, *best), times, STILL).rows

    def apart(step):
        """Of a rung and the one with half of its step, at the points of the run or of the rung."""
        every = max(1, round(0.01 / step))
        return np.abs(rung(step)[::every] - rung(step / 2)[:: 2 * every]).max(axis=0)

    exact = by_hand(Pair(coupling, law and can_save, law), run.time, STILL).rows
    span, finest = np.ptp(exact, axis=0), float(run.verdict.reason.split("down to ")[1].split()[0])
    last, before = apart(2 * finest), apart(4 * finest)
    ratio = (last / span).max() / (before / span).max()
    off = np.abs(exact - rung(finest)[:: round(0.01 / finest)]).max(axis=0)
    estimate = off + last * (2.0 if finest < 0.003 else max(1.0, ratio / (1 - ratio)))
    if not can_save and (estimate / span).max() <= 0.01:
        other = Pair({JACOBI: GAUSS_SEIDEL, GAUSS_SEIDEL: JACOBI}[coupling], False, False)
        times = np.append(np.arange(round(1.0 / finest)) * finest, 1.0)
        timed = np.abs(by_hand(other, times, STILL).rows - rung(finest)).max(axis=0)
        estimate = np.maximum(estimate, 0.01 / finest * timed)
    assert list(run.verdict.error_estimate.values()) == pytest.approx(estimate, rel=1e-6, abs=1e-7)
    assert run.verdict.trusted == (np.max(estimate / span) <= 0.01)
    assert (run.effect_rate_max == {}) == (not can_save)


def closed(goal, times):
    """The exact outputs of the loop for a constant set-point."""
    whole = np.block([[A + B @ K, B @ C], [BC[:, :2], AC]])
    driven = np.concatenate([B[:, 0] * D[0, 2], BC[:, 2]])[:, None]
    start = np.concatenate([START, OWN_START])
    return np.array([follow(whole, driven, t, start, goal)[:2] for t in times])


@pytest.mark.parametrize("coupling", [GAUSS_SEIDEL, LAW])
def test_fmus_that_accept_one_step_only_are_judged_by_another_exchange_of_their_signals(coupling):
    trusted = []
    for step in (0.04, 0.01, 0.0025):
        plant, controller = parts(coupling is LAW)
        plant.steps_vary = False
        run = run_loop(Sides(plant, controller, STILL, 1.0, coupling), step)
        error = np.abs(outputs(run) - closed(1.0, run.time)).max(axis=0)
        assert np.all(error <= list(run.verdict.error_estimate.values()))
        trusted.append(run.verdict.trusted)
    assert trusted[-1]
    assert trusted == sorted(trusted)


@pytest.mark.parametrize("can_save", [True, False])
@pytest.mark.parametrize("coupling", [JACOBI, GAUSS_SEIDEL, LAW])
def test_a_controller_that_answers_in_its_step_has_seen_the_signals_of_its_start(
    coupling, can_save
):
    sides = parts(coupling is LAW, can_save=can_save, answers_in_step=True)
    run = run_loop(Sides(*sides, STILL, 1.0, coupling), STEP)
    y, z, late, rows = START, OWN_START, (C @ OWN_START)[0], [START]
    probed = coupling is LAW and can_save  # its steps are corrected, too
    gain = K * probed
    for _ in range(20):
        true = command(y, z, 1.0)
        z = follow(AC, BC, STEP, z, [*y, 1.0])
        law = A + B @ gain, B, STEP, y, (late if coupling is JACOBI else true) - gain @ y
        end = follow(*law)
        if probed:
            end = follow(*law, 2 / 3 * (command(end, z, 1.0) - true - gain @ (end - y)) / STEP)
        y, late = end, true
        rows.append(y)
    np.testing.assert_allclose(outputs(run), rows, rtol=0, atol=1e-9 if probed else 1e-11)
    assert np.isfinite(list(run.verdict.error_estimate.values())).all()


# loops of parts that both follow their inputs at once


def at_once(through, gains, **how):
    """x' = A x + B2 u, y = x + through u; u = gains (y, x_d)."""
    names, commands = ["y0", "y1"][: len(through)], ["u", "w"][: len(gains)]
    size, both = len(names), np.array([[1.0, 0.3], [0.0, 3.0]])
    plant = LinearSlave(
        *("plant", A[:size, :size] - np.eye(size), both[:size, : len(commands)], np.eye(size)),
        *(through, commands, names, np.zeros(size)),
        **how,
    )
    none = np.zeros((0, 0))
    controller = LinearSlave(
        *("controller", none, np.zeros((0, size + 1)), np.zeros((len(commands), 0))),
        *(gains, [*names, "x_d"], commands, np.zeros(0)),
    )
    return plant, controller


@pytest.mark.parametrize("can_save", [True, False])
def test_every_row_of_a_loop_of_two_commands_solves_its_equations(can_save):
    """The first pivot of its matrix is zero."""
    through, gains = np.array([[0.2, 0.3], [0.4, -0.5]]), np.array([[1, 2, 3], [0.5, -1, 0.7]])
    around = np.eye(2) - gains[:, :2] @ through
    assert around[0, 0] == 0.0
    plant, controller = at_once(through, gains, can_save=can_save)
    run = run_loop(Sides(plant, controller, STILL, 1.0, GAUSS_SEIDEL), STEP)
    x, rows, commands = np.zeros(2), [], []
    for _ in range(21):
        commands.append(np.linalg.solve(around, gains @ [*x, 1.0]))
        rows.append(x + through @ commands[-1])
        x = follow(plant.A, plant.B, STEP, x, commands[-1])
    np.testing.assert_allclose(outputs(run), rows, rtol=1e-9, atol=1e-9)
    found = np.column_stack([run.commands["u"], run.commands["w"]])
    np.testing.assert_allclose(found, commands, rtol=1e-9, atol=1e-9)


def test_a_plant_that_shows_only_in_its_step_what_it_does_at_once_is_named():
    """With a gain of 2 the loop diverges from step to step, whatever the step."""

    def runs(step, gain=2.0):
        gains = gain / 0.2 * np.array([[-1.0, 1.0]])
        sides = at_once(np.array([[0.2]]), gains, answers_in_step=True)
        return Runs(Sides(*sides, STILL, 1.0), step)

    run, choice = choose_step(runs(0.01))
    assert "algebraic loop has a loop gain of 2" in run.verdict.reason
    assert len(choice.tried) == 1
    assert not run.verdict.trusted
    assert "algebraic" not in judged(runs(1e-3, gain=0.2), 0).verdict.reason


# how a run ends


def test_a_loop_that_diverges_stops_at_its_bound_and_one_that_cannot_go_on_says_when():
    plant, controller = parts(False)
    plant.A = np.array([[0.0, 1.0], [0.0, 40.0]])
    run = run_loop(Sides(plant, controller, STILL, 5.0, GAUSS_SEIDEL), STEP)
    bound = np.abs(outputs(run)[:-1]).max(), np.abs(outputs(run)[-1]).max()
    assert bound[0] <= UNKNOWN < bound[1]
    assert f"y1 exceeds its bound at t = {run.time[-1]:.6g} s" in run.stopped
    plant, controller = parts(False)
    move = plant.step

    def fails(t, h):
        if t > 0.49:
            raise StepFailed("no further")
        move(t, h)

    plant.step = fails
    run = run_loop(Sides(plant, controller, STILL, 1.0, GAUSS_SEIDEL), STEP)
    assert run.stopped == "no further (in the step from t = 0.5 s)"
    assert run.time[-1] == pytest.approx(0.5)
    plant, controller = parts(False)

    def writer(names):
        write = LinearSlave.writer(controller, names)

        def checked(values):
            if values[-1] < 0:
                raise StepFailed("no such set-point")
            write(values)

        return checked

    controller.writer = writer
    jumps = Reference(np.array([0.0, 0.5, 0.5, 2.0]), np.array([1.0, 1.0, -1.0, -1.0]))
    run = run_loop(Sides(plant, controller, jumps, 1.0, GAUSS_SEIDEL), STEP, look=False)
    assert run.stopped.startswith("no such set-point")
    assert run.time[-1] == pytest.approx(0.45)
    with pytest.raises(CouplingError, match="corrections need both FMUs to save"):
        Sides(*parts(False, can_save=False), STILL, 1.0, corrections=1)


def test_a_library_whose_records_differ_from_those_declared_here_is_not_used(monkeypatch):
    monkeypatch.setitem(compiled.records(), "Clock", np.dtype([("tick", float)]))
    with pytest.raises(ImportError, match="libmaster has other records"):
        compiled.library.__wrapped__()

"""One communication step of a plant and a controller, as compiled code.

What the couplings are is told in `coupling`. A *law* is one array here, in the order of the ports
that it is read from: m commands, their derivatives by n signals each, their own rates.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .fmi_calls import CALLS, move, put, release, restore, save, take
from .structs import VECTOR, compiled, copy, numbers, places

Vector = npt.NDArray[np.float64]

JACOBI, GAUSS_SEIDEL, TANGENT = range(3)
DIRECT, STEPPED, SAMPLED = range(3)
CHECKPOINT, CORRECTION, PROBE = range(3)  # what states are saved for
USES = 3

RAMP_SHARE, HOLD_SHARE = 2 / 3, 1 / 2
PROBE_PARTS = 64

CONTROLLER = np.dtype(
    [
        # inputs: n signals, references; outputs: m commands, then gains and rates if it reports
        ("calls", CALLS),
        ("m", np.int64),
        ("n", np.int64),
        ("answer", np.int64),
        ("reports", np.int64),
        ("saves", np.int64),
        ("nominal", VECTOR),  # of the signals
        ("ahead", VECTOR),  # commands after a step that cannot be taken back,
        ("is_ahead", np.int64),  # if it has done one
        ("moved", VECTOR),  # room for n signals,
        ("answered", VECTOR),  # and for m commands
    ]
)
"""A controller behind one question: what would you command at these signals?"""

LOOP = np.dtype(
    [
        # inputs: m commands, then gains, references, rates if it takes a law; outputs: all
        ("plant", CALLS),
        ("takes_law", np.int64),
        ("signals", VECTOR),  # which outputs the controller measures
        ("controller", CONTROLLER),
        ("coupling", np.int64),
        ("corrected", np.int64),
        ("averaged", np.int64),
        # what goes from step to step: outputs, last commands, and the law at the end of the last
        # step, which is where the next begins
        ("outputs", VECTOR),
        ("late", VECTOR),
        ("following", VECTOR),
        ("has_following", np.int64),
        # the same, kept to come back to
        ("kept_outputs", VECTOR),
        ("kept_late", VECTOR),
        ("kept_following", VECTOR),
        ("kept_has_following", np.int64),
        # what the last step did: interface defect as accepted; how far the correction moved each
        # output; share of the defect that was left, small if correcting converges fast, one or more
        # if the step is too long for it, NaN if nothing was corrected
        ("defect", VECTOR),
        ("effect", VECTOR),
        ("contraction", float),
        # room for one step
        ("start", VECTOR),
        ("end", VECTOR),
        ("mean", VECTOR),
        ("goal", VECTOR),
        ("law", VECTOR),
        ("applied", VECTOR),
        ("stepped", VECTOR),
        ("reached", VECTOR),
        ("command", VECTOR),
        ("first", VECTOR),
    ]
)
"""A plant and a controller that move together; made by `coupling.Loop`."""


@compiled
def set_inputs(controller: Any, signals: Vector, reference: Vector) -> None:
    """Give the controller signals and references."""
    given = numbers(controller.calls.given)
    n = len(signals)
    copy(signals, given[:n])
    copy(reference, given[n:])
    put(controller.calls, len(given))


@compiled
def read_commands(controller: Any, commands: Vector) -> None:
    """The commands as they stand, into `commands`."""
    take(controller.calls, controller.m)
    copy(numbers(controller.calls.taken)[: controller.m], commands)


@compiled
def command_at(controller: Any, signals: Vector, reference: Vector, commands: Vector) -> None:
    """Set the inputs and read the commands, into `commands`."""
    set_inputs(controller, signals, reference)
    read_commands(controller, commands)


@compiled
def _answer(
    controller: Any, t: float, h: float, at: Vector, reference: Vector, commands: Vector
) -> None:
    """The commands at these signals, at once or after a step from the state saved for probing."""
    set_inputs(controller, at, reference)
    if controller.answer != DIRECT:
        move(controller.calls, t, h)
    read_commands(controller, commands)
    if controller.answer != DIRECT:
        restore(controller.calls, PROBE)


@compiled
def probe_gains(
    controller: Any, t: float, h: float, signals: Vector, reference: Vector, law: Vector
) -> None:
    """Derivatives of the commands by the signals, by differences from the law's commands."""
    m, n = controller.m, controller.n
    nominal, command = numbers(controller.nominal), numbers(controller.answered)
    moved = numbers(controller.moved)
    copy(signals, moved)
    for j in range(n):
        moved[j] += 1e-7 * max(abs(signals[j]), 1e-3 * nominal[j])
        _answer(controller, t, h, moved, reference, command)
        for k in range(m):
            law[m + k * n + j] = (command[k] - law[k]) / (moved[j] - signals[j])
        moved[j] = signals[j]


@compiled
def law_at(
    controller: Any,
    t: float,
    h: float,
    signals: Vector,
    reference: Vector,
    probe: bool,
    law: Vector,
) -> None:
    """The commands, and with `probe` their derivatives, at the given signals, into `law`.

    Leaves the controller's state as it was, except that a controller that answers in its step
    and cannot be taken back has moved on to t + h; `advance` knows.
    """
    calls, m = controller.calls, controller.m
    if controller.answer == DIRECT and controller.reports and probe:
        set_inputs(controller, signals, reference)
        take(calls, len(law))
        copy(numbers(calls.taken), law)
        return
    law[m:] = 0.0
    if controller.answer != DIRECT:
        _stepped_law(controller, t, h, signals, reference, probe, law)
        return
    command_at(controller, signals, reference, law[:m])
    if not probe:
        return
    probe_gains(controller, t, h, signals, reference, law)
    if controller.saves:
        save(calls, PROBE)
        set_inputs(controller, signals, reference)
        # The slope at the start, not the secant: a secant meets the end of the step, and what the
        # command does in between would show nowhere.
        move(calls, t, h / PROBE_PARTS)
        rate = law[m * (1 + controller.n) :]
        command_at(controller, signals, reference, rate)
        for k in range(m):
            rate[k] = (rate[k] - law[k]) * PROBE_PARTS / h
        restore(calls, PROBE)
        release(calls, PROBE)
    set_inputs(controller, signals, reference)


@compiled
def _stepped_law(
    controller: Any,
    t: float,
    h: float,
    signals: Vector,
    reference: Vector,
    probe: bool,
    law: Vector,
) -> None:
    commands = law[: controller.m]
    if not controller.saves:
        ahead = numbers(controller.ahead)
        if not controller.is_ahead:
            set_inputs(controller, signals, reference)
            move(controller.calls, t, h)
            read_commands(controller, ahead)
            controller.is_ahead = 1
        copy(ahead, commands)
        return
    save(controller.calls, PROBE)
    _answer(controller, t, h, signals, reference, commands)
    if probe and controller.answer == STEPPED:
        probe_gains(controller, t, h, signals, reference, law)
    release(controller.calls, PROBE)


@compiled
def advance(controller: Any, t: float, h: float, signals: Vector, reference: Vector) -> None:
    """Move the controller from t to t + h with these signals held."""
    if controller.is_ahead:
        controller.is_ahead = 0
        return
    set_inputs(controller, signals, reference)
    move(controller.calls, t, h)


@compiled
def read_outputs(plant: Any, outputs: Vector) -> None:
    """All outputs of the plant, into `outputs`."""
    take(plant, len(outputs))
    copy(numbers(plant.taken), outputs)


@compiled
def _signals_of(loop: Any, outputs: Vector, signals: Vector) -> None:
    at = places(loop.signals)
    for k in range(len(at)):
        signals[k] = outputs[at[k]]


@compiled
def _step_plant(
    loop: Any, t: float, h: float, law: Vector, signals: Vector, outputs: Vector
) -> None:
    """Apply the law over a step, or hold the command where the plant takes no law."""
    given = numbers(loop.plant.given)
    m, n = loop.controller.m, loop.controller.n
    copy(law[:m], given[:m])
    if loop.takes_law:
        copy(law[m : m + m * n], given[m : m + m * n])
        for k in range(m):
            copy(signals, given[m + (m + k) * n : m + (m + k + 1) * n])
        copy(law[m + m * n :], given[m + 2 * m * n :])
    put(loop.plant, len(given))
    move(loop.plant, t, h)
    read_outputs(loop.plant, outputs)


@compiled
def command(loop: Any, t: float, h: float, reference: Vector, last: bool, commands: Vector) -> None:
    """The controller's true commands at the present signals, into `commands`.

    With `last`, no step beyond t is tried: a controller that answers in its step then gives the
    command that it ended with.
    """
    controller = loop.controller
    if last and controller.answer != DIRECT:
        read_commands(controller, commands)
    elif loop.has_following:
        copy(numbers(loop.following)[: controller.m], commands)
    else:
        signals, law = numbers(loop.start), numbers(loop.law)
        _signals_of(loop, numbers(loop.outputs), signals)
        law_at(controller, t, h, signals, reference, False, law)
        copy(law[: controller.m], commands)


@compiled
def step(loop: Any, t: float, h: float, before: Vector, after: Vector) -> None:
    """Move from t to t + h while the set-points go from `before` to `after`."""
    outputs, reached = numbers(loop.outputs), numbers(loop.reached)
    signals, law, applied = numbers(loop.start), numbers(loop.law), numbers(loop.applied)
    effect, first = numbers(loop.effect), numbers(loop.first)
    _signals_of(loop, outputs, signals)
    _law(loop, t, h, signals, before, after, law)
    copy(law, applied)
    if loop.coupling == JACOBI and not loop.corrected:
        copy(numbers(loop.late), applied[: loop.controller.m])
    if not loop.corrected:
        _move(loop, t, h, applied, signals, before, after, reached)
        _defect(loop, h, numbers(loop.defect))
        copy(reached, outputs)
        return
    _save(loop, CORRECTION)
    _move(loop, t, h, applied, signals, before, after, reached)
    _defect(loop, h, first)
    copy(reached, effect)
    _mend(loop, applied, first, h)
    _restore(loop, CORRECTION)
    _move(loop, t, h, applied, signals, before, after, reached)
    _release(loop, CORRECTION)
    _defect(loop, h, numbers(loop.defect))
    copy(reached, outputs)
    for k in range(len(outputs)):
        effect[k] = abs(outputs[k] - effect[k])
    loop.contraction = _contraction(loop, first, numbers(loop.defect))


@compiled
def _contraction(loop: Any, first: Vector, left: Vector) -> float:
    """By how much the controller's answer to a correction undoes or repeats the correction."""
    share = RAMP_SHARE if loop.takes_law else HOLD_SHARE
    size, rest = 0.0, 0.0
    for k in range(len(first)):
        size += first[k] ** 2
        rest += (left[k] - (1 - share) * first[k]) ** 2
    return math.sqrt(rest) / (share * math.sqrt(size)) if size > 0 else 0.0


@compiled
def _law(
    loop: Any, t: float, h: float, signals: Vector, before: Vector, after: Vector, law: Vector
) -> None:
    """The law at the start of a step, with the set-points' part in its rates."""
    controller, tangent = loop.controller, loop.coupling == TANGENT
    if loop.has_following:
        copy(numbers(loop.following), law)
    else:
        law_at(controller, t, h, signals, before, tangent, law)
    if not tangent or controller.answer != DIRECT:
        return
    moves = False
    for k in range(len(before)):
        moves = moves or after[k] != before[k]
    if moves:
        m, moved = controller.m, numbers(loop.command)
        command_at(controller, signals, after, moved)
        rate = law[m * (1 + controller.n) :]
        for k in range(m):
            rate[k] += (moved[k] - law[k]) / h


@compiled
def _mend(loop: Any, law: Vector, defect: Vector, h: float) -> None:
    """Make up for part of the defect in the law.

    The defect grows like the square of the time within the step, the ramp that mends it only
    like the time: two thirds of it give the plant the right impulse over the step. A plant that
    takes no ramp gets its mean.
    """
    m, n = loop.controller.m, loop.controller.n
    rate = law[m * (1 + n) :]
    for k in range(m):
        if loop.takes_law:
            rate[k] += RAMP_SHARE * defect[k] / h
        else:
            law[k] += HOLD_SHARE * defect[k]


@compiled
def _move(
    loop: Any,
    t: float,
    h: float,
    law: Vector,
    signals: Vector,
    before: Vector,
    after: Vector,
    outputs: Vector,
) -> None:
    """Plant, then controller: outputs into `outputs`, true command at the end into its place."""
    controller, late, true = loop.controller, numbers(loop.late), numbers(loop.command)
    end = numbers(loop.end)
    _step_plant(loop, t, h, law, signals, outputs)
    _signals_of(loop, outputs, end)
    if controller.answer != DIRECT:
        advance(controller, t, h, signals, before)
        read_commands(controller, late)
        copy(late, true)
        if controller.answer == STEPPED and controller.saves:
            stepped = numbers(loop.stepped)
            law_at(controller, t + h, h, end, after, False, stepped)
            copy(stepped[: controller.m], true)
        return
    if loop.averaged:
        mean, goal = numbers(loop.mean), numbers(loop.goal)
        for k in range(len(end)):
            mean[k] = 0.5 * (signals[k] + end[k])
        for k in range(len(goal)):
            goal[k] = 0.5 * (before[k] + after[k])
        advance(controller, t, h, mean, goal)
    elif loop.coupling == JACOBI and not loop.corrected:
        advance(controller, t, h, signals, before)
        read_commands(controller, late)
    else:
        advance(controller, t, h, end, after)
    following = numbers(loop.following)
    law_at(controller, t + h, h, end, after, loop.coupling == TANGENT, following)
    loop.has_following = 1
    copy(following[: controller.m], true)


@compiled
def _defect(loop: Any, h: float, defect: Vector) -> None:
    """True command less applied command, at the end of the step or where it is larger."""
    m, n = loop.controller.m, loop.controller.n
    law, applied, true = numbers(loop.law), numbers(loop.applied), numbers(loop.command)
    signals, end = numbers(loop.start), numbers(loop.end)
    for k in range(m):
        given = applied[k]
        if loop.takes_law:
            change = 0.0
            for j in range(n):
                change += applied[m + k * n + j] * (end[j] - signals[j])
            given = given + change + applied[m * (1 + n) + k] * h
        defect[k] = true[k] - given
        at_start = law[k] - applied[k]
        if not loop.corrected and abs(at_start) > abs(defect[k]):
            defect[k] = at_start


@compiled
def _save(loop: Any, use: int) -> None:
    save(loop.plant, use)
    save(loop.controller.calls, use)


@compiled
def _restore(loop: Any, use: int) -> None:
    restore(loop.plant, use)
    restore(loop.controller.calls, use)


@compiled
def _release(loop: Any, use: int) -> None:
    release(loop.plant, use)
    release(loop.controller.calls, use)


@compiled
def keep(loop: Any) -> None:
    """Keep everything that is needed to `take_back` later steps; `drop` it in the end."""
    _save(loop, CHECKPOINT)
    copy(numbers(loop.outputs), numbers(loop.kept_outputs))
    copy(numbers(loop.late), numbers(loop.kept_late))
    copy(numbers(loop.following), numbers(loop.kept_following))
    loop.kept_has_following = loop.has_following


@compiled
def take_back(loop: Any) -> None:
    """Go back to where `keep` was called, and drop what it kept."""
    loop.plant.status = loop.controller.calls.status = 0
    copy(numbers(loop.kept_outputs), numbers(loop.outputs))
    copy(numbers(loop.kept_late), numbers(loop.late))
    copy(numbers(loop.kept_following), numbers(loop.following))
    loop.has_following = loop.kept_has_following
    _restore(loop, CHECKPOINT)
    _release(loop, CHECKPOINT)


@compiled
def drop(loop: Any) -> None:
    """Forget what `keep` kept."""
    _release(loop, CHECKPOINT)


@compiled
def forget_step(loop: Any) -> None:
    """Let go of states that a failed step had saved."""
    _release(loop, CORRECTION)
    _release(loop, PROBE)

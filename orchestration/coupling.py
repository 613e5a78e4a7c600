"""One communication step of a plant and a controller, in each of the couplings.

``jacobi``
    Both move at once with what they had at the last communication point; signals arrive one step
    late, as in the plainest masters.
``gauss-seidel``
    One after the other, each with the newest signals, held over the step.
``tangent``
    The plant gets the controller's output with its derivatives and applies the feedback law inside
    its own solver (`fmus/feedback_law.py`).

Whatever the coupling, a step can be *corrected*: the **interface defect** is the controller's true
output at the end of the step less what the plant had applied there; the step is taken back and done
again from the controller's true output at the start, with a ramp that ends on the true value. How
far the plant's outputs move under the correction is the defect's effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from .participant import Participant, Reader, Writer
from .wiring import Wiring

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


RAMP_SHARE, HOLD_SHARE = 2 / 3, 1 / 2
PROBE_PARTS = 64


class Coupling(Enum):
    JACOBI = "jacobi"
    GAUSS_SEIDEL = "gauss-seidel"
    TANGENT = "tangent"
    MONOLITHIC = "monolithic"


class Answer(Enum):
    """When a controller's output follows its inputs."""

    DIRECT = "as soon as inputs are set"
    STEPPED = "in its step"
    SAMPLED = "at its sample instants"


@dataclass(frozen=True)
class Law:
    """Commands (m,), their derivatives by the signals (m, n), and their own rates (m,)."""

    command: Vector
    gain: Matrix
    rate: Vector


@dataclass(frozen=True)
class StepReport:
    """What one communication step did.

    Attributes
    ----------
    outputs : ndarray
        All plant outputs at the end of the step.
    defect : ndarray, shape (m,)
        Interface defect of the step as accepted, in the commands' units.
    effect : ndarray
        How far the correction moved each plant output; zeros where nothing was corrected.
    contraction : float
        Share of the defect that is left after one correction; small means that correcting
        converges fast, one or more that this step is too long for it.
    """

    outputs: Vector
    defect: Vector
    effect: Vector
    contraction: float


class ControllerSide:
    """A controller behind one question: what would you command at these signals?"""

    def __init__(self, participant: Participant, wiring: Wiring) -> None:
        self.participant = participant
        self.wiring = wiring
        self._write: Writer = participant.writer(
            [*(s for _, s in wiring.signals), *wiring.references]
        )
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        names = [c for c, _ in wiring.commands]
        self._read_command: Reader = participant.reader(names)
        ports = wiring.controller_ports()
        self._reports = wiring.reports_law
        law_names = [*names, *(g for p in ports for g in p.gains), *(p.rate for p in ports)]
        self._read_law: Reader = participant.reader(law_names if self._reports else names)
        self._nominal = np.array([participant.nominal(s) for _, s in wiring.signals])
        self.answer = Answer.DIRECT
        self._ahead: Law | None = None  # of a step already taken that cannot be taken back

    def _set(self, signals: Vector, reference: Vector) -> None:
        self._write(np.concatenate((signals, reference)))

    def find_answer(self, signals: Vector, reference: Vector) -> None:
        """Find out whether the output follows the inputs at once."""
        if self.participant.sample_time > 0:
            self.answer = Answer.SAMPLED
            return
        before = self.command_at(signals, reference)
        follows = self._probed(lambda at: self.command_at(at, reference), signals, before).any()
        self.command_at(signals, reference)
        if not follows:
            self.answer = Answer.STEPPED

    def _probed(
        self, answer: Callable[[Vector], Vector], signals: Vector, command: Vector
    ) -> Matrix:
        """Derivatives of an answer by the signals, by differences from `command` at `signals`."""
        gain = np.zeros((self.m, self.n))
        shift = 1e-7 * np.maximum(np.abs(signals), 1e-3 * self._nominal)
        for k in range(self.n):
            moved = signals.copy()
            moved[k] += shift[k]
            gain[:, k] = (answer(moved) - command) / (moved[k] - signals[k])
        return gain

    def command_at(self, signals: Vector, reference: Vector) -> Vector:
        """Set the inputs and read the commands."""
        self._set(signals, reference)
        return self._read_command()

    def last_command(self) -> Vector:
        """The commands as they stand, nothing newly set."""
        return self._read_command()

    def law_at(self, t: float, h: float, signals: Vector, reference: Vector, probe: bool) -> Law:
        """The commands, and with `probe` their derivatives, at the given signals.

        Leaves the controller's state as it was, except that a controller that answers in its step
        and cannot be taken back has moved on to t + h; `advance` knows.
        """
        if self.answer is not Answer.DIRECT:
            return self._stepped_law(t, h, signals, reference, probe)
        self._set(signals, reference)
        if self._reports and probe:
            values = self._read_law()
            gain = values[self.m : self.m * (1 + self.n)].reshape(self.m, self.n)
            return Law(values[: self.m], gain, values[self.m * (1 + self.n) :])
        command = self._read_command()
        gain, rate = np.zeros((self.m, self.n)), np.zeros(self.m)
        if probe:
            gain = self._probed(lambda at: self.command_at(at, reference), signals, command)
            if self.participant.can_save:
                state = self.participant.save()
                self.command_at(signals, reference)
                # The slope at the start, not the secant: a secant meets the end of the step, and
                # what the command does in between would show nowhere.
                self.participant.step(t, h / PROBE_PARTS)
                rate = (self.command_at(signals, reference) - command) * PROBE_PARTS / h
                self.participant.restore(state)
                self.participant.release(state)
            self.command_at(signals, reference)
        return Law(command, gain, rate)

    def _stepped_law(
        self, t: float, h: float, signals: Vector, reference: Vector, probe: bool
    ) -> Law:
        gain, rate = np.zeros((self.m, self.n)), np.zeros(self.m)
        if not self.participant.can_save:
            if self._ahead is None:
                self._set(signals, reference)
                self.participant.step(t, h)
                self._ahead = Law(self._read_command(), gain, rate)
            return self._ahead
        state = self.participant.save()

        def answer(at: Vector) -> Vector:
            self._set(at, reference)
            self.participant.step(t, h)
            command = self._read_command()
            self.participant.restore(state)
            return command

        command = answer(signals)
        if probe and self.answer is Answer.STEPPED:
            gain = self._probed(answer, signals, command)
        self.participant.release(state)
        return Law(command, gain, rate)

    def advance(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Move the controller from t to t + h with these signals held."""
        if self._ahead is not None:
            self._ahead = None
            return
        self._set(signals, reference)
        self.participant.step(t, h)


class PlantSide:
    """A plant behind one action: apply this law for a step."""

    def __init__(self, participant: Participant, wiring: Wiring) -> None:
        self.participant = participant
        self.accepts_law = wiring.accepts_law
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        names = [theirs for _, theirs in wiring.commands]
        ports = wiring.plant_ports()
        if self.accepts_law:
            names += [g for p in ports for g in p.gains]
            names += [r for p in ports for r in p.references]
            names += [p.rate for p in ports]
        self._write: Writer = participant.writer(names)
        self._read: Reader = participant.reader(participant.outputs)
        self._signals = [list(participant.outputs).index(s) for s, _ in wiring.signals]

    def outputs(self) -> Vector:
        return self._read()

    def signals_of(self, outputs: Vector) -> Vector:
        return outputs[self._signals]

    def step(self, t: float, h: float, law: Law, signals: Vector) -> Vector:
        """Apply the law over a step, or hold the command where the plant takes no law."""
        if self.accepts_law:
            self._write(
                np.concatenate([law.command, law.gain.ravel(), np.tile(signals, self.m), law.rate])
            )
        else:
            self._write(law.command)
        self.participant.step(t, h)
        return self._read()


class Loop:
    """A plant and a controller that move together.

    Parameters
    ----------
    plant, controller : Participant
        Initialized.
    coupling : Coupling
        Not monolithic.
    corrected : bool
        Whether every step is corrected once; needs both sides to save their states.
    averaged : bool
        Whether the controller's own states see the mean of the signals over the step, second order,
        or only one end's, as a plain master would have it.
    reference : ndarray
        Set-points at the start.
    """

    def __init__(
        self,
        plant: Participant,
        controller: Participant,
        wiring: Wiring,
        coupling: Coupling,
        corrected: bool,
        averaged: bool,
        reference: Vector,
    ) -> None:
        self.plant = PlantSide(plant, wiring)
        self.controller = ControllerSide(controller, wiring)
        self.coupling = coupling
        self.corrected = corrected
        self.averaged = averaged
        self.outputs = self.plant.outputs()
        self.controller.find_answer(self.plant.signals_of(self.outputs), reference)
        self._commands_late = self.controller.last_command()
        # the law at the end of the last step, which is where the next begins
        self._following: Law | None = None

    def command(self, t: float, h: float, reference: Vector, last: bool = False) -> Vector:
        """The controller's true command at the present signals.

        With `last`, no step beyond t is tried: a controller that answers in its step then gives
        the command that it ended with.
        """
        if last and self.controller.answer is not Answer.DIRECT:
            return self.controller.last_command()
        if self._following is not None:
            return self._following.command
        signals = self.plant.signals_of(self.outputs)
        return self.controller.law_at(t, h, signals, reference, probe=False).command

    def step(self, t: float, h: float, before: Vector, after: Vector) -> StepReport:
        """Move from t to t + h while the set-points go from `before` to `after`."""
        signals = self.plant.signals_of(self.outputs)
        law = self._law(t, h, signals, before, after)
        applied = law
        if self.coupling is Coupling.JACOBI and not self.corrected:
            applied = Law(self._commands_late, law.gain, law.rate)
        if not self.corrected:
            outputs, true_end = self._move(t, h, applied, signals, before, after)
            defect = self._defect(applied, signals, outputs, h, law, true_end)
            self.outputs = outputs
            return StepReport(outputs, defect, np.zeros_like(outputs), np.nan)
        states = self._save()
        try:
            first, first_end = self._move(t, h, applied, signals, before, after)
            first_defect = self._defect(applied, signals, first, h, law, first_end)
            mended = self._mended(applied, first_defect, h)
            self._restore(states)
            outputs, true_end = self._move(t, h, mended, signals, before, after)
        finally:
            self._release(states)
        left = self._defect(mended, signals, outputs, h, law, true_end)
        self.outputs = outputs
        return StepReport(
            outputs, left, np.abs(outputs - first), self._contraction(first_defect, left)
        )

    def _contraction(self, first: Vector, left: Vector) -> float:
        """By how much the controller's answer to a correction undoes or repeats the correction."""
        share = RAMP_SHARE if self.plant.accepts_law else HOLD_SHARE
        size = share * float(np.linalg.norm(first))
        return float(np.linalg.norm(left - (1 - share) * first)) / size if size > 0 else 0.0

    def checkpoint(self) -> Any:
        """Everything needed to `take_back` later steps; end with `drop` or `take_back`."""
        return self._save(), self.outputs, self._commands_late, self._following

    def take_back(self, checkpoint: Any) -> None:
        states, self.outputs, self._commands_late, self._following = checkpoint
        self._restore(states)
        self._release(states)

    def drop(self, checkpoint: Any) -> None:
        self._release(checkpoint[0])

    def _law(self, t: float, h: float, signals: Vector, before: Vector, after: Vector) -> Law:
        tangent = self.coupling is Coupling.TANGENT
        law = self._following or self.controller.law_at(t, h, signals, before, probe=tangent)
        if not tangent:
            return law
        if self.controller.answer is Answer.DIRECT and np.any(after != before):
            moved = self.controller.command_at(signals, after)
            return Law(law.command, law.gain, law.rate + (moved - law.command) / h)
        return law

    def _mended(self, law: Law, defect: Vector, h: float) -> Law:
        """The law with part of the defect made up for.

        The defect grows like the square of the time within the step, the ramp that mends it only
        like the time: two thirds of it give the plant the right impulse over the step. A plant that
        takes no ramp gets its mean.
        """
        if self.plant.accepts_law:
            return Law(law.command, law.gain, law.rate + RAMP_SHARE * defect / h)
        return Law(law.command + HOLD_SHARE * defect, law.gain, law.rate)

    def _move(
        self, t: float, h: float, law: Law, signals: Vector, before: Vector, after: Vector
    ) -> tuple[Vector, Vector]:
        """Plant, then controller; return the outputs and the true command at the end."""
        outputs = self.plant.step(t, h, law, signals)
        end = self.plant.signals_of(outputs)
        if self.controller.answer is not Answer.DIRECT:
            self.controller.advance(t, h, signals, before)
            self._commands_late = self.controller.last_command()
            if self.controller.answer is Answer.SAMPLED or not self.controller.participant.can_save:
                return outputs, self._commands_late
            return outputs, self.controller.law_at(t + h, h, end, after, probe=False).command
        if self.averaged:
            self.controller.advance(t, h, 0.5 * (signals + end), 0.5 * (before + after))
        elif self.coupling is Coupling.JACOBI and not self.corrected:
            self.controller.advance(t, h, signals, before)
            self._commands_late = self.controller.last_command()
        else:
            self.controller.advance(t, h, end, after)
        tangent = self.coupling is Coupling.TANGENT
        self._following = self.controller.law_at(t + h, h, end, after, probe=tangent)
        return outputs, self._following.command

    def _defect(
        self, applied: Law, signals: Vector, outputs: Vector, h: float, law: Law, true_end: Vector
    ) -> Vector:
        """True command less applied command, at the end of the step or where it is larger."""
        change = self.plant.signals_of(outputs) - signals
        end = applied.command.copy()
        if self.plant.accepts_law:
            end = end + applied.gain @ change + applied.rate * h
        at_end = true_end - end
        at_start = law.command - applied.command
        worst: Vector = np.where(np.abs(at_end) >= np.abs(at_start), at_end, at_start)
        return worst if not self.corrected else at_end

    def _save(self) -> tuple[Any, Any]:
        return self.plant.participant.save(), self.controller.participant.save()

    def _restore(self, states: tuple[Any, Any]) -> None:
        self.plant.participant.restore(states[0])
        self.controller.participant.restore(states[1])

    def _release(self, states: tuple[Any, Any]) -> None:
        self.plant.participant.release(states[0])
        self.controller.participant.release(states[1])

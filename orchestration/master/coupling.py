"""One communication step of a plant and a controller, in each of the couplings.

``jacobi``
    Both are stepped with the signals of the last communication point; signals arrive one step
    late, as in the simplest masters.
``gauss-seidel``
    One after the other, each with the newest signals, held over the step.
``interface-jacobian``
    The plant gets the controller's output with its derivatives and applies the feedback law inside
    its own solver (`fmus/feedback_law.py`): the interface-Jacobian coupling of Sicklinger et al.
    (2014) for a plant and a controller. Its second name on the command line is ``tangent``.

With any coupling, a step can be *corrected*: the **coupling residual** is the controller's true
output at the end of the step minus the value applied by the plant there; the step is repeated
from the controller's true output at the start, with a ramp that ends at the true value. The
change of the plant's outputs by the correction is the residual's effect. The step itself is
``c/coupling.c``; here are the records that it works on.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ...solver.arrays import Matrix, Vector
from ..fmu.fmu_instance import Instance, StepFailed
from ..fmu.wiring import Wiring
from .compiled import OWN_STEP, Bound, Guarded, Struct, ask, failure_of, struct
from .couplings import Coupling

CHUNK = 4096  # most steps between two checks of the elapsed time


class Answer(Enum):
    """When a controller's output responds to its inputs; in the order of ``c/controller.c``."""

    DIRECT = "as soon as inputs are set"
    STEPPED = "in its step"
    SAMPLED = "at its sample instants"


@dataclass(frozen=True)
class FeedbackLaw:
    """Commands (m,), their derivatives by the signals (m, n), and their own rates (m,)."""

    command: Vector
    gain: Matrix
    rate: Vector


def law_of(numbers: Vector, m: int, n: int) -> FeedbackLaw:
    """Split a law that is one array of compiled code, (m (2 + n),), into its parts, as views."""
    return FeedbackLaw(numbers[:m], numbers[m : m * (1 + n)].reshape(m, n), numbers[m * (1 + n) :])


class ControllerSide:
    """An initialized controller as a function: `m` commands for `n` given signals.

    With `signals` and `reference` at the start its feedthrough is tested; `side` is the record
    `Controller` to fill.
    """

    def __init__(
        self,
        instance: Instance,
        wiring: Wiring,
        signals: Vector,
        reference: Vector,
        side: Struct | None = None,
    ) -> None:
        self._side = side or struct("Controller")
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        inputs = [*(s for _, s in wiring.signals), *wiring.references]
        law = wiring.controller_law() if wiring.reports_law else []
        outputs = [*(c for c, _ in wiring.commands), *law, *wiring.others]
        self.bound = Bound(instance, inputs, outputs, self._side.part("calls"))
        self._side.set(
            m=self.m,
            n=self.n,
            others=len(wiring.others),
            group=wiring.network,
            reports=wiring.reports_law,
            saves=instance.can_save,
            varies=getattr(instance, "steps_vary", True),
            nominal=np.array([instance.nominal(s) for _, s in wiring.signals]),
            real=np.array([float(instance.is_real(name)) for name in inputs]),
            ahead=np.zeros(self.m),
            moved=np.zeros(self.n),
            answered=np.zeros(self.m),
        )
        self.answer = Answer.DIRECT
        if instance.sample_time > 0:
            self.answer = Answer.SAMPLED
        elif not self._follows(signals, reference):
            self.answer = Answer.STEPPED
        self._side.set(answer=[*Answer].index(self.answer))

    def _follows(self, signals: Vector, reference: Vector) -> bool:
        """Whether the output has direct feedthrough."""
        law = np.zeros(self.m * (2 + self.n))
        self._ask("command_at", signals, reference, law)
        self._ask("probe_gains", 0.0, 0.0, signals, reference, law)
        self._ask("set_inputs", signals, reference)
        return bool(law[self.m :].any())

    def _ask(self, function: str, *arguments: Vector | float) -> None:
        ask([self.bound], function, self._side, *arguments)

    def last_command(self) -> Vector:
        """The present commands, without new inputs."""
        commands = np.empty(self.m)
        self._ask("read_commands", commands)
        return commands

    def command_at(self, signals: Vector, reference: Vector) -> Vector:
        """Set the inputs and read the commands."""
        commands = np.empty(self.m)
        self._ask("command_at", signals, reference, commands)
        return commands

    def law_at(self, t: float, h: float, signals: Vector, reference: Vector) -> FeedbackLaw:
        """The commands and their derivatives at the given signals."""
        law = np.zeros(self.m * (2 + self.n))
        self._ask("law_at", t, h, signals, reference, True, law)
        return law_of(law, self.m, self.n)

    def advance(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Move the controller from t to t + h with these signals held."""
        self._ask("advance", t, h, signals, reference)


class CoupledPair:
    """A plant and a controller, both initialized, that move together, and what they have recorded.

    With `corrected`, every step is corrected once, which needs both sides to save their states.
    With `averaged`, the controller's own states use the mean of the signals over the step (second
    order), else the value at one end, as in a simple master. Each step of a co-run has so many
    `parts`; `reference` has the set-points at the start.
    """

    def __init__(
        self,
        plant: Instance,
        controller: Instance,
        wiring: Wiring,
        coupling: Coupling,
        corrected: bool,
        averaged: bool,
        reference: Vector,
        parts: int = 1,
    ) -> None:
        self.plant, self.controller = plant, controller
        self.corrected, self.averaged = corrected, averaged
        self.other_names = wiring.others
        self.failure = ""  # why it ended early; empty if it did not
        self.whole = struct("Loop")
        law = wiring.plant_law() if wiring.accepts_law else []
        names = [*(theirs for _, theirs in wiring.commands), *law]
        self._plant = Bound(plant, names, plant.outputs, self.whole.part("plant"))
        present = plant.reader(plant.outputs)()
        at = [list(plant.outputs).index(s) for s, _ in wiring.signals]
        side = self.whole.part("controller")
        self._side = ControllerSide(controller, wiring, present[at], reference, side)
        self.answer, m, n = self._side.answer, self._side.m, self._side.n
        self.given = self._side.last_command()  # before the controller has moved
        size, outputs = m * (2 + n), len(present)
        passed = np.concatenate([present, self.given, np.zeros(size)])
        self.outputs, self.late, following = np.split(passed, [outputs, outputs + m])
        rooms = {
            "residual command first": m,
            "start end mean": n,
            "law applied stepped": size,
            "effect reached": outputs,
            "kept": len(passed),
            "goal": len(reference),
            "ring": m * (m + 2),
        }
        made = {name: np.zeros(k) for names, k in rooms.items() for name in names.split()}
        self._room = np.empty((CHUNK, outputs + len(self.other_names)))
        self._guarded, own = Guarded(1, 0), 0
        if coupling.own:
            module, _, function = coupling.own.partition(":")
            change = getattr(importlib.import_module(module), function)
            applied = law_of(made["applied"], m, n)
            own = self._guarded.address(OWN_STEP, lambda h: change(applied, h))
        self.whole.set(
            **made,
            passed=passed,
            outputs=self.outputs,
            late=self.late,
            following=following,
            following_step=math.nan,
            takes_law=wiring.accepts_law,
            follows=any(map(plant.follows_at_once, plant.outputs)) and m > 0,
            commands=np.array([plant.nominal(theirs) for _, theirs in wiring.commands]),
            signals=np.array(at, dtype=np.int64),
            delayed=coupling.late and not corrected,
            tangent=coupling.law,
            own=own,
            corrected=corrected,
            averaged=averaged,
            contraction=math.nan,
            parts=parts,
            recorded=self._room,
            failed=math.nan,
        )
        self.rows: list[Matrix] = []

    def begin(self) -> None:
        """Record the start: the plant's outputs, then the controller's others."""
        others = self.controller.reader(self.other_names)() if self.other_names else np.empty(0)
        self.rows = [np.concatenate([self.outputs, others])[None]]

    def command(self, t: float, h: float, reference: Vector) -> Vector:
        """The controller's true command at the present signals."""
        commands = np.zeros(self._side.m)
        self._ask("command_now", t, h, reference, False, commands)
        return commands

    def answer_to(self, commands: Vector, h: float, reference: Vector) -> Vector:
        """The controller's commands after the plant has moved with these for the time h [s]."""
        answer = np.zeros(self._side.m)
        self._ask("answer_to", commands, h, reference, answer)
        return answer

    def _ask(self, function: str, *arguments: Vector | float) -> None:
        ask((self._plant, self._side.bound), function, self.whole, *arguments)

    def collect(self) -> None:
        """Keep what the last chunk recorded."""
        record = self.whole.record
        self.rows.append(self._room[: record.rows].copy())
        if not math.isnan(record.failed) and not self.failure:
            t = record.failed
            self.failure = f"the reference co-run loop failed at t = {t:.6g} s: {self.error()}"

    def failed(self) -> BaseException | None:
        """Error of the last failed call."""
        return self._guarded.error or failure_of(self._plant, self._side.bound)

    def error(self) -> StepFailed:
        """Return the loop's StepFailed; raise any other error, such as an interruption."""
        error = self.failed()
        assert error is not None
        if not isinstance(error, StepFailed):
            raise error
        return error

    def close(self) -> None:
        """Close both instances."""
        self.plant.close()
        self.controller.close()

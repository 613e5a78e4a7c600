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
change of the plant's outputs by the correction is the residual's effect.
"""

from __future__ import annotations

import ctypes
import importlib
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from ..fmu.fmu_instance import Instance
from ..fmu.wiring import Wiring
from . import compiled
from .compiled import ask
from .couplings import Coupling
from .fmi_calls import Bound, failure_of, raise_failures
from .structs import Struct, struct

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


class Answer(Enum):
    """When a controller's output responds to its inputs."""

    DIRECT = "as soon as inputs are set"
    STEPPED = "in its step"
    SAMPLED = "at its sample instants"


_ANSWERS = {
    Answer.DIRECT: compiled.DIRECT,
    Answer.STEPPED: compiled.STEPPED,
    Answer.SAMPLED: compiled.SAMPLED,
}


@dataclass(frozen=True)
class FeedbackLaw:
    """Commands (m,), their derivatives by the signals (m, n), and their own rates (m,)."""

    command: Vector
    gain: Matrix
    rate: Vector


def law_of(numbers: Vector, m: int, n: int) -> FeedbackLaw:
    """Split a law that is one array of compiled code, (m (2 + n),), into its parts, as views."""
    return FeedbackLaw(numbers[:m], numbers[m : m * (1 + n)].reshape(m, n), numbers[m * (1 + n) :])


class OwnStep:
    """A coupling's function that changes the law applied by the plant; compiled code calls it."""

    def __init__(self, place: str, law: FeedbackLaw) -> None:
        self.address = 0
        self.error: BaseException | None = None
        if not place:
            return
        module, _, function = place.partition(":")
        change = getattr(importlib.import_module(module), function)

        def call(h: float) -> int:
            try:
                change(law, h)
            except BaseException as error:  # also interruptions: raised after the compiled code
                self.error = error
                return 0
            return 1

        self._called = compiled.OWN_STEP(call)
        self.address = ctypes.cast(self._called, ctypes.c_void_p).value or 0


class ControllerSide:
    """A controller as a function: commands for given signals.

    The instance is initialized; with `signals` and `reference` at the start its feedthrough is
    tested. `side` is a struct of the kind `compiled.CONTROLLER` to fill. It has `m` commands, `n`
    signals, and the way of its `answer`.
    """

    def __init__(
        self,
        instance: Instance,
        wiring: Wiring,
        signals: Vector,
        reference: Vector,
        side: Struct | None = None,
    ) -> None:
        self._side = side or struct(compiled.CONTROLLER)
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        inputs = [*(s for _, s in wiring.signals), *wiring.references]
        law = wiring.controller_law() if wiring.reports_law else []
        outputs = [*(c for c, _ in wiring.commands), *law, *wiring.others]
        calls = self._side.part("calls")
        self.bound = Bound(instance, inputs, outputs, compiled.USES, calls)
        self.answer = Answer.SAMPLED if instance.sample_time > 0 else Answer.DIRECT
        self._side.set(
            m=self.m,
            n=self.n,
            others=len(wiring.others),
            group=wiring.network,
            answer=_ANSWERS[self.answer],
            reports=wiring.reports_law,
            saves=instance.can_save,
            varies=getattr(instance, "steps_vary", True),
            nominal=np.array([instance.nominal(s) for _, s in wiring.signals]),
            real=np.array([float(instance.is_real(name)) for name in inputs]),
            ahead=np.zeros(self.m),
            moved=np.zeros(self.n),
            answered=np.zeros(self.m),
        )
        if self.answer is Answer.DIRECT and not self._follows(signals, reference):
            self.answer = Answer.STEPPED
            self._side.set(answer=compiled.STEPPED)

    def _follows(self, signals: Vector, reference: Vector) -> bool:
        """Whether the output has direct feedthrough."""
        law = self._empty_law()
        with raise_failures(self.bound):
            ask("command_at", self._side, signals, reference, law[: self.m])
            ask("probe_gains", self._side, 0.0, 0.0, signals, reference, law)
            ask("set_inputs", self._side, signals, reference)
        return bool(law[self.m :].any())

    def _empty_law(self) -> Vector:
        return np.zeros(self.m * (2 + self.n))

    def last_command(self) -> Vector:
        """The present commands, without new inputs."""
        commands = np.empty(self.m)
        with raise_failures(self.bound):
            ask("read_commands", self._side, commands)
        return commands

    def command_at(self, signals: Vector, reference: Vector) -> Vector:
        """Set the inputs and read the commands."""
        commands = np.empty(self.m)
        with raise_failures(self.bound):
            ask("command_at", self._side, signals, reference, commands)
        return commands

    def law_at(
        self, t: float, h: float, signals: Vector, reference: Vector, probe: bool
    ) -> FeedbackLaw:
        """The commands, and with `probe` their derivatives, at the given signals."""
        law = self._empty_law()
        with raise_failures(self.bound):
            ask("law_at", self._side, t, h, signals, reference, probe, law)
        return law_of(law, self.m, self.n)

    def advance(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Move the controller from t to t + h with these signals held."""
        with raise_failures(self.bound):
            ask("advance", self._side, t, h, signals, reference)


class CoupledPair:
    """A plant and a controller that move together.

    Both are initialized; `reference` has the set-points at the start, `given` the commands there,
    before the controller moves. If `corrected`, every step is corrected once, which needs both
    sides to save their states. If `averaged`, the controller's own states use the mean of the
    signals over the step (second order), else the value at one end, as in a simple master.
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
        whole: Struct,
    ) -> None:
        self.plant, self.controller = plant, controller
        self.corrected, self.averaged = corrected, averaged
        self._whole, self.wiring, self.other_names = whole, wiring, wiring.others
        law = wiring.plant_law() if wiring.accepts_law else []
        names = [*(theirs for _, theirs in wiring.commands), *law]
        calls = self._whole.part("plant")
        self._bound = Bound(plant, names, plant.outputs, compiled.USES, calls)
        outputs = np.empty(len(plant.outputs))
        with raise_failures(self._bound):
            ask("read_outputs", calls, outputs)
        at = [list(plant.outputs).index(s) for s, _ in wiring.signals]
        self._side = ControllerSide(
            controller, wiring, outputs[at], reference, self._whole.part("controller")
        )
        self.answer = self._side.answer
        self.given = self._side.last_command()
        m, n = self._side.m, self._side.n
        self.outputs = outputs.copy()
        self._whole.set(
            takes_law=wiring.accepts_law,
            follows=any(map(plant.follows_at_once, plant.outputs)) and m > 0,
            commands=np.array([plant.nominal(theirs) for _, theirs in wiring.commands]),
            ring=np.zeros(m * (m + 2)),
            signals=np.array(at, dtype=np.int64),
            delayed=coupling.late,
            tangent=coupling.law,
            corrected=corrected,
            averaged=averaged,
            outputs=self.outputs,
            late=self.given.copy(),
            contraction=np.nan,
        )
        self._whole.set(
            **{name: np.zeros(m) for name in ("kept_late", "residual", "command", "first")}
        )
        self._whole.set(**{name: np.zeros(n) for name in ("start", "end", "mean")})
        laws = ("following", "kept_following", "law", "stepped")
        self._whole.set(**{name: np.zeros(m * (2 + n)) for name in laws})
        applied = np.zeros(m * (2 + n))
        self._own = OwnStep(coupling.own, law_of(applied, m, n))
        self._whole.set(applied=applied, own=self._own.address)
        rooms = ("kept_outputs", "effect", "reached")
        self._whole.set(**{name: np.zeros(len(outputs)) for name in rooms})
        self._whole.set(goal=np.zeros(len(reference)))

    def others(self) -> Vector:
        """Present values of the controller's outputs that are not commands."""
        return self.controller.reader(self.other_names)() if self.other_names else np.empty(0)

    @property
    def unsolved(self) -> int:
        """Communication points at which an algebraic loop found no solution."""
        return int(self._whole.record.unsolved)

    def begin_with_first_command(self) -> None:
        """Use the controller's output in the first step instead of a start value."""
        self._whole.set(late=np.full(self._side.m, np.nan))

    def command(self, t: float, h: float, reference: Vector) -> Vector:
        """The controller's true command at the present signals."""
        commands = np.zeros(self._side.m)
        with raise_failures(self._bound, self._side.bound):
            ask("command", self._whole, t, h, reference, False, commands)
        return commands

    def failure(self) -> BaseException | None:
        """Error of the last failed call."""
        return self._own.error or failure_of(self._bound, self._side.bound)

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

import importlib
import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from ..fmu.fmu_instance import Instance, StepFailed
from ..fmu.wiring import Wiring
from .compiled import OWN_STEP, USES, Guarded, Struct, ask, struct
from .couplings import Coupling
from .fmi_calls import Bound, failure_of, raise_failures

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

CHUNK = 4096  # most steps between two checks of the elapsed time


class Answer(Enum):
    """When a controller's output responds to its inputs; in the order of ``c/coupling.c``."""

    DIRECT = "as soon as inputs are set"
    STEPPED = "in its step"
    SAMPLED = "at its sample instants"

    @property
    def number(self) -> int:
        return [*Answer].index(self)


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
    """A controller as a function: commands for given signals.

    The instance is initialized; with `signals` and `reference` at the start its feedthrough is
    tested. `side` is a record `Controller` to fill. It has `m` commands, `n` signals, and the way
    of its `answer`.
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
        self.bound = Bound(instance, inputs, outputs, USES, self._side.part("calls"))
        self.answer = Answer.SAMPLED if instance.sample_time > 0 else Answer.DIRECT
        self._side.set(
            m=self.m,
            n=self.n,
            others=len(wiring.others),
            group=wiring.network,
            answer=self.answer.number,
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
            self._side.set(answer=self.answer.number)

    def _follows(self, signals: Vector, reference: Vector) -> bool:
        """Whether the output has direct feedthrough."""
        law = self._empty_law()
        self._ask("command_at", signals, reference, law[: self.m])
        self._ask("probe_gains", 0.0, 0.0, signals, reference, law)
        self._ask("set_inputs", signals, reference)
        return bool(law[self.m :].any())

    def _empty_law(self) -> Vector:
        return np.zeros(self.m * (2 + self.n))

    def _ask(self, function: str, *arguments: Vector | float) -> None:
        with raise_failures(self.bound):
            ask(function, self._side, *arguments)

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

    def law_at(
        self, t: float, h: float, signals: Vector, reference: Vector, probe: bool
    ) -> FeedbackLaw:
        """The commands, and with `probe` their derivatives, at the given signals."""
        law = self._empty_law()
        self._ask("law_at", t, h, signals, reference, probe, law)
        return law_of(law, self.m, self.n)

    def advance(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Move the controller from t to t + h with these signals held."""
        self._ask("advance", t, h, signals, reference)


class CoupledPair:
    """A plant and a controller that move together, and what their steps have recorded.

    Parameters
    ----------
    plant, controller : Instance
        Both initialized.
    wiring : Wiring
    coupling : Coupling
    corrected : bool
        Whether every step is corrected once, which needs both sides to save their states.
    averaged : bool
        Whether the controller's own states use the mean of the signals over the step (second
        order), else the value at one end, as in a simple master.
    reference : ndarray
        The set-points at the start.
    parts : int
        Of each step, as a reference co-run.

    Attributes
    ----------
    whole : Struct
        The record `Pair`.
    outputs : ndarray
        The plant's, at present.
    given : ndarray
        The commands before the controller has moved.
    rows : list of ndarray
        The plant's outputs, then the controller's others, at communication points.
    failure : str
        Why a reference co-run ended early; empty if it did not.
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
        self.plant, self.controller, self.wiring = plant, controller, wiring
        self.corrected, self.averaged = corrected, averaged
        self.other_names, self.failure = wiring.others, ""
        self.whole = struct("Pair")
        self._loop = self.whole.part("loop")
        law = wiring.plant_law() if wiring.accepts_law else []
        names = [*(theirs for _, theirs in wiring.commands), *law]
        calls = self._loop.part("plant")
        self._bound = Bound(plant, names, plant.outputs, USES, calls)
        self.outputs = np.empty(len(plant.outputs))
        with raise_failures(self._bound):
            ask("read_outputs", calls, self.outputs)
        at = [list(plant.outputs).index(s) for s, _ in wiring.signals]
        self._side = ControllerSide(
            controller, wiring, self.outputs[at], reference, self._loop.part("controller")
        )
        self.answer = self._side.answer
        self.given = self._side.last_command()
        m, n = self._side.m, self._side.n
        self._loop.set(
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
        applied = np.zeros(m * (2 + n))
        self._guarded = Guarded(1, 0)
        self._loop.set(applied=applied, own=self._own_step(coupling, law_of(applied, m, n)))
        for size, rooms in (
            (m, "kept_late residual command first"),
            (n, "start end mean"),
            (m * (2 + n), "following kept_following law stepped"),
            (len(self.outputs), "kept_outputs effect reached"),
            (len(reference), "goal"),
        ):
            self._loop.set(**{name: np.zeros(size) for name in rooms.split()})
        self._room = np.empty((CHUNK, len(self.outputs) + len(self.other_names)))
        self.whole.set(parts=parts, recorded=self._room, failed=math.nan)
        self.rows = [np.concatenate([self.outputs, self._others()])[None]]

    def _own_step(self, coupling: Coupling, law: FeedbackLaw) -> int:
        """Address of the coupling's function that changes the applied law; 0 if it has none."""
        if not coupling.own:
            return 0
        module, _, function = coupling.own.partition(":")
        change = getattr(importlib.import_module(module), function)
        return self._guarded.address(OWN_STEP, lambda h: change(law, h))

    def _others(self) -> Vector:
        """Present values of the controller's outputs that are not commands."""
        return self.controller.reader(self.other_names)() if self.other_names else np.empty(0)

    @property
    def record(self) -> Any:
        """The record `Pair`, as compiled code sees it."""
        return self.whole.record

    @property
    def unsolved(self) -> int:
        """Communication points at which an algebraic loop found no solution."""
        return int(self._loop.record.unsolved)

    @property
    def safety(self) -> float:
        """Factor on the first estimate: 1 if the run is better than its co-run, else 2."""
        return 1.0 if self.corrected and self.averaged else 2.0

    def begin(self) -> None:
        """Read the controller's other outputs at the start again."""
        self.rows[0][0, len(self.outputs) :] = self._others()

    def begin_with_first_command(self) -> None:
        """Use the controller's output in the first step instead of a start value."""
        self._loop.set(late=np.full(self._side.m, np.nan))

    def command(self, t: float, h: float, reference: Vector) -> Vector:
        """The controller's true command at the present signals."""
        commands = np.zeros(self._side.m)
        with raise_failures(self._bound, self._side.bound):
            ask("command_now", self._loop, t, h, reference, False, commands)
        return commands

    def collect(self) -> None:
        """Keep what the last chunk recorded."""
        self.rows.append(self._room[: self.record.rows].copy())
        if not math.isnan(self.record.failed) and not self.failure:
            t = self.record.failed
            self.failure = f"the reference co-run loop failed at t = {t:.6g} s: {self.error()}"

    def failed(self) -> BaseException | None:
        """Error of the last failed call."""
        return self._guarded.error or failure_of(self._bound, self._side.bound)

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

"""One communication step of a plant and a controller, in each of the couplings.

``jacobi``
    Both are stepped with the signals of the last communication point; signals arrive one step
    late, as in the simplest masters.
``gauss-seidel``
    One after the other, each with the newest signals, held over the step.
``interface-jacobian``
    The plant gets the controller's output with its derivatives and applies the feedback law inside
    its own solver (`fmus/feedback_law.py`): the interface-Jacobian coupling of Sicklinger et al.
    (2014) for a plant and a controller.

With any coupling, a step can be *corrected*: the **coupling residual** is the controller's true
output at the end of the step minus the value applied by the plant there; the step is repeated
from the controller's true output at the start, with a ramp that ends at the true value. The
change of the plant's outputs by the correction is the residual's effect. The step itself is
``c/coupling.c``; here are the records that it works on.
"""

from __future__ import annotations

import math
from enum import IntEnum
from pkgutil import resolve_name
from typing import NamedTuple

import numpy as np

from ...solver.arrays import Matrix, Vector
from ..fmu.compiled import OWN_STEP, Bound, Guarded, Struct, ask, failure_of, struct
from ..fmu.fmu_instance import Instance, StepFailed
from ..fmu.wiring import Wiring
from .couplings import Coupling

CHUNK = 4096  # most steps between two checks of the elapsed time


class Answer(IntEnum):
    """When a controller's output responds to its inputs, as in ``c/controller.c``."""

    DIRECT, STEPPED, SAMPLED = range(3)  # as soon as they are set, in its step, at its samples


class FeedbackLaw(NamedTuple):
    """Commands (m,), their derivatives by the signals (m, n), and their own rates (m,)."""

    command: Vector
    gain: Matrix
    rate: Vector


class ControllerSide:
    """An initialized controller as a function: `m` commands for `n` given signals.

    With `signals` and `reference` at the start its feedthrough is tested; `side` is its record, a
    `Controller`.
    """

    def __init__(
        self, instance: Instance, wiring: Wiring, signals: Vector, reference: Vector, side: Struct
    ) -> None:
        self._side = side
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        inputs = [*(s for _, s in wiring.signals), *wiring.references]
        law = wiring.controller_law() if wiring.reports_law else []
        outputs = [*(c for c, _ in wiring.commands), *law, *wiring.others]
        self.bound = Bound(instance, inputs, outputs, self._side.part("calls"))
        side.set(m=self.m, n=self.n, others=len(wiring.others), group=wiring.network)
        side.set(reports=wiring.reports_law, saves=instance.can_save)
        side.set(varies=getattr(instance, "steps_vary", True), tried=np.zeros(2 + len(inputs)))
        side.set(nominal=np.array([instance.nominal(s) for _, s in wiring.signals]))
        side.set(real=np.array([float(instance.is_real(name)) for name in inputs]))
        side.set(ahead=np.zeros(self.m), answered=np.zeros(self.m), moved=np.zeros(self.n))
        self.answer = Answer.DIRECT
        if instance.sample_time > 0:
            self.answer = Answer.SAMPLED
        elif not self._follows(signals, reference):
            self.answer = Answer.STEPPED
        self._side.set(answer=self.answer)

    def _follows(self, signals: Vector, reference: Vector) -> bool:
        """Whether the output has direct feedthrough."""
        law = np.zeros(self.m * (2 + self.n))
        self.ask("command_at", signals, reference, law)
        self.ask("probe_gains", 0.0, 0.0, signals, reference, law)
        self.ask("set_inputs", signals, reference)
        return bool(law[self.m :].any())

    def ask(self, function: str, *arguments: Vector | float) -> None:
        """Call a function ``master_...`` of ``c/controller.c``."""
        ask([self.bound], function, self._side, *arguments)


class CoupledPair:
    """A plant and a controller, both initialized, that move together, and what they have recorded.

    With `corrected`, every step is corrected once, which needs both sides to save their states.
    With `averaged`, the controller's own states use the mean of the signals over the step (second
    order), else the value at one end, as in a simple master. `reference` has the set-points at the
    start.
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
    ) -> None:
        self.plant, self.controller = plant, controller
        self.corrected = corrected
        self.other_names = wiring.others
        self.failure = ""  # why it ended early; empty if it did not
        self.whole = struct("Loop")
        names = [theirs for _, theirs in wiring.commands]
        names += wiring.plant_law() if wiring.accepts_law else []
        self._plant = Bound(plant, names, plant.outputs, self.whole.part("plant"))
        self.outputs = np.array(plant.reader(plant.outputs)())  # at present
        at = [list(plant.outputs).index(s) for s, _ in wiring.signals]
        side = self.whole.part("controller")
        self._side = ControllerSide(controller, wiring, self.outputs[at], reference, side)
        self.answer, m, n = self._side.answer, self._side.m, self._side.n
        # the commands before the controller has moved
        self.given = np.array(controller.reader([u for u, _ in wiring.commands])())
        self.late = self.given.copy()
        outputs = len(self.outputs)
        rooms = {"start end mean": n, "residual command first": m, "ring": m * (m + 2)}
        rooms |= {"effect reached": outputs, "following law applied": m * (2 + n)}
        made = {name: np.zeros(k) for names, k in rooms.items() for name in names.split()}
        self._room = np.empty((CHUNK, outputs + len(self.other_names)))
        self._guarded, own = Guarded(), 0
        if coupling.own:
            change = resolve_name(coupling.own)
            command, gain, rate = np.split(made["applied"], [m, m * (1 + n)])
            law = FeedbackLaw(command, gain.reshape(m, n), rate)
            own = self._guarded.address(OWN_STEP, lambda h: change(law, h))
        self.whole.set(**made, outputs=self.outputs, late=self.late, recorded=self._room)
        self.whole.set(following_step=math.nan, contraction=math.nan, failed=math.nan)
        self.whole.set(tangent=coupling.law, delayed=coupling.late and not corrected, own=own)
        self.whole.set(takes_law=wiring.accepts_law, corrected=corrected, averaged=averaged)
        self.whole.set(follows=any(map(plant.follows_at_once, plant.outputs)) and m > 0)
        self.whole.set(commands=np.array([plant.nominal(u) for _, u in wiring.commands]))
        self.whole.set(signals=np.array(at, dtype=np.int64), goal=np.zeros(len(reference)))
        self.rows: list[Matrix] = []

    def begin(self) -> None:
        """Record the start: the plant's outputs, then the controller's others."""
        others = self.controller.reader(self.other_names)() if self.other_names else np.empty(0)
        self.rows = [np.concatenate([self.outputs, others])[None]]

    def commands(self, function: str, *arguments: Vector | float) -> Vector:
        """The commands that a function ``master_...`` of ``c/coupling.c`` gives, shape (m,)."""
        found = np.zeros(self._side.m)
        ask((self._plant, self._side.bound), function, self.whole, *arguments, found)
        return found

    def collect(self) -> None:
        """Keep what the last chunk recorded."""
        record = self.whole.record
        self.rows.append(self._room[: record.rows].copy())
        if not math.isnan(record.failed) and not self.failure:
            t = record.failed
            self.failure = f"the reference co-run loop failed at t = {t:.6g} s: {self.error()}"

    def error(self) -> StepFailed:
        """Return the loop's StepFailed; raise any other error, such as an interruption."""
        error = self._guarded.error or failure_of(self._plant, self._side.bound)
        assert error is not None
        if not isinstance(error, StepFailed):
            raise error
        return error

    def close(self) -> None:
        """Close both instances."""
        self.plant.close()
        self.controller.close()

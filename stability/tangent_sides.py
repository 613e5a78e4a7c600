"""One side of a run with tangents: an FMU with tangent ports, or a controller that is probed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from ..fmus.ports import FRAME, TRACE, is_tangent_port, set_port, tangent_port, tangent_states
from ..orchestration.fmu.compiled import Bound, Struct, struct
from ..orchestration.fmu.fmu_instance import Instance, Reader, StepFailed, Stepped, Writer
from ..orchestration.fmu.wiring import Wiring
from ..orchestration.master.coupling import Answer, ControllerSide
from ..solver.arrays import Vector
from ..solver.errors import FmuError

SHIFT = 1e-4  # of a signal's nominal value, to measure how it moves a controller's state
RELATIVE = 3e-4  # share of the growth that is allowed in addition to the accuracy


def ordinary(instance: Instance) -> Instance:
    """The name and the ordinary ports of an FMU instance, for wiring."""
    states, _ = tangent_states(list(getattr(instance, "parameters", [])))

    def names(ports: Sequence[str]) -> list[str]:
        return [p for p in ports if not is_tangent_port(p, {*ports, *states})]

    inputs, outputs = names(instance.inputs), names(instance.outputs)
    return cast("Instance", SimpleNamespace(name=instance.name, inputs=inputs, outputs=outputs))


class Side:
    """One FMU with tangents: its states, and what is set and read."""

    def __init__(self, instance: Stepped) -> None:
        self.instance = self.called = instance
        parameters: list[str] = list(getattr(instance, "parameters", []))
        self.states, self.tangents = tangent_states(parameters)

    def bind(
        self,
        side: Struct,
        inputs: Sequence[str],
        moved: Sequence[str],
        outputs: Sequence[str],
        count: int,
    ) -> tuple[Bound, Bound]:
        """Fill its record; `moved` are its inputs that have tangents, which follow all inputs."""
        own = [tangent_port(s, k + 1) for k in range(count) for s in self.states]
        given, taken = (
            [tangent_port(n, k + 1) for k in range(count) for n in names]
            for names in (moved, outputs)
        )
        side.set(states=len(self.states))
        frame = [*map(set_port, own), FRAME] if own else []
        shown = [*own, TRACE] if own else []
        calls, frames = side.part("calls"), side.part("frames")
        return (
            Bound(self.called, [*inputs, *given], [*outputs, *taken], calls),
            Bound(self.called, frame, shown, frames),
        )


class ProbedController(Side):
    """A controller without tangents, probed by differences, and called as if it had them.

    Its gains come from its law ports, or from differences; their change along a tangent is not
    known. One of its own states can be followed, represented by its contribution to the command, in
    the command's unit. How signals move it and how it decays is measured at every step.
    """

    def __init__(self, instance: Stepped, wiring: Wiring) -> None:
        self.instance, self.called = instance, cast("Stepped", self)
        self.wiring = wiring
        self.states: list[str] = []
        self.tangents = 0
        self.remarks: list[str] = []
        self._added = np.zeros(1)  # contribution to the command, along each tangent
        self._driven, self._fades = np.zeros(0), 0.0  # per second, as last measured

    def look(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Find out when it responds and whether it has a state; it must be initialized."""
        self.side = ControllerSide(
            self.instance, self.wiring, signals, reference, struct("Controller")
        )
        self._t, self._h = t, h
        self._ends = len(signals), len(signals) + len(reference)
        name = self.instance.name
        if self.side.answer is not Answer.DIRECT:
            raise FmuError(
                f"{name} answers in its step or at its samples; tangents need a controller with "
                "direct feedthrough: compute its output when it is read, or give its "
                "equations as FILE.py:FUNCTION"
            )
        if self.side.m != 1:
            raise FmuError(f"{name} has {self.side.m} commands; expected one for probing")
        responses, fading = self._response(t, h, signals, reference)
        if np.any(responses):
            self.states = [f"{name}: the part of its state in {self.wiring.commands[0][0]}"]
            self._note_rates(h, responses, fading)
            slow, fast = float(np.min(fading)), float(np.max(fading))
            if fast - slow > 1e-3 * max(abs(slow), abs(fast)):
                self.remarks.append(
                    "its rates for different signals differ, so it has more than "
                    "one state: only one can be probed and the others are ignored"
                )

    def writer(self, names: Sequence[str]) -> Writer:
        def write(values: Vector) -> None:
            if FRAME in names:
                self._added = values[:-1]
                return
            signals, self._reference, moved = np.split(values, self._ends)
            self._signals = np.vstack([signals, moved.reshape(-1, self.side.n)])

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        return self._frame if TRACE in names else self._law

    def _frame(self) -> Vector:
        return np.append(self._added, math.nan)  # its trace is not known

    def _law(self) -> Vector:
        signals, n = self._signals, self.side.n
        out = np.zeros((len(signals), 2 + n))
        self.side.ask("law_at", self._t, self._h, signals[0], self._reference, True, out[0])
        out[1:, 0] = signals[1:] @ out[0, 1 : 1 + n] + self._added
        if self.states:  # change of the state within the step, by the rates from the last step
            out[1:, 1 + n] = self._fades * self._added + signals[1:] @ self._driven
        return out.ravel()

    def step(self, t: float, h: float) -> None:
        signals = self._signals
        if self.states:
            responses, fading = self._response(t, h, signals[0], self._reference)
            if not len(fading):
                raise StepFailed(
                    f"{self.instance.name}: its state is no longer visible in the output"
                )
            strongest = self._note_rates(h, responses, fading)
            self._added = strongest * self._added + signals[1:] @ responses
        self.side.ask("advance", t, h, signals[0], self._reference)
        self._t, self._h = t + h, h

    def save(self) -> Any:
        return self.instance.save(), self._added, self._t

    def restore(self, state: Any) -> None:
        saved, self._added, self._t = state
        self.instance.restore(saved)

    def release(self, state: Any) -> None:
        self.instance.release(state[0])

    def _note_rates(self, h: float, responses: Vector, fading: Vector) -> float:
        """Keep the state's rates; return the share of the state that is left after a step."""
        strongest = float(fading[np.argmax(np.abs(responses[responses != 0.0]))])
        self._driven = responses / h
        self._fades = math.log(strongest) / h if strongest > 0.0 else 0.0
        return strongest

    def _response(
        self, t: float, h: float, signals: Vector, reference: Vector
    ) -> tuple[Vector, Vector]:
        """Effect of moving each signal over a step on the command after it, shape (n,).

        The second array has the shares that are left after one more step, of each signal with an
        effect.
        """
        state = self.instance.save()

        def command(moved: Vector, steps: int) -> float:
            for k in range(steps):
                self.side.ask("advance", t + k * h, h, moved if k == 0 else signals, reference)
            value = np.empty(1)
            self.side.ask("command_at", signals, reference, value)
            self.instance.restore(state)
            return float(value[0])

        nominal = np.array([self.instance.nominal(s) for _, s in self.wiring.signals])
        shift = SHIFT * nominal
        response, fading = np.zeros(len(signals)), []
        base = command(signals, 1), command(signals, 2)
        for k in range(len(signals)):
            ends = []
            for n in (1, 2):
                moved = signals.copy()
                moved[k] += shift[k]
                up = command(moved, n)
                ends.append(up - base[n - 1])
            response[k] = ends[0] / shift[k]
            if ends[0] != 0.0:
                fading.append(ends[1] / ends[0])
        self.instance.release(state)
        return response, np.array(fading)

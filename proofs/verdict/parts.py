"""Two sides of a loop whose own solutions are exact, so that all errors are coupling errors.

Also what is kept of a run, and how many of many runs are right, wrong, and trusted.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from runner import Row, upper
from scipy.linalg import expm

from ballscrew.fmus.feedback_law import STEP_START
from ballscrew.orchestration.fmu.fmu_instance import StepFailed, Stepped
from ballscrew.solver.core import DONE
from ballscrew.solver.kernel import MAX_STEPS, Kernel, Model, describe_failure

Vector = np.ndarray

WRONG, RIGHT = 0.01, 0.01 / 3
KNOWN = 1e-2  # largest difference of two references, over the tolerance
WITHIN = 1e-10  # tolerance of a component
ROUND_OFF = 1e-9


class Part(Stepped):
    """What the master asks of an instance; `w` and `y` are its inputs and outputs."""

    can_save = True
    answers_in_step = False  # outputs are those at the start of the last step
    sample_time = 0.0

    def is_real(self, name: str) -> bool:
        return True

    def nominal(self, name: str) -> float:
        return 1.0

    def follows_at_once(self, name: str) -> bool:
        return not self.answers_in_step

    def initially_from(self, name: str) -> Sequence[str]:
        return self.inputs

    def place(self, name: str) -> int:
        """That of an input in `w`."""
        return [*self.inputs].index(name)

    def writer(self, names: Sequence[str]) -> Any:
        places = [self.place(n) for n in names]

        def write(values: Vector) -> None:
            self.w[places] = values

        return write

    def reader(self, names: Sequence[str]) -> Any:
        places = [[*self.outputs].index(n) for n in names]

        def read() -> Vector:
            if not self.answers_in_step:
                self.show()
            return self.y[places]

        return read

    def reopened(self) -> Part:
        return copy.copy(self)  # all that changes is made anew at initialization


@dataclass
class LinearSlave(Part):
    """x' = A x + B w with inputs w held over a step; y = C x + D w. Exact for held inputs."""

    name: str
    A: Vector
    B: Vector
    C: Vector
    D: Vector
    inputs: Sequence[str]
    outputs: Sequence[str]
    start: Vector
    can_save: bool = True
    answers_in_step: bool = False
    _maps: dict[Any, Any] = field(default_factory=dict)

    def show(self) -> None:
        self.y = self.C @ self.x + self.D @ self.w

    def follows_at_once(self, name: str) -> bool:
        return bool(self.D.any())

    def enter_initialization(self, values: Any, stop: float) -> None:
        self.x, self.w = self.start.copy(), np.zeros(len(self.inputs))
        self.show()

    def step(self, t: float, h: float) -> None:
        if h not in self._maps:
            n, m = len(self.x), len(self.w)
            whole = np.zeros((n + m, n + m))
            whole[:n, :n], whole[:n, n:] = self.A, self.B
            moved = expm(whole * h)
            self._maps[h] = moved[:n, :n], moved[:n, n:]
        if self.answers_in_step:
            self.show()
        by_state, by_input = self._maps[h]
        self.x = by_state @ self.x + by_input @ self.w

    def save(self) -> Any:
        return self.x.copy(), self.w.copy(), self.y.copy()

    def restore(self, state: Any) -> None:
        self.x, self.w, self.y = (part.copy() for part in state)


class LawSlave(LinearSlave):
    """A plant with one command `u` that applies the feedback law within its exact solution."""

    def step(self, t: float, h: float) -> None:
        n = len(self.x)
        law = dict(zip(self.inputs, self.w, strict=True))
        gain = np.array([[law[f"u_gain_y{k}"] for k in range(n)]])
        offset = law["u"] - sum(law[f"u_gain_y{k}"] * law[f"u_ref_y{k}"] for k in range(n))
        key = (h, gain.tobytes())
        if key not in self._maps:
            ramp = np.zeros((n + 2, n + 2))  # states, the command's constant part, its rate
            ramp[:n, :n] = self.A + self.B[:, :1] @ gain
            ramp[:n, n : n + 1] = self.B[:, :1]
            ramp[n, n + 1] = 1.0
            self._maps = {key: expm(ramp * h)}
        self.x = (self._maps[key] @ np.concatenate([self.x, [offset, law["u_rate"]]]))[:n]


def law_inputs(n: int) -> list[str]:
    return ["u", *(f"u_gain_y{k}" for k in range(n)), *(f"u_ref_y{k}" for k in range(n)), "u_rate"]


@dataclass
class ComponentSlave(Part):
    """A component's model, with its parameters and initial states; exact up to `WITHIN`."""

    name: str
    kernel: Kernel
    values: Mapping[str, float]
    can_save: bool = True
    answers_in_step: bool = False

    def __post_init__(self) -> None:
        self.ports = [i.name for i in self.kernel.inputs]
        self.inputs = [i.name for i in self.kernel.inputs if i.role != "internal"]
        self.outputs = [o.name for o in self.kernel.outputs]

    def place(self, name: str) -> int:
        return self.ports.index(name)

    def show(self) -> None:
        self.bound.out(self.now)

    def enter_initialization(self, values: Mapping[str, float], stop: float) -> None:
        self.model = model = Model(self.kernel, {**self.values, **values}, WITHIN)
        self.sample_time, self.w = model.sample_time, model.u
        self.now, self.samples = 0.0, 0
        self.y = np.zeros(len(self.outputs))
        self.kept = model.x, model.u, model.info, self.y
        places = model.x, model.u, model.p, self.y, model.atol, model.info
        self.bound = model.system.instance(*places)
        model.settle(0.0)
        self.show()

    def step(self, t: float, h: float) -> None:
        model, self.now = self.model, t
        if STEP_START in self.ports:
            model.set_input(STEP_START, t)
        if self.answers_in_step:
            self.show()
        if self.sample_time > 0 and t > (self.samples - ROUND_OFF) * self.sample_time:
            model.sample(t)
            self.samples += 1
        if len(model.x):
            status = self.bound.advance(t, t + h, WITHIN, MAX_STEPS)
            if status != DONE:
                raise StepFailed(describe_failure(self.name, status, model.info, t + h))
        self.now = t + h

    def save(self) -> Any:
        return [part.copy() for part in self.kept], self.now, self.samples

    def restore(self, state: Any) -> None:
        parts, self.now, self.samples = state
        for kept, part in zip(self.kept, parts, strict=True):
            kept[:] = part


def off(found: Vector, exact: Vector) -> float:
    """Largest error of any column as a share of its range."""
    scale = np.maximum(np.ptp(exact, axis=0), 1e-9)
    return float(np.max(np.abs(found - exact).max(axis=0) / scale))


def row_of(seed: int, run: Any, error: float, **more: Any) -> Row:
    """What is kept of a run; the error is None if it is not finite."""
    row = {"seed": seed, **more, "trusted": run.verdict.trusted}
    return row | {"error": error if np.isfinite(error) else None, "coupling": run.coupling.value}


def wrong(row: Row) -> bool:
    return row["error"] is None or row["error"] > WRONG


def right(row: Row) -> bool:
    return row["error"] is not None and row["error"] <= RIGHT


def deceived(rows: Sequence[Row]) -> list[Row]:
    return [r for r in rows if r["trusted"] and wrong(r)]


def summary(rows: Sequence[Row]) -> Row:
    """Counts of right and wrong results, trusted and not, with a bound of the wrong ones."""
    doubts = (r.get("doubt", 0.0) for r in rows)
    known = [r for r, d in zip(rows, doubts, strict=True) if d is not None and d <= KNOWN * WRONG]
    all_wrong, all_right = [r for r in known if wrong(r)], [r for r in known if right(r)]
    misled, trusted = deceived(known), sum(r["trusted"] for r in all_right)
    return {
        "loops": len(rows),
        "truth_not_known": len(rows) - len(known),
        "wrong": len(all_wrong),
        "wrong_called_trusted": [r["seed"] for r in misled],
        "of_wrong_upper_95": upper(len(misled), len(all_wrong)),
        "right": len(all_right),
        "right_called_trusted": trusted,
        "right_called_trusted_rate": trusted / len(all_right) if all_right else None,
        "between": len(known) - len(all_wrong) - len(all_right),
    }


def told(found: Row) -> str:
    return (
        f"of {found['wrong']} wrong results {len(found['wrong_called_trusted'])} are trusted, "
        f"of {found['right']} right ones {found['right_called_trusted']}"
    )

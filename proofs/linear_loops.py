"""Random stiff linear loops with exact solutions, cut into a plant and a controller.

The verdict is tested on them: they are independent of the ball screw, the controller cancels or
moves the plant's stiff poles as linearizing controllers do, and the exact solution of the loop is a
matrix exponential. An FMU instance here is a slave defined by matrices; its own solution is exact,
so that all errors of a run are coupling errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import expm

from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.march import LoopRun
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides


@dataclass
class LinearSlave:
    """x' = A x + B w with inputs w held over a step; y = C x + D w. Exact for held inputs."""

    name: str
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: list[str]
    outputs: list[str]
    start: np.ndarray
    can_save: bool = True
    answers_in_step: bool = False
    sample_time: float = 0.0
    x: np.ndarray = field(init=False)
    w: np.ndarray = field(init=False)
    y: np.ndarray = field(init=False)
    _maps: dict[Any, Any] = field(default_factory=dict)

    def is_real(self, name: str) -> bool:
        return True

    def nominal(self, name: str) -> float:
        return 1.0

    def follows_at_once(self, name: str) -> bool:
        return bool(self.D.any())

    def initially_from(self, name: str) -> list[str]:
        return self.inputs

    def enter_initialization(self, values: Any, stop: float) -> None:
        self.x, self.w = self.start.copy(), np.zeros(len(self.inputs))
        self.y = self.C @ self.x + self.D @ self.w

    def leave_initialization(self) -> None:
        pass

    def writer(self, names: Any) -> Any:
        places = [self.inputs.index(n) for n in names]

        def write(values: np.ndarray) -> None:
            self.w[places] = values

        return write

    def reader(self, names: Any) -> Any:
        places = [self.outputs.index(n) for n in names]

        def read() -> np.ndarray:
            if not self.answers_in_step:
                self.y = self.C @ self.x + self.D @ self.w
            return self.y[places]

        return read

    def step(self, t: float, h: float) -> None:
        if h not in self._maps:
            n, m = len(self.x), len(self.w)
            whole = np.zeros((n + m, n + m))
            whole[:n, :n], whole[:n, n:] = self.A, self.B
            moved = expm(whole * h)
            self._maps[h] = moved[:n, :n], moved[:n, n:]
        if self.answers_in_step:
            self.y = self.C @ self.x + self.D @ self.w
        by_state, by_input = self._maps[h]
        self.x = by_state @ self.x + by_input @ self.w

    def save(self) -> Any:
        return self.x.copy(), self.w.copy(), self.y.copy()

    def restore(self, state: Any) -> None:
        self.x, self.w, self.y = (part.copy() for part in state)

    def release(self, state: Any) -> None:
        pass

    def reopened(self) -> LinearSlave:
        return type(self)(
            self.name,
            self.A,
            self.B,
            self.C,
            self.D,
            self.inputs,
            self.outputs,
            self.start,
            self.can_save,
            self.answers_in_step,
        )

    def close(self) -> None:
        pass


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


@dataclass(frozen=True)
class Case:
    """A loop, its coupling, and the range of its exact outputs."""

    plant: LinearSlave
    controller: LinearSlave
    closed: np.ndarray
    read: np.ndarray
    start: np.ndarray
    stop: float
    step: float
    coupling: Coupling

    def exact(self, times: np.ndarray) -> np.ndarray:
        """Plant outputs, shape (k, n)."""
        values, vectors = np.linalg.eig(self.closed)
        weights = np.linalg.solve(vectors, self.start.astype(complex))
        states = (vectors * weights) @ np.exp(np.outer(values, times))
        return (self.read @ states).real.T


def random_case(seed: int) -> Case:
    """Draw a loop with poles spread over up to five decades, and a step that may be far too long.

    The plant may be unstable or non-normal. The controller has zero to two states and feeds back
    all measured signals, so that the loop with the stiff plant is slow and well damped, often by
    cancelling almost all of the plant's dynamics.
    """
    random = np.random.default_rng(seed)
    while True:
        n = int(random.integers(1, 5))
        fast = 10.0 ** random.uniform(0.5, 4.5)
        poles = -np.sort(10.0 ** random.uniform(-0.5, np.log10(fast), n))
        mix = np.eye(n) + 0.5 * random.normal(size=(n, n))
        if np.linalg.cond(mix) > 50:
            continue
        A = mix @ np.diag(poles) @ np.linalg.inv(mix)
        B = np.abs(poles).max() * random.normal(size=(n, 1))
        # feedback that places the loop's poles at, or near, slow values
        wanted = -(10.0 ** random.uniform(-0.5, 0.8, n)) * (1 + 0.3 * np.arange(n))
        gain = _place(A, B, wanted)
        if gain is None:
            continue
        share = random.choice([1.0, 0.999, 0.9, 0.5, 0.1])
        K = share * gain
        m = int(random.integers(0, 3))
        Ac = -np.diag(10.0 ** random.uniform(-0.5, 2.5, m))
        Bc = random.normal(size=(m, n)) * 0.3
        Cc = random.normal(size=(1, m)) * 0.3 * np.linalg.norm(K)
        closed = np.block([[A + B @ K, B @ Cc], [Bc, Ac]])
        values, vectors = np.linalg.eig(closed)
        if values.real.max() > 0.5 or np.linalg.cond(vectors) > 1e6:
            continue
        break
    names = [f"y{k}" for k in range(n)]
    start = random.normal(size=n + m)
    lawful = bool(random.random() < 0.4)
    ports = law_inputs(n) if lawful else ["u"]
    wide = np.hstack([B, np.zeros((n, len(ports) - 1))])
    plant = (LawSlave if lawful else LinearSlave)(
        "plant", A, wide, np.eye(n), np.zeros((n, len(ports))), ports, names, start[:n]
    )
    controller = LinearSlave(
        "controller",
        Ac,
        Bc,
        Cc,
        K,
        names,
        ["u"],
        start[n:],
        can_save=bool(random.random() < 0.8),
        answers_in_step=bool(random.random() < 0.3),
    )
    plant.can_save = controller.can_save or bool(random.random() < 0.5)
    # from far too long to short, relative to the fastest pole of both matrices
    speed = max(np.abs(np.linalg.eigvals(A)).max(), np.abs(values).max())
    stop = float(random.choice([0.2, 1.0, 3.0]))
    steps = int(np.clip(stop * speed * 10.0 ** random.uniform(-1.5, 2.5), 20, 5_000))
    known = [
        Coupling.JACOBI,
        Coupling.GAUSS_SEIDEL,
        *([Coupling.INTERFACE_JACOBIAN] * 4 if lawful else []),
    ]
    coupling = known[random.integers(len(known))]
    read = np.hstack([np.eye(n), np.zeros((n, m))])
    return Case(plant, controller, closed, read, start, stop, stop / steps, coupling)


def _place(A: np.ndarray, B: np.ndarray, poles: np.ndarray) -> np.ndarray | None:
    """Ackermann's formula for u = K x with A + B K at the given poles; None if ill-conditioned."""
    n = len(A)
    reach = np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(n)])
    scaled = reach / np.linalg.norm(reach, axis=0)
    if np.linalg.cond(scaled) > 1e6:
        return None
    polynomial = np.zeros_like(A)
    for power, coefficient in enumerate(np.poly(poles)[::-1]):
        polynomial = polynomial + coefficient * np.linalg.matrix_power(A, power)
    last = np.zeros((1, n))
    last[0, -1] = 1
    gain = -last @ np.linalg.solve(reach, polynomial)
    return gain if np.all(np.isfinite(gain)) else None


@dataclass(frozen=True)
class Outcome:
    """Verdict of the run and the truth: largest error of any output as a share of its range."""

    seed: int
    trusted: bool
    error: float
    coupling: str
    contraction: float
    reason: str


def outcome(seed: int) -> Outcome:
    """Run one case and compare with the exact solution."""
    case = random_case(seed)
    with np.errstate(all="ignore"):
        still = Reference.constant(0.0)
        sides = Sides(case.plant, case.controller, still, case.stop, case.coupling)
        run: LoopRun = run_loop(sides, case.step)
        exact = case.exact(run.time)
        table = np.column_stack(list(run.outputs.values()))
        difference = np.abs(table - exact).max(axis=0)
    scale = np.maximum(np.ptp(exact, axis=0), 1e-9)
    error = float(np.max(difference / scale))
    return Outcome(
        seed,
        run.verdict.trusted,
        error if np.isfinite(error) else float("inf"),
        case.coupling.value,
        run.verdict.contraction,
        run.verdict.reason,
    )

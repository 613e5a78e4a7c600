"""Random stiff linear loops with exact solutions, cut into a plant and a controller.

They are independent of the ball screw. The controller cancels or moves the plant's stiff poles, as
linearizing controllers do, and the exact solution of the loop is a matrix exponential.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from runner import Row

from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides
from verdict.parts import LawSlave, LinearSlave, Vector, law_inputs, off, row_of


@dataclass(frozen=True)
class Loop:
    """x' = A x + B u, w' = Ac w + Bc x, u = K x + Cc w."""

    A: Vector
    B: Vector
    Ac: Vector
    Bc: Vector
    Cc: Vector
    K: Vector

    @property
    def closed(self) -> Vector:
        return np.block([[self.A + self.B @ self.K, self.B @ self.Cc], [self.Bc, self.Ac]])

    def exact(self, start: Vector, times: Vector) -> Vector:
        """Plant outputs, shape (k, n)."""
        values, vectors = np.linalg.eig(self.closed)
        weights = np.linalg.solve(vectors, start.astype(complex))
        states = (vectors * weights) @ np.exp(np.outer(values, times))
        return (np.eye(len(self.A), len(start)) @ states).real.T


def placed(A: Vector, B: Vector, poles: Vector) -> Vector | None:
    """Ackermann's formula for u = K x with A + B K at the given poles; None if ill-conditioned."""
    n = len(A)
    reach = np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(n)])
    if np.linalg.cond(reach / np.linalg.norm(reach, axis=0)) > 1e6:
        return None
    terms = enumerate(np.poly(poles)[::-1])
    polynomial = sum(c * np.linalg.matrix_power(A, power) for power, c in terms)
    gain = -np.eye(n)[-1:] @ np.linalg.solve(reach, polynomial)
    return gain if np.all(np.isfinite(gain)) else None


def random_loop(random: np.random.Generator) -> Loop:
    """Poles over up to five decades; the controller has zero to two states and feeds back all.

    The plant may be unstable or non-normal. The loop is slow and well damped, often because the
    controller cancels almost all of the plant's dynamics.
    """
    while True:
        n = int(random.integers(1, 5))
        fast = 10.0 ** random.uniform(0.5, 4.5)
        poles = -np.sort(10.0 ** random.uniform(-0.5, np.log10(fast), n))
        mix = np.eye(n) + 0.5 * random.normal(size=(n, n))
        if np.linalg.cond(mix) > 50:
            continue
        A = mix @ np.diag(poles) @ np.linalg.inv(mix)
        B = np.abs(poles).max() * random.normal(size=(n, 1))
        wanted = -(10.0 ** random.uniform(-0.5, 0.8, n)) * (1 + 0.3 * np.arange(n))
        gain = placed(A, B, wanted)
        if gain is None:
            continue
        K = random.choice([1.0, 0.999, 0.9, 0.5, 0.1]) * gain
        m = int(random.integers(0, 3))
        Ac = -np.diag(10.0 ** random.uniform(-0.5, 2.5, m))
        Bc = random.normal(size=(m, n)) * 0.3
        Cc = random.normal(size=(1, m)) * 0.3 * np.linalg.norm(K)
        loop = Loop(A, B, Ac, Bc, Cc, K)
        values, vectors = np.linalg.eig(loop.closed)
        if values.real.max() <= 0.5 and np.linalg.cond(vectors) <= 1e6:
            return loop


def outcome(seed: int) -> Row:
    """Draw a loop, run it with a step that may be far too long, compare with the exact solution."""
    random = np.random.default_rng(seed)
    loop = random_loop(random)
    n, m = len(loop.A), len(loop.Ac)
    names = [f"y{k}" for k in range(n)]
    start = random.normal(size=n + m)
    lawful = bool(random.random() < 0.4)
    ports = law_inputs(n) if lawful else ["u"]
    wide = np.hstack([loop.B, np.zeros((n, len(ports) - 1))])
    kind = LawSlave if lawful else LinearSlave
    plant = kind("plant", loop.A, wide, np.eye(n), np.zeros_like(wide), ports, names, start[:n])
    saves, late = bool(random.random() < 0.8), bool(random.random() < 0.3)
    matrices = loop.Ac, loop.Bc, loop.Cc, loop.K
    controller = LinearSlave("controller", *matrices, names, ["u"], start[n:], saves, late)
    plant.can_save = saves or bool(random.random() < 0.5)
    # from far too long to short, relative to the fastest pole of both matrices
    fastest = np.linalg.eigvals(loop.A), np.linalg.eig(loop.closed)[0]
    speed = max(np.abs(values).max() for values in fastest)
    stop = float(random.choice([0.2, 1.0, 3.0]))
    steps = int(np.clip(stop * speed * 10.0 ** random.uniform(-1.5, 2.5), 20, 5_000))
    by_law = [Coupling.INTERFACE_JACOBIAN] * 4 if lawful else []
    known = [Coupling.JACOBI, Coupling.GAUSS_SEIDEL, *by_law]
    coupling = known[random.integers(len(known))]
    with np.errstate(all="ignore"):
        sides = Sides(plant, controller, Reference.constant(0.0), stop, coupling)
        run = run_loop(sides, stop / steps)
        found = np.column_stack(list(run.outputs.values()))
        error = off(found, loop.exact(start, run.time))
    return row_of(seed, run, error)

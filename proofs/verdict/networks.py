"""Over random networks of 3 to 20 FMUs, no wrong result is called trusted.

Each network is an .ssp of native FMUs for ``run --system``: linear blocks, some with stiff poles,
some with the ports of the feedback law, blocks with direct feedthrough and sampled blocks,
connected at random with feedback. The truth is exact: a matrix exponential between samples. All
recorded outputs of the plant and of every other element are compared.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from networks_of_parts import write_system
from runner import PARTIAL, Row, seeds
from scipy.linalg import expm

import ballscrew as bs
from ballscrew.fmus.native.export import export_native
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import SystemLoop
from verdict.parts import Vector, deceived, row_of, summary, told

FIRST, NETWORKS = 10_000, 200
INPUTS = ("w1", "w2", "w3")
STATES = ("x1", "x2")
MATRICES, VECTORS = (("a", 2), ("b", 3)), (("e", 2), ("c", 2), ("d", 3))  # and their columns
HARD = {"direct", "sampled"}  # blocks whose output depends on an input of now, or of a sample
SMALLEST, LARGEST = 3, 20
MOST_STEPS = 4000
COUPLINGS = (None, None, "gauss-seidel", "jacobi")  # None: chosen by the program
AGAIN, LONG = 8, 2e-3  # rows that are kept, to be made again: the first with long steps [s]


def blocks(folder: Path) -> dict[str, Path]:
    """The four native FMUs of all networks, by their kind."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {kind: folder / f"{kind}.fmu" for kind in ("linear", "axis", "direct", "sampled")}
    for kind, path in made.items():
        export_native(block(kind), path)
    return made


def block(kind: str) -> bs.Component:
    """x' = A x + B w + e and y = c x (+ d w with direct feedthrough), or sampled: x+ = ..."""
    A, B = (sp.Matrix(2, n, lambda i, j, m=m: bs.symbol(f"{m}{i + 1}{j + 1}")) for m, n in MATRICES)
    e, c, d = (sp.Matrix([bs.symbol(f"{v}{k + 1}") for k in range(n)]) for v, n in VECTORS)
    x, w = (sp.Matrix([bs.symbol(n) for n in some]) for some in (STATES, INPUTS))
    moved, answer = A * x + B * w + e, c.dot(x)
    names = [str(n) for matrix in (A, B, e, c) for n in matrix]
    if kind == "direct":
        answer, names = answer + d.dot(w), [*names, *map(str, d)]
    sampled = kind == "sampled"
    of = bs.DiscreteState if sampled else bs.State
    states = tuple(of(n, "1", "state", m) for n, m in zip(STATES, moved, strict=True))
    period = bs.Parameter("sample_time", 0.01, "s", "period", "drawn", minimum=1e-6)
    return bs.Component(
        f"{kind}_block",
        f"a {kind} block of a random network",
        parameters=tuple(bs.Parameter(n, 0.0, "1", "coefficient", "drawn") for n in names),
        inputs=tuple(bs.Input(n, "1", "signal", law=("y",) * (kind == "axis")) for n in INPUTS),
        states=() if sampled else states,
        discrete=states if sampled else (),
        sample_time=period if sampled else None,
        outputs=(bs.Output("y", "1", "output", answer),),
    )


@dataclass(frozen=True)
class Block:
    """One element: matrices of its states, constants, output; `period` is 0 unless sampled [s]."""

    kind: str
    A: Vector
    B: Vector
    e: Vector
    c: Vector
    d: Vector
    start: Vector
    period: float = 0.0

    def values(self) -> dict[str, float]:
        arrays = {"a": self.A, "b": self.B, "e": self.e, "c": self.c}
        arrays |= {"d": self.d} if self.kind == "direct" else {}
        named = {
            name + "".join(str(k + 1) for k in at): float(value)
            for name, array in arrays.items()
            for at, value in np.ndenumerate(array)
        }
        named |= {f"x{i + 1}_start": float(self.start[i]) for i in range(2)}
        return named | ({"sample_time": self.period} if self.period else {})


@dataclass(frozen=True)
class Network:
    """Blocks, and for each input of each block its source block, or -1."""

    blocks: tuple[Block, ...]
    wires: Vector  # (blocks, 3)
    stop: float
    step: float = 0.0
    coupling: str | None = None
    order: tuple[int, ...] = ()  # in which the file lists the elements

    def write(self, path: Path, fmus: dict[str, Path]) -> Path:
        ends = np.argwhere(self.wires >= 0)
        wires = [f"n{self.wires[k, j]}.y -> n{k}.{INPUTS[j]}" for k, j in ends]
        elements = {f"n{k}": fmus[self.blocks[k].kind] for k in self.order}
        values = {f"n{k}": self.blocks[k].values() for k in self.order}
        return write_system(path, elements, wires, values)

    def plant(self) -> int:
        """The element used as plant: one with law ports, else a continuous one without d."""
        kinds = {k: self.blocks[k].kind for k in self.order}
        return max(kinds, key=lambda k: (kinds[k] == "axis", kinds[k] == "linear"))


class Whole:
    """The network as one system: continuous states, held states and a one, with one matrix."""

    def __init__(self, network: Network) -> None:
        n = len(network.blocks)
        size = 2 * n + 1
        # all outputs from all states: y = C s + D W y, where W connects outputs to inputs
        own, through = np.zeros((n, size)), np.zeros((n, n))
        driven = (network.wires[:, :, None] == np.arange(n)).astype(float)
        for k, b in enumerate(network.blocks):
            own[k, 2 * k : 2 * k + 2] = b.c
            through[k] = b.d @ driven[k]
        self.read = np.linalg.solve(np.eye(n) - through, own)
        self.moves, self.samples = np.zeros((size, size)), {}
        self.periods = {k: b.period for k, b in enumerate(network.blocks) if b.period}
        for k, b in enumerate(network.blocks):
            rows = np.zeros((2, size))
            rows[:, 2 * k : 2 * k + 2] = b.A
            rows += b.B @ driven[k] @ self.read
            rows[:, -1] += b.e
            if b.period:
                self.samples[k] = rows
            else:
                self.moves[2 * k : 2 * k + 2] = rows
        self.start = np.concatenate([*(b.start for b in network.blocks), [1.0]])

    def sampled(self, due: Sequence[int]) -> Vector:
        """The map of a sample instant; sources have smaller numbers than what samples them."""
        whole = np.eye(len(self.moves))
        for k in due:
            jump = np.eye(len(self.moves))
            jump[2 * k : 2 * k + 2] = self.samples[k]
            whole = jump @ whole
        return whole

    def course(self, times: Vector) -> tuple[Vector, Vector]:
        """Outputs of all blocks before and after sampling at each time, shape (times, blocks)."""
        due: dict[float, list[int]] = {float(t): [] for t in np.round(times, 12)}
        wanted = set(due)
        for k, period in self.periods.items():
            for t in np.round(np.arange(int(times[-1] / period + 1e-9) + 1) * period, 12):
                due.setdefault(float(t), []).append(k)
        maps: dict[float, Vector] = {}
        state, now = self.start.copy(), 0.0
        before, after = [], []
        for t in sorted(due):
            h = round(t - now, 12)
            if h > 0:
                if h not in maps:
                    maps[h] = expm(self.moves * h)
                state = maps[h] @ state
            held, now = state, t
            state = self.sampled(sorted(due[t])) @ state
            if t in wanted:
                before.append(self.read @ held)
                after.append(self.read @ state)
        return np.array(before), np.array(after)

    def growth(self, stop: float) -> float:
        if not self.periods:
            return float(np.linalg.eigvals(self.moves).real.max() * stop)
        shortest = min(self.periods.values())
        ticks = np.rint(np.array(sorted(set(self.periods.values()))) / shortest)
        base = shortest / (2 if 2.5 in ticks else 1)
        every = {k: round(p / base) for k, p in self.periods.items()}
        around, move = np.eye(len(self.moves)), expm(self.moves * base)
        length = int(np.lcm.reduce(list(every.values())))
        for tick in range(length):
            around = move @ self.sampled([k for k, p in every.items() if tick % p == 0]) @ around
        largest = np.abs(np.linalg.eigvals(around)).max()
        return float(np.log(max(largest, 1e-300)) * stop / (length * base))


def random_network(seed: int) -> Network:
    """Draw a network that is stable or nearly stable, and a step that may be far too long."""
    random = np.random.default_rng(seed)
    while True:
        n = int(random.integers(SMALLEST, LARGEST + 1))
        stop = float(random.choice([0.2, 1.0, 3.0]))
        base = round(stop * 10.0 ** random.uniform(-2.5, -1.0), 6)
        kinds = random.choice(["linear", "stiff", "direct", "sampled"], n, p=[0.45, 0.2, 0.15, 0.2])
        if not set(kinds) & {"linear", "stiff"}:
            continue
        if random.random() < 0.3:
            kinds[random.choice(np.flatnonzero(np.isin(kinds, ["linear", "stiff"])))] = "axis"
        made = [random_block(random, str(kind), stop, base) for kind in kinds]
        wires = np.full((n, 3), -1)
        for k, j in np.ndindex(n, 3):
            # blocks with feedthrough have earlier blocks as sources: no algebraic loops
            soft = [i for i in range(n) if not {made[i].kind, made[k].kind} <= HARD]
            able = sorted({*soft, *range(k)} - {k})
            if able and (j == 0 or random.random() < 0.3):
                wires[k, j] = random.choice(able)
        network = tamed(Network(tuple(made), wires, stop))
        if network is None:
            continue
        speeds = np.abs(np.linalg.eigvals(Whole(network).moves))
        speeds = np.append(speeds, [np.abs(b.A).max() for b in network.blocks if not b.period])
        steps = stop * max(speeds.max(), 1 / stop) * 10.0 ** random.uniform(-1.0, 3.0)
        return replace(
            network,
            step=stop / int(np.clip(steps, 20, MOST_STEPS)),
            coupling=COUPLINGS[random.integers(len(COUPLINGS))],
            order=tuple(int(k) for k in random.permutation(n)),
        )


def random_block(random: np.random.Generator, kind: str, stop: float, base: float) -> Block:
    start, e = random.normal(size=2), np.zeros(2)
    c, d = random.normal(size=2), np.zeros(3)
    gains = random.normal(size=(2, 3)) * 10.0 ** random.uniform(-0.5, 0.7)
    if kind == "sampled":
        A = np.diag(random.uniform(-0.3, 0.95, 2)) + np.array([[0, 0.2 * random.normal()], [0, 0]])
        B = (np.eye(2) - A) @ gains
        period = base * float(random.choice([1, 1, 2, 5]))
        return Block(kind, A, B, 0.2 * random.normal(size=2), c, d, start, period)
    fastest = 4.0 if kind == "stiff" else 1.3
    speed = 10.0 ** random.uniform(0.0, fastest, 2) / stop
    if kind in ("linear", "axis") and random.random() < 0.5:  # a complex pair
        size, damping = speed[0], random.uniform(0.05, 1.0)
        A = np.array([[0.0, size], [-size, -2 * damping * size]])
    else:
        A = np.diag(-speed) + np.array([[0, 0.5 * random.normal() * speed[0]], [0, 0]])
    B = -A @ gains
    if kind == "direct":
        d = random.normal(size=3)
    e = -A @ random.normal(size=2) * 0.3
    return Block("linear" if kind == "stiff" else kind, A, B, e, c, d, start)


def tamed(network: Network) -> Network | None:
    """The network with weaker couplings, so that it is stable or nearly stable."""
    for _ in range(12):
        if Whole(network).growth(network.stop) < 1.0:
            return network
        weaker = (replace(b, B=0.7 * b.B, d=0.7 * b.d) for b in network.blocks)
        network = replace(network, blocks=tuple(weaker))
    return None


def columns(network: Network, run: Any) -> tuple[list[int], Vector]:
    """Block of each recorded column, and the columns, shape (times, columns)."""
    plant = network.plant()
    found = [plant] * len(run.outputs)
    found += [int(network.wires[plant, INPUTS.index(name)]) for name in run.commands]
    found += [int(name.partition(".")[0][1:]) for name in run.others]
    courses = (run.outputs, run.commands, run.others)
    return found, np.column_stack([course for some in courses for course in some.values()])


def outcome(seed: int, fmus: dict[str, Path]) -> Row:
    network = random_network(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = network.write(Path(folder) / "network.ssp", fmus)
        loop = SystemLoop(path, stop=network.stop, step=network.step, coupling=network.coupling)
        with np.errstate(all="ignore"):
            run = run_closed_loop(loop).run
    names, table = columns(network, run)
    before, after = (outputs[:, names] for outputs in Whole(network).course(run.time))
    found = np.minimum(np.abs(table - before), np.abs(table - after))
    scale = np.maximum(np.ptp(before, axis=0), 1e-6 * np.abs(before).max(0))
    errors = found.max(axis=0) / np.maximum(scale, 1e-9)
    complete = abs(run.time[-1] - network.stop) < 1e-9 and bool(np.isfinite(errors).all())
    size = {"size": len(network.blocks), "sampled": sum(b.period > 0 for b in network.blocks)}
    error = float(errors.max()) if complete else float("inf")
    return row_of(seed, run, error, **size, step=network.step)


def tasks(asked: Namespace) -> dict[str, tuple[int, dict[str, Path]]]:
    fmus = blocks(PARTIAL / "networks")
    return {f"network {seed}": (seed, fmus) for seed in seeds(asked, NETWORKS, FIRST)}


trial = outcome


def report(rows: Sequence[Row]) -> Row:
    misled = deceived(rows)
    return {
        "seeds": [rows[0]["seed"], rows[-1]["seed"] + 1],
        "summary": summary(rows),
        "wrong": misled,
        "again": [r for r in rows if r["step"] > LONG][:AGAIN],
        "holds": not misled,
    }


def says(report: Row) -> str:
    return f"{report['summary']['loops']} networks: {told(report['summary'])}"

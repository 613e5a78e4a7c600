"""Proof: over random networks of 3 to 20 FMUs, no wrong result is called trusted.

Writes ``docs/proof/networks.json``: provenance, seeds and every outcome. Each network is an .ssp of
native FMUs for ``run --system``: linear blocks, some with stiff poles, some with the ports of the
feedback law, blocks with direct feedthrough and sampled blocks, connected at random with feedback.
The truth is exact: a matrix exponential between samples. All recorded outputs of the plant and of
every other element are compared. Wrong and right are defined as in ``trusted_loops.py``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

import numpy as np  # noqa: E402
from networks_of_parts import write_system  # noqa: E402
from provenance import provenance  # noqa: E402
from scipy.linalg import expm  # noqa: E402
from trusted_loops import plain, summary  # noqa: E402

from ballscrew.fmus.native.export import export_native  # noqa: E402
from ballscrew.orchestration.loop.closed_loop import run_closed_loop  # noqa: E402
from ballscrew.orchestration.loop.loop import SystemLoop  # noqa: E402
from ballscrew.solver.component import (  # noqa: E402
    Component,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)

TARGET = ROOT / "docs" / "proof" / "networks.json"
INPUTS = ("w1", "w2", "w3")
STATES = ("x1", "x2")
SMALLEST, LARGEST = 3, 20
MOST_STEPS = 4000
COUPLINGS = (None, None, "gauss-seidel", "jacobi")  # None: chosen by the program

Vector = np.ndarray
Row = dict[str, Any]


def blocks(folder: Path) -> dict[str, Path]:
    """The four native FMUs of all networks, by their kind."""
    made = {}
    for kind in ("linear", "axis", "direct", "sampled"):
        made[kind] = folder / f"{kind}.fmu"
        export_native(block(kind), made[kind])
    return made


def block(kind: str) -> Component:
    """x' = A x + B w + e and y = c x (+ d w with direct feedthrough), or sampled: x+ = ..."""
    names = [f"a{i}{j}" for i in (1, 2) for j in (1, 2)]
    names += [f"b{i}{j}" for i in (1, 2) for j in (1, 2, 3)] + ["e1", "e2", "c1", "c2"]
    if kind == "direct":
        names += ["d1", "d2", "d3"]
    x, w = [symbol(n) for n in STATES], [symbol(n) for n in INPUTS]
    moved = [
        sum(symbol(f"a{i}{j}") * x[j - 1] for j in (1, 2))
        + sum(symbol(f"b{i}{j}") * w[j - 1] for j in (1, 2, 3))
        + symbol(f"e{i}")
        for i in (1, 2)
    ]
    answer = symbol("c1") * x[0] + symbol("c2") * x[1]
    if kind == "direct":
        answer += sum(symbol(f"d{j}") * w[j - 1] for j in (1, 2, 3))
    law = ("y",) if kind == "axis" else ()
    of = DiscreteState if kind == "sampled" else State
    states = tuple(of(n, "1", "state", m) for n, m in zip(STATES, moved, strict=True))
    period = Parameter("sample_time", 0.01, "s", "period", "drawn", minimum=1e-6)
    sampled = kind == "sampled"
    return Component(
        f"{kind}_block",
        f"a {kind} block of a random network",
        parameters=tuple(Parameter(n, 0.0, "1", "coefficient", "drawn") for n in names),
        inputs=tuple(Input(n, "1", "signal", law=law) for n in INPUTS),
        states=() if sampled else states,
        discrete=states if sampled else (),
        sample_time=period if sampled else None,
        outputs=(Output("y", "1", "output", answer),),
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

    @property
    def hard(self) -> bool:
        """Whether the output depends directly on an input, or on an input at a sample instant."""
        return self.kind in ("direct", "sampled")

    def values(self) -> dict[str, float]:
        """Its parameters, with the FMU's names."""
        named = {f"a{i + 1}{j + 1}": self.A[i, j] for i in range(2) for j in range(2)}
        named |= {f"b{i + 1}{j + 1}": self.B[i, j] for i in range(2) for j in range(3)}
        named |= {f"e{i + 1}": self.e[i] for i in range(2)}
        named |= {f"c{i + 1}": self.c[i] for i in range(2)}
        named |= {f"x{i + 1}_start": self.start[i] for i in range(2)}
        if self.kind == "direct":
            named |= {f"d{j + 1}": self.d[j] for j in range(3)}
        if self.kind == "sampled":
            named["sample_time"] = self.period
        return {n: float(v) for n, v in named.items()}


@dataclass(frozen=True)
class Network:
    """Blocks, and for each input of each block its source block, or -1."""

    blocks: tuple[Block, ...]
    wires: Vector  # (blocks, 3)
    stop: float
    step: float
    coupling: str | None
    order: tuple[int, ...]  # in which the file lists the elements

    def exact(self, times: Vector) -> tuple[Vector, Vector]:
        """Outputs of all blocks before and after sampling at each time, shape (times, blocks)."""
        return _Whole(self).course(times)

    def write(self, path: Path, fmus: dict[str, Path]) -> Path:
        """The network as an .ssp."""
        wires = [
            f"n{source}.y -> n{k}.{INPUTS[j]}"
            for (k, j), source in np.ndenumerate(self.wires)
            if source >= 0
        ]
        elements = {f"n{k}": fmus[self.blocks[k].kind] for k in self.order}
        values = {f"n{k}": self.blocks[k].values() for k in self.order}
        return write_system(path, elements, wires, values)


class _Whole:
    """The network as one system: continuous states, held states and a one, with one matrix."""

    def __init__(self, network: Network) -> None:
        self.network, n = network, len(network.blocks)
        size = 2 * n + 1
        # all outputs from all states: y = C s + D W y, where W connects outputs to inputs
        own, through = np.zeros((n, size)), np.zeros((n, n))
        driven = np.zeros((n, 3, n))
        for (k, j), source in np.ndenumerate(network.wires):
            if source >= 0:
                driven[k, j, source] = 1.0
        for k, b in enumerate(network.blocks):
            own[k, 2 * k : 2 * k + 2] = b.c
            through[k] = b.d @ driven[k]
        self.read = np.linalg.solve(np.eye(n) - through, own)
        self.moves = np.zeros((size, size))
        self.samples = {}
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
        """The map of a sample instant: blocks in the order of their connections."""
        whole = np.eye(len(self.moves))
        for k in due:  # networks are drawn such that sources have smaller numbers
            jump = np.eye(len(self.moves))
            jump[2 * k : 2 * k + 2] = self.samples[k]
            whole = jump @ whole
        return whole

    def course(self, times: Vector) -> tuple[Vector, Vector]:
        periods = {k: self.network.blocks[k].period for k in self.samples}
        due: dict[float, list[int]] = {float(t): [] for t in np.round(times, 12)}
        wanted = set(due)
        for k, period in periods.items():
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
            now = t
            held = state
            state = self.sampled(sorted(due[t])) @ state
            if t in wanted:
                before.append(self.read @ held)
                after.append(self.read @ state)
        return np.array(before), np.array(after)


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
        made = [_random_block(random, str(kind), stop, base) for kind in kinds]
        wires = np.full((n, 3), -1)
        for k, j in np.ndindex(n, 3):
            # blocks with feedthrough have earlier blocks as sources, so there are no algebraic
            # loops
            soft = [i for i in range(n) if not (made[i].hard and made[k].hard)]
            able = sorted({*soft, *range(k)} - {k})
            if able and (j == 0 or random.random() < 0.3):
                wires[k, j] = random.choice(able)
        network = Network(tuple(made), wires, stop, stop, None, tuple(range(n)))
        tamed = _tamed(network)
        if tamed is None:
            continue
        speeds = np.abs(np.linalg.eigvals(_Whole(tamed).moves))
        speeds = np.append(speeds, [np.abs(b.A).max() for b in tamed.blocks if not b.period])
        steps = stop * max(speeds.max(), 1 / stop) * 10.0 ** random.uniform(-1.0, 3.0)
        return Network(
            tamed.blocks,
            wires,
            stop,
            stop / int(np.clip(steps, 20, MOST_STEPS)),
            COUPLINGS[random.integers(len(COUPLINGS))],
            tuple(int(k) for k in random.permutation(n)),
        )


def _random_block(random: np.random.Generator, kind: str, stop: float, base: float) -> Block:
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


def _tamed(network: Network) -> Network | None:
    """The network with weaker couplings, so that it is stable or nearly stable."""
    for _ in range(12):
        if _growth(network) < 1.0:
            return network
        weaker = tuple(
            Block(b.kind, b.A, 0.7 * b.B, b.e, b.c, 0.7 * b.d, b.start, b.period)
            for b in network.blocks
        )
        network = Network(
            weaker, network.wires, network.stop, network.step, network.coupling, network.order
        )
    return None


def _growth(network: Network) -> float:
    """Growth of the largest mode over the run [nats]."""
    whole = _Whole(network)
    periods = sorted({network.blocks[k].period for k in whole.samples})
    if not periods:
        return float(np.linalg.eigvals(whole.moves).real.max() * network.stop)
    ticks = np.rint(np.array(periods) / periods[0]) if len(periods) else []
    base = periods[0] / (2 if 2.5 in ticks else 1)
    every = {k: round(network.blocks[k].period / base) for k in whole.samples}
    around, move = np.eye(len(whole.moves)), expm(whole.moves * base)
    length = int(np.lcm.reduce(list(every.values())))
    for tick in range(length):
        around = move @ whole.sampled([k for k, p in every.items() if tick % p == 0]) @ around
    largest = np.abs(np.linalg.eigvals(around)).max()
    return float(np.log(max(largest, 1e-300)) * network.stop / (length * base))


@dataclass(frozen=True)
class Outcome:
    """Verdict of the run and the truth: largest error of any output as a share of its range."""

    seed: int
    size: int
    sampled: int
    trusted: bool
    error: float
    worst: str
    coupling: str
    step: float
    reason: str


def outcome(seed: int, fmus: dict[str, Path]) -> Outcome:
    """Run one network and compare with the exact solution."""
    network = random_network(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = network.write(Path(folder) / "network.ssp", fmus)
        loop = SystemLoop(path, stop=network.stop, step=network.step, coupling=network.coupling)
        with np.errstate(all="ignore"):
            result = run_closed_loop(loop)
    run = result.run
    before, after = network.exact(run.time)
    names, table = columns(network, run)
    found = np.minimum(np.abs(table - before[:, names]), np.abs(table - after[:, names]))
    scale = np.maximum(np.ptp(before[:, names], axis=0), 1e-6 * np.abs(before[:, names]).max(0))
    errors = found.max(axis=0) / np.maximum(scale, 1e-9)
    complete = abs(run.time[-1] - network.stop) < 1e-9 and bool(np.isfinite(errors).all())
    worst = int(np.argmax(np.where(np.isfinite(errors), errors, np.inf)))
    return Outcome(
        seed,
        len(network.blocks),
        sum(b.period > 0 for b in network.blocks),
        run.verdict.trusted,
        float(errors[worst]) if complete else float("inf"),
        f"n{names[worst]}",
        run.coupling.value,
        network.step,
        run.verdict.reason,
    )


def columns(network: Network, run: Any) -> tuple[list[int], Vector]:
    """Block of each recorded column, and the columns, shape (times, columns)."""
    plant = plant_of(network)
    found = [(plant, course) for course in run.outputs.values()]
    found += [
        (int(network.wires[plant, INPUTS.index(name)]), course)
        for name, course in run.commands.items()
    ]
    found += [(int(name.partition(".")[0][1:]), course) for name, course in run.others.items()]
    return [k for k, _ in found], np.column_stack([course for _, course in found])


def plant_of(network: Network) -> int:
    """The element used as plant: one with law ports, else a continuous one without feedthrough."""
    blocks = network.blocks
    ranks = {k: (blocks[k].kind == "axis", blocks[k].kind == "linear") for k in network.order}
    return max(ranks, key=lambda k: ranks[k])


def outcomes(seeds: Sequence[int], fmus: dict[str, Path]) -> list[Row]:
    rows = []
    with ProcessPoolExecutor() as pool:
        for done, found in enumerate(pool.map(partial(outcome, fmus=fmus), seeds), start=1):
            rows.append(plain(found) | {"reason": found.reason})
            if done % 10 == 0:
                said = summary(rows)
                counts = {k: said[k] for k in ("wrong", "wrong_called_trusted", "right")}
                print(f"{done} of {len(seeds)}: {counts}", file=sys.stderr)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--networks", type=int, default=200)
    parser.add_argument("--first", type=int, default=10_000, help="first seed")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.networks)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    made = provenance("networks")  # of the running code, even if files change meanwhile
    with tempfile.TemporaryDirectory() as folder:
        rows = outcomes(seeds, blocks(Path(folder)))
    report = {
        **made,
        "seeds": [seeds.start, seeds.stop],
        "summary": summary(rows),
        "outcomes": rows,
    }
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(report["summary"], indent=2))
    return 1 if report["summary"]["wrong_called_trusted"] else 0


if __name__ == "__main__":
    raise SystemExit(main())

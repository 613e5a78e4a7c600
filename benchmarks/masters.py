"""Communication steps of the same FMUs in our master and in others, on one core.

On several cores the threads of libcosim and Ecos wait for each other at Python's lock: they take
two to seven times as long.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from networks_of_parts import link, write_system
from report import OURS, Cost, Program, Works, missing, timed
from wired_loop import WiredLoop, missing_for_ecos, run_in, wired

import ballscrew
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop, SystemLoop
from ballscrew.orchestration.loop.system import joined
from ballscrew.orchestration.master.march import Clock, Record, march_on
from ballscrew.orchestration.master.sides import Sides

PUSH = 100.0  # N, on the first mass of a chain
HOSTS = {
    "libcosim": ("libcosim", missing("libcosimpy")),
    "Ecos": ("ecos", missing("ecospy") or missing_for_ecos()),
    "FMU container": ("container", missing("fmu_manipulation_toolbox")),
}
Timed = tuple[Loop | SystemLoop, WiredLoop]  # the same loop for us, and for the others


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process, and those that it starts, to one core."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def pair(plant: Path, controller: Path, step: float, stop: float) -> Timed:
    """A plant and its controller, with the ports of the feedback law connected."""
    loop = Loop(controller, plant, 0.08, stop, step=step, corrections=0, isolate=False)
    return loop, wired(plant, controller, step, stop, law=True, outputs=("x",))


def chain(made: Path, size: int, stop: float, step: float = 1e-3) -> Timed:
    """Masses between springs, each an FMU; the first one is the plant."""
    names = ["plant", *(f"m{k}" for k in range(1, size))]
    neighbours = list(itertools.pairwise(names))
    ends = [((a, "x"), (b, "before")) for a, b in neighbours]
    ends += [((b, "x"), (a, "after")) for a, b in neighbours]
    wires = [f"{'.'.join(source)} -> {'.'.join(target)}" for source, target in ends]
    elements = dict.fromkeys(names, made)
    path = write_system(made.with_suffix(f".{size}.ssp"), elements, wires)
    values = {"plant.push": PUSH}
    loop = SystemLoop(path, stop=stop, step=step, values=values, corrections=0, isolate=False)
    fmus, starts = {n: str(made) for n in names}, [("plant", "push", PUSH)]
    return loop, WiredLoop(fmus, ends, starts, ["x"], step, round(stop / step))


def a_step(loop: Loop | SystemLoop) -> Cost:
    """A step of our master without a verdict, as the others have none."""
    with one_core(), joined(loop) as both:
        how, values = (loop.coupling, loop.corrections), (both.values[both.main], {})
        goal = both.reference
        sides = Sides(*both.sides, goal, both.stop, *how, values, both.names, both.wiring)
        main, clock = sides.main(), Clock(both.stop, loop.step)
        record = Record(main, goal, both.wiring.orders)
        took, _ = timed(lambda: march_on(main, clock, record))
        assert not main.failure
        return Cost(took * loop.step / both.stop)


def judged(loop: Loop | SystemLoop) -> Cost:
    """A step of what `run` does: opens the FMUs, corrects steps, and judges the run."""
    loop = replace(loop, corrections=None)
    with one_core():
        took, _ = timed(lambda: run_closed_loop(loop))
    return Cost(took * loop.step / loop.stop)


def elsewhere(host: str, job: WiredLoop) -> Cost:
    """A step in another master; the steps are one call, and nothing is recorded."""
    with one_core():
        return Cost(1e-6 * run_in(host, job, timed=True))


def beside_others(timed_loop: Timed, *more: str) -> dict[str, Program]:
    """A step in each master, and of ours in further ways."""
    loop, job = timed_loop
    ways: dict[str, Callable[[], Cost]] = {
        "corrected": partial(a_step, replace(loop, corrections=1)),
        "judged": partial(judged, loop),
        "isolated": partial(a_step, replace(loop, isolate=True)),
    }
    others = {n: absent or partial(elsewhere, host, job) for n, (host, absent) in HOSTS.items()}
    ours = {f"{OURS}, {way}": ways[way] for way in more}
    return {OURS: partial(a_step, loop), **ours, **others}


def native(folder: Path) -> Works:
    """A communication step of native FMUs

    On one core, without checks. *Judged* is what `ballscrew run` does for a step: it also opens the
    FMUs, corrects steps, and runs with other steps for its verdict, which no other master gives.
    The chains are of masses between springs, an FMU each.
    """
    parts = ("plant", "iol", "nctf")
    made = {n: ballscrew.export(n, folder / f"{n}.fmu", native=True) for n in parts}
    of_link = ballscrew.export(link(), folder / "link.fmu", native=True)
    loops = {
        "iol, 1 ms": pair(made["plant"], made["iol"], 1e-3, 5.0),
        "nctf, 0.1 ms": pair(made["plant"], made["nctf"], 1e-4, 1.0),
        **{f"chain of {n}": chain(of_link, n, 2.0) for n in (3, 10, 20, 100)},
    }
    return {name: beside_others(loop, "judged") for name, loop in loops.items()}


def readable(folder: Path) -> Works:
    """A communication step of readable FMUs

    FMUs of pythonfmu, as above; *isolated*: each in a process of its own.
    """
    loops = {
        "iol, 1 ms": pair(fmu("plant"), fmu("iol"), 1e-3, 2.0),
        "nctf, 0.1 ms": pair(fmu("plant"), fmu("nctf"), 1e-4, 0.2),
    }
    ways = "corrected", "judged", "isolated"
    return {name: beside_others(loop, *ways) for name, loop in loops.items()}


def isolated(folder: Path) -> Works:
    """Six readable FMUs in processes of their own

    A chain of six masses as `ballscrew run` runs it, with its verdict.
    """
    loop, _ = chain(ballscrew.export(link(), folder / "link.fmu"), 6, 1.0, 0.53e-3)
    loop = replace(loop, corrections=None)
    programs = {
        OURS: lambda: run_closed_loop(replace(loop, isolate=True)),
        "all in one process": lambda: run_closed_loop(loop),
    }
    return {"1 s, steps of 0.53 ms": programs}


TABLES = native, readable, isolated

"""A swap of controllers, and the runs of a study, beside what a user could write instead."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import by_hand
import numpy as np
import numpy.typing as npt
from report import OURS, Cost, Works, timed

import ballscrew
from ballscrew.orchestration.loop.catalogue import component, fmu
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.reference_motions import as_reference
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study.run import StudyLoop

Vector = npt.NDArray[np.float64]
Course = tuple[Vector, Vector]  # times [s] and positions [m]

SWAPPED = ("iol", "nctf", "pid")
GOAL, LENGTH = 0.08, 4.0  # m, s
PERIOD, STOP = 1e-3, 5.0  # s, of a study
MOTION = "move:distance=0.02,speed=0.08,acceleration=0.8,jerk=20"


def off(course: Course, truth: Course) -> float:
    """Largest error of a position [m]."""
    return float(np.abs(np.interp(course[0], *truth) - course[1]).max())


def swapping(folder: Path) -> Works:
    """A swap of three controllers

    The nominal axis moves by 8 cm in 4 s, native FMUs. Errors are the largest of the position,
    against runs with steps of 0.1 ms that are trusted. By hand is `benchmarks/by_hand.py`,
    what one writes who has FMPy and nothing else: it says nothing of its error. `swap` gives
    an error estimate for each signal, pictures and a report.
    """
    made = {n: folder / f"{n}.fmu" for n in ("plant", *SWAPPED)}
    for name, path in made.items():
        ballscrew.export(name, path, native=True)
    truth = {}
    for name in SWAPPED:
        right = ballscrew.run(name, stop=LENGTH, step=1e-4).run
        truth[name] = right.time, right.outputs["x"]
    script = Path(by_hand.__file__).read_text(encoding="utf-8")

    def errors(courses: Mapping[str, Course], lines: int) -> str:
        each = (f"{n} {off(course, truth[n]):.1e}" for n, course in courses.items())
        return f"lines: {lines}; off by {', '.join(each)} m"

    def ours() -> Cost:
        def swap() -> ballscrew.Comparison:
            found = ballscrew.swap([made[n] for n in SWAPPED], made["plant"], stop=LENGTH)
            found.save(folder / "out")
            return found

        took, found = timed(swap)
        runs = (result.run for result in found.results)
        courses = {n: (r.time, r.outputs["x"]) for n, r in zip(SWAPPED, runs, strict=True)}
        return Cost(took, errors(courses, 1))

    def hand(step: float, law: bool) -> Cost:
        goals = np.full(round(LENGTH / step) + 1, GOAL)
        one = partial(by_hand.run, made["plant"], goals=goals, step=step, law=law)
        took, found = timed(lambda: {n: one(made[n]) for n in SWAPPED})
        courses = {n: (rows[:, 0], rows[:, 1]) for n, rows in found.items()}
        return Cost(took, errors(courses, len(script.splitlines())))

    ways = {
        "FMPy by hand, 1 ms, u alone": (1e-3, False),
        "FMPy by hand, 0.1 ms, u alone": (1e-4, False),
        "FMPy by hand, 1 ms, law ports wired": (1e-3, True),
    }
    hands = {name: partial(hand, *way) for name, way in ways.items()}
    return {"iol, nctf, pid": {OURS: ours, **hands}}


def a_run(folder: Path) -> Works:
    """One run of a study

    The digital PID moves the axis by 2 cm; 5 s at 1 kHz. The run of a study solves the equations of
    the whole loop; errors are against the same with a tolerance of 1e-11.
    """
    parts = "plant", "pid_sampled"
    native = [ballscrew.export(n, folder / f"{n}.fmu", native=True) for n in parts]
    motion = as_reference(MOTION)
    times = np.arange(round(STOP / PERIOD) + 1) * PERIOD
    goals = motion.on(times, 0)
    loop = StudyLoop(loop_kernel(*map(component, parts)))
    over_fmus = Loop("pid_sampled", "plant", motion, stop=STOP, step=PERIOD, isolate=False)
    exact = times, loop.run({}, (motion, STOP), 1e-11).position

    def with_fmpy(plant: Path, controller: Path) -> Vector:
        return by_hand.run(plant, controller, goals, PERIOD, digital=True)[:, 1]

    ways = {
        OURS: lambda: loop.run({}, (motion, STOP)).position,
        f"{OURS}, over FMUs, with its verdict": lambda: ballscrew.run(over_fmus)["x"],
        "FMPy by hand, native FMUs": lambda: with_fmpy(*native),
        "FMPy by hand, FMUs of pythonfmu": lambda: with_fmpy(*map(fmu, parts)),
    }

    def cost(way: str) -> Cost:
        took, position = timed(ways[way])
        course = np.linspace(0.0, STOP, len(position)), position
        return Cost(took, f"off by {off(course, exact):.1e} m")

    return {"pid_sampled": {way: partial(cost, way) for way in ways}}


TABLES = swapping, a_run

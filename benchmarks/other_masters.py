"""Cost of a communication step of the same FMUs in masters that are not ours, next to ours."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from wired_loop import missing_for_ecos, run_in, wired

HOSTS = ("libcosim", "ecos", "container")
ROUNDS = 3


@dataclass(frozen=True)
class TimedLoop:
    """A loop to be timed: its FMUs, communication step and length, both in seconds."""

    plant: Path
    controller: Path
    step: float
    stop: float


def step_cost(host: str, loop: TimedLoop) -> float:
    """Microseconds per communication step of a loop in this host, in a process of its own.

    The law's ports are wired. The steps are taken in one call, so that nothing of the host's Python
    interface is in the figure, and nothing is recorded. The process keeps to one core, which is
    where libcosim and Ecos are fastest: on more, their threads wait for one another at Python's
    lock, and the figure is two to seven times as large and different every time.
    """
    job = wired(loop.plant, loop.controller, loop.step, loop.stop, law=True, outputs=("x",))
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        return float(run_in(host, job, timed=True))
    finally:
        os.sched_setaffinity(0, allowed)


def side_by_side(
    ours: Callable[[TimedLoop], float], loops: Mapping[str, TimedLoop]
) -> dict[str, dict[str, float]]:
    """Microseconds per communication step, by loop and by master, the best of three rounds.

    In each round every master has its turn, so that a busy machine is busy for all of them. Ecos
    is left out where its library cannot be loaded.

    Parameters
    ----------
    ours : function
        Gives our master's microseconds per step.
    loops : mapping of str to TimedLoop

    Returns
    -------
    dict
        Of loop to {"ours", "libcosim", "ecos", "container"} to microseconds.
    """
    hosts = [host for host in HOSTS if host != "ecos" or not missing_for_ecos()]
    best = {name: dict.fromkeys(("ours", *hosts), math.inf) for name in loops}
    for _ in range(ROUNDS):
        for name, loop in loops.items():
            best[name]["ours"] = min(best[name]["ours"], ours(loop))
            for host in hosts:
                best[name][host] = min(best[name][host], step_cost(host, loop))
    return best

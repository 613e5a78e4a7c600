"""Cost of a communication step of the same FMUs in other masters, next to ours."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from networks_of_parts import link
from wired_loop import WiredLoop, missing_for_ecos, run_in, wired

__all__ = ["TimedChain", "TimedLoop", "link", "missing_for_ecos", "side_by_side", "step_cost"]
HOSTS = ("libcosim", "ecos", "container")
ROUNDS = 3


@dataclass(frozen=True)
class TimedLoop:
    """A loop to be timed: its FMUs, communication step and length, both in seconds."""

    plant: Path
    controller: Path
    step: float
    stop: float

    def job(self) -> WiredLoop:
        """The loop for other masters: the law's ports are connected."""
        return wired(self.plant, self.controller, self.step, self.stop, law=True, outputs=("x",))


@dataclass(frozen=True)
class TimedChain:
    """A chain of masses between springs, each an FMU, to be timed; the first is called plant."""

    link: Path
    size: int
    step: float
    stop: float

    @property
    def names(self) -> list[str]:
        return ["plant", *(f"m{k}" for k in range(1, self.size))]

    def connections(self) -> list[tuple[tuple[str, str], tuple[str, str]]]:
        """Connections of each mass with the previous and the next one."""
        pairs = list(zip(self.names, self.names[1:], strict=False))
        there = [((a, "x"), (b, "before")) for a, b in pairs]
        return there + [((b, "x"), (a, "after")) for a, b in pairs]

    def job(self) -> WiredLoop:
        """The chain for other masters."""
        return WiredLoop(
            {name: str(self.link) for name in self.names},
            self.connections(),
            [("plant", "push", 100.0)],
            ["x"],
            self.step,
            round(self.stop / self.step),
        )


Timed = TypeVar("Timed", TimedLoop, TimedChain)


def step_cost(host: str, loop: TimedLoop | TimedChain) -> float:
    """Microseconds per communication step of a loop in this host, in a separate process.

    The steps are run in one call, so that the host's Python interface is not included, and nothing
    is recorded. The process uses one core, on which libcosim and Ecos are fastest: on several
    cores, their threads wait for each other at Python's lock, and the time is two to seven times as
    long and varies.
    """
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        return float(run_in(host, loop.job(), timed=True))
    finally:
        os.sched_setaffinity(0, allowed)


def side_by_side(
    ours: Callable[[Timed], float], loops: Mapping[str, Timed], hosts: Sequence[str] = HOSTS
) -> dict[str, dict[str, float]]:
    """Microseconds per communication step, by loop and by master, the best of three rounds.

    Each round runs every master, so that other load on the machine affects all of them. Ecos is
    left out if its library cannot be loaded.

    Parameters
    ----------
    ours : function
        Gives our master's microseconds per step.
    loops : mapping of str to TimedLoop or TimedChain
    hosts : sequence of str

    Returns
    -------
    dict
        Microseconds by loop and by {"ours", "libcosim", "ecos", "container"}.
    """
    hosts = [host for host in hosts if host != "ecos" or not missing_for_ecos()]
    best = {name: dict.fromkeys(("ours", *hosts), math.inf) for name in loops}
    for _ in range(ROUNDS):
        for name, loop in loops.items():
            best[name]["ours"] = min(best[name]["ours"], ours(loop))
            for host in hosts:
                best[name][host] = min(best[name][host], step_cost(host, loop))
    return best

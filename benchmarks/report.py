"""What all tables of costs share: repeats, medians with scatter, ratios, and the machine's words.

A table is a function that takes a folder and returns works: by the name of each work, the programs
that do it. Its docstring is the heading and the text of the table.
"""

from __future__ import annotations

import inspect
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median, quantiles
from typing import Any, NamedTuple

OURS = "this program"  # other programs are compared with it
ENOUGH = 20.0  # s; what has taken longer is not repeated
FASTER = 0.97  # times ours: above, the difference is scatter
PACKAGES = (
    *("numpy", "scipy", "fmpy", "libcosimpy", "ecospy", "fmu_manipulation_toolbox", "casadi"),
    *("lmfit", "pysindy", "jitcode", "heyoka", "pynamicalsys", "distributed"),
)
UNITS = (1.0, "s"), (1e-3, "ms"), (0.0, "us")


class Cost(NamedTuple):
    """What a round has cost [s], and what else is said of it."""

    seconds: float
    note: str = ""


Program = Callable[[], object] | str
"""It is timed, unless it returns a `Cost`. A text says why there is no such program."""
Works = Mapping[str, Mapping[str, Program]]


@dataclass
class Costs:
    """All rounds of a program [s]."""

    name: str
    program: Program
    rounds: list[float] = field(default_factory=list)
    spent: float = 0.0
    note: str = ""

    def repeat(self) -> None:
        """Run the program once more, unless that takes too long."""
        if isinstance(self.program, str):
            self.note = self.program
        elif self.spent < ENOUGH:
            took, result = timed(self.program)
            cost = result if isinstance(result, Cost) else Cost(took)
            self.spent += took
            self.rounds.append(cost.seconds)
            self.note = cost.note

    def words(self) -> str:
        """The median, with half of the range between the quartiles."""
        if not self.rounds:
            return ""
        middle = median(self.rounds)
        least, unit = next(u for u in UNITS if middle >= u[0])
        text = f"{middle / (least or 1e-6):.3g} {unit}"
        if len(self.rounds) > 2:
            low, _, high = quantiles(self.rounds, method="inclusive")
            text += f" ±{50 * (high - low) / middle:.0f} %"
        return text

    def times(self, ours: Costs | None) -> str:
        """The ratio to our cost, bold if the other is faster."""
        if not (ours and ours.rounds and self.rounds):
            return ""
        ratio = median(self.rounds) / median(ours.rounds)
        other = not self.name.startswith(OURS)
        return f"**{ratio:.3g}**" if ratio < FASTER and other else f"{ratio:.3g}"


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of a call, and its result."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def measure(works: Works, rounds: int) -> dict[str, dict[str, Costs]]:
    """Run every program in each round, so that other load on the machine affects all of them.

    A failure of another program is a result, too.
    """
    found = {
        work: {n: Costs(n, p) for n, p in programs.items()} for work, programs in works.items()
    }
    for _ in range(rounds):
        for costs in (costs for programs in found.values() for costs in programs.values()):
            try:
                costs.repeat()
            except Exception as error:
                if costs.name.startswith(OURS):
                    raise
                said = str(error).strip().rpartition("\n")[2]
                costs.program = f"fails: {type(error).__name__}: {said[:120]}"
                costs.rounds.clear()
    return found


def page(table: Callable[[Path], Works], rounds: int, folder: Path) -> str:
    """The heading, text and rows of a table."""
    title, _, text = (inspect.getdoc(table) or "").partition("\n")
    found = measure(table(folder), rounds)
    noted = any(c.note and c.rounds for programs in found.values() for c in programs.values())
    rows = list((_long if noted else _wide)(found))
    rows.insert(1, ["---"] * len(rows[0]))
    return "\n".join([f"## {title}", text, "", *(f"| {' | '.join(row)} |" for row in rows), ""])


def _long(found: Mapping[str, Mapping[str, Costs]]) -> Iterator[list[str]]:
    """One row for each program of a work."""
    yield ["work", "program", "time", "times ours", ""]
    for work, programs in found.items():
        for name, costs in programs.items():
            yield [work, name, costs.words(), costs.times(programs.get(OURS)), costs.note]


def _wide(found: Mapping[str, Mapping[str, Costs]]) -> Iterator[list[str]]:
    """One row for each work, one column for each program; in brackets times ours."""
    names = dict.fromkeys(name for programs in found.values() for name in programs)
    yield ["work", *names]
    for work, programs in found.items():
        cells = []
        for costs in (programs.get(name, Costs(name, "")) for name in names):
            times = costs.times(programs.get(OURS))
            cells.append(f"{costs.words()} ({times})" if times else costs.note)
        yield [work, *cells]


def missing(package: str) -> str:
    """Why a package cannot be used; empty if it is installed."""
    return "" if _version(package) else "not installed"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def machine() -> str:
    """The processor and its load, Python, and the versions of all programs that are compared."""
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    model = info.partition("model name\t: ")[2].partition("\n")[0] or platform.machine()
    versions = ", ".join(f"{name} {_version(name) or 'not installed'}" for name in PACKAGES)
    return (
        f"{os.cpu_count()} cores, {model}, load {os.getloadavg()[0]:.1f}; "
        f"Python {platform.python_version()}, {versions}."
    )

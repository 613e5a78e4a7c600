"""The true parameters of random rigs are within the stated intervals.

By law and parameter, how many of the stated 95 % intervals contain the truth, with the binomial
interval of that share, and the same for identified parameters only. "Closed loop" are records of
the virtual rig with random parameters of the law, identified from 6 to 12 random trials of the
thesis' tables, in half of the rigs from a single table. "Prescribed motion" are laws along given
motions; load-cell noise, delay between force and motion and the scale of the fine position are
random for every rig. "Mass fitted" are laws along motions that accelerate, with an unknown mass
and, in half of them, a force that is up to four samples late or early: all results of `identify`
for law, mass and time are counted.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby
from typing import Any

from runner import Row, lower, seeds, upper

from ballscrew.measurement.identification.fitted_law import LAWS
from identification.rigs import (
    PRESCRIBED,
    identify_accelerated_rig,
    identify_closed_loop_rig,
    identify_random_rig,
)

STATED = 0.95
RIGS = 30  # of each law and group
GROUPS = {
    "closed_loop": identify_closed_loop_rig,
    "prescribed_motion": identify_random_rig,
    "mass_fitted": identify_accelerated_rig,
}
OF_A_MISS = ("seed", "parameter", "truth", "value", "low", "high")


def tasks(asked: Namespace) -> dict[str, tuple[str, str, int]]:
    pairs = [(g, law) for g in GROUPS for law in (LAWS if g == "closed_loop" else PRESCRIBED)]
    drawn = seeds(asked, RIGS, 0)
    return {f"{g}, {law}, {seed}": (g, law, seed) for g, law in pairs for seed in drawn}


def trial(group: str, law: str, seed: int) -> list[Row]:
    """One row for each parameter of a rig."""
    return [{"group": group, **asdict(o)} for o in GROUPS[group](law, seed)]


def short(value: Any) -> Any:
    """A number with the seven digits that are stored."""
    return float(f"{value:.7g}") if isinstance(value, float) else value


def of_parameter(rows: Sequence[Row]) -> Row:
    """Coverage of one parameter of one law."""
    hits, count = sum(r["covered"] for r in rows), len(rows)
    tail = (1 - STATED) / 2
    closed = [r for r in rows if r["low"] is not None and r["high"] is not None]
    widths = sorted((r["high"] - r["low"]) / 2 / r["value"] for r in closed)
    identified = [r for r in rows if r["identified"]]
    return {
        "rigs": count,
        "covered": hits,
        "share_95": [round(bound(hits, count, 1 - tail), 4) for bound in (lower, upper)],
        "identified": len(identified),
        "identified_and_covered": sum(r["covered"] for r in identified),
        "median_half_width": short(widths[len(widths) // 2]) if widths else None,
    }


def of_law(rows: Sequence[Row]) -> Row:
    """Coverage by parameter, time, and the intervals that miss the truth."""
    by_name: dict[str, list[Row]] = {}
    for r in rows:
        by_name.setdefault(r["parameter"], []).append(r)
    seconds = sorted({r["seed"]: r["seconds"] for r in rows}.values())
    parameters = {name: of_parameter(some) for name, some in by_name.items()}
    return {
        "not_held_by": [n for n, found in parameters.items() if found["share_95"][1] < STATED],
        "seeds": [min(r["seed"] for r in rows), max(r["seed"] for r in rows) + 1],
        "seconds": {"median": seconds[len(seconds) // 2], "longest": seconds[-1]},
        "parameters": parameters,
        "misses": [{k: short(r[k]) for k in OF_A_MISS} for r in rows if not r["covered"]],
    }


def report(found: Sequence[list[Row]]) -> Row:
    groups: Row = {"stated": STATED} | {group: {} for group in GROUPS}
    rows = [row for some in found for row in some]
    for (group, law), some in groupby(rows, key=lambda r: (r["group"], r["law"])):
        groups[group][law] = of_law([*some])
    return groups | {"holds": not any(law["not_held_by"] for law in laws_of(groups))}


def laws_of(report: Row) -> list[Row]:
    return [law for group in GROUPS for law in report[group].values()]


def says(report: Row) -> str:
    some = [p for law in laws_of(report) for p in law["parameters"].values()]
    covered, rigs = (sum(p[k] for p in some) for k in ("covered", "rigs"))
    return f"{covered} of {rigs} intervals contain the true value ({covered / rigs:.1%})"

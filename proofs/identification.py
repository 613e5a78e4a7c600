"""Proof: the true parameters of random rigs are within the stated intervals.

Writes ``docs/proof/identification.json``, again after every few rigs: by law and parameter, how
many of the stated 95 % intervals contain the truth, with the binomial interval of that share, the
same for identified parameters only, and whether the stated rate is reached. There are three groups.
"Closed loop" are records of the virtual rig with random parameters of the law, identified from 6 to
12 random trials of the thesis' tables, in half of the rigs from a single table. "Prescribed motion"
are laws along given motions; load-cell noise, delay between force and motion and the scale of the
fine position are random for every rig. "Mass fitted" are laws along motions that accelerate, with
an unknown mass and, in half of them, a force that is up to four samples late or early: all results
of `identify` for law, mass and time are counted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from provenance import provenance
from synthetic.rigs import (
    PRESCRIBED,
    Outcome,
    identify_accelerated_rig,
    identify_closed_loop_rig,
    identify_random_rig,
)

from ballscrew.measurement.identification.fitted_law import LAWS
from ballscrew.options import add_worker_options, open_workers
from ballscrew.solver.files import write_json

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "identification.json"

STATED = 0.95
OFTEN = 10  # rigs after which the file is written again


def binomial_interval(hits: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson interval of a share."""
    from scipy.stats import beta

    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, hits, trials - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, trials - hits)) if hits < trials else 1.0
    return low, high


def by_parameter(outcomes: Iterable[Outcome]) -> dict[str, dict[str, object]]:
    """Coverage by parameter of one law."""
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault(o.parameter, []).append(o)
    table: dict[str, dict[str, object]] = {}
    for parameter, group in groups.items():
        hits = sum(o.covered for o in group)
        low, high = binomial_interval(hits, len(group))
        widths = sorted(
            (o.high - o.low) / 2 / o.value
            for o in group
            if o.low is not None and o.high is not None
        )
        identified = [o for o in group if o.identified]
        table[parameter] = {
            "rigs": len(group),
            "covered": hits,
            "share": hits / len(group),
            "share_95": [low, high],
            "holds_stated_rate": high >= STATED,
            "with_a_bound": sum(o.low is not None or o.high is not None for o in group),
            "identified": len(identified),
            "identified_and_covered": sum(o.covered for o in identified),
            "median_half_width": widths[len(widths) // 2] if widths else None,
        }
    return table


def report_of(outcomes: list[Outcome]) -> dict[str, object]:
    """Coverage by parameter and, all parameters together, by trials; time and misses of one law."""
    seconds = sorted({o.seed: o.seconds for o in outcomes}.values())
    by_trials: dict[str, list[bool]] = {}
    for o in outcomes:
        by_trials.setdefault(o.trials, []).append(o.covered)
    rows = by_parameter(outcomes)
    short = [name for name, row in rows.items() if not row["holds_stated_rate"]]
    return {
        "stated_rate_is_held": not short,
        "not_held_by": short,
        "seeds": [min(o.seed for o in outcomes), max(o.seed for o in outcomes) + 1],
        "seconds_of_one_identification": {
            "median": seconds[len(seconds) // 2],
            "longest": seconds[-1],
        },
        "parameters": rows,
        "share_by_trials": {k: sum(v) / len(v) for k, v in by_trials.items()},
        "misses": [
            {
                k: getattr(o, k)
                for k in ("seed", "trials", "parameter", "truth", "value", "low", "high")
            }
            for o in outcomes
            if not o.covered
        ],
    }


GROUPS = {
    "closed_loop": identify_closed_loop_rig,
    "prescribed_motion": identify_random_rig,
    "mass_fitted": identify_accelerated_rig,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=100, help="rigs of each law and group")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--laws", nargs="+", default=list(LAWS), choices=list(LAWS))
    parser.add_argument("--groups", nargs="+", default=list(GROUPS), choices=list(GROUPS))
    add_worker_options(parser)
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.rigs)
    report: dict[str, object] = {**provenance("identification"), "stated": STATED}
    held = True
    workers = open_workers(options)
    for group in options.groups:
        laws: dict[str, object] = {}
        report[group] = laws
        for law in options.laws:
            if group != "closed_loop" and law not in PRESCRIBED:
                continue
            outcomes: list[Outcome] = []
            jobs = iter([(str(seed), (law, seed)) for seed in seeds])
            for done, (_, result) in enumerate(workers.map(GROUPS[group], jobs), start=1):
                outcomes += result
                if done % OFTEN == 0 or done == options.rigs:
                    print(f"{group}, {law}: {done} of {options.rigs}", file=sys.stderr)
                    laws[law] = report_of(sorted(outcomes, key=lambda o: o.seed))
                    write_json(options.out, report)
            print(f"{group}, {law}")
            for name, row in by_parameter(outcomes).items():
                print(
                    f"{name:<12}{row['covered']:>4} of {row['rigs']}, "
                    f"identified {row['identified']:>4}, "
                    f"half width {row['median_half_width'] or 0:.3g}"
                )
                held &= bool(row["holds_stated_rate"])
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())

"""Proof: the parameters of random rigs of known truth come back within their stated intervals.

Writes ``docs/proof/identification.json``: by law and parameter how many of the stated 95 %
intervals hold the truth, with the binomial interval of that share, and how often the parameter is
called identified. Load-cell noise and rounding, encoder counts with an unknown origin, the delay
between force and motion and the scale of the fine position are drawn anew for every rig.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "identification.json"
sys.path.insert(0, str(ROOT / "tests" / "support"))

from random_rigs import Outcome, identify_random_rig  # noqa: E402

from ballscrew.diagnosis.along_record import LAWS  # noqa: E402

STATED = 0.95


def binomial_interval(hits: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share."""
    from scipy.stats import beta

    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, hits, trials - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, trials - hits)) if hits < trials else 1.0
    return low, high


def summary(outcomes: Iterable[Outcome]) -> dict[str, dict[str, dict[str, object]]]:
    """Coverage by law and parameter."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault((o.law, o.parameter), []).append(o)
    table: dict[str, dict[str, dict[str, object]]] = {}
    for (law, parameter), group in groups.items():
        hits = sum(o.covered for o in group)
        low, high = binomial_interval(hits, len(group))
        widths = sorted(
            (o.high - o.low) / 2 / o.value
            for o in group
            if o.low is not None and o.high is not None
        )
        table.setdefault(law, {})[parameter] = {
            "rigs": len(group),
            "covered": hits,
            "share": hits / len(group),
            "share_95": [low, high],
            "holds_stated_rate": high >= STATED,
            "identified": sum(o.identified for o in group),
            "median_half_width": widths[len(widths) // 2] if widths else None,
        }
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=100, help="rigs of each law")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--laws", nargs="+", default=list(LAWS), choices=list(LAWS))
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.rigs)
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        for law in options.laws:
            results = pool.map(partial(identify_random_rig, law), seeds, chunksize=2)
            for done, result in enumerate(results, start=1):
                outcomes += result
                if done % 20 == 0:
                    print(f"{law}: {done} of {options.rigs}", file=sys.stderr)
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False, cwd=ROOT
    ).stdout.strip()
    table = summary(outcomes)
    seconds = sorted({(o.law, o.seed): o.seconds for o in outcomes}.values())
    report = {
        "commit": commit,
        "seeds": [seeds.start, seeds.stop],
        "stated": STATED,
        "seconds_of_one_identification": {
            "median": seconds[len(seconds) // 2],
            "longest": seconds[-1],
        },
        "summary": table,
        "misses": [
            {
                k: getattr(o, k)
                for k in ("law", "seed", "parameter", "truth", "value", "low", "high")
            }
            for o in outcomes
            if not o.covered
        ],
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    for law, rows in table.items():
        for parameter, row in rows.items():
            print(
                f"{law:<18}{parameter:<12}{row['covered']:>4} of {row['rigs']}, "
                f"identified {row['identified']:>4}, half width {row['median_half_width'] or 0:.3g}"
            )
    return 0 if all(r["holds_stated_rate"] for rows in table.values() for r in rows.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())

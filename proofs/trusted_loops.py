"""Proof: over random stiff linear and nonlinear loops, no wrong result is called trusted.

Writes ``docs/proof/trusted_loops.json``: provenance, seeds and every outcome. A result is wrong if
the error of some output is more than one percent of its range, and right if no error is more than a
third of that, compared with the exact solution or the complete loop in one solver. A loop for which
two such solutions differ by a hundredth of a percent is left out and counted, because its truth is
not known.

The verdict's constants were chosen on linear seeds below 6000 and nonlinear seeds below 1000; the
checks of command times and of switches came from loops with seeds from 30000 to 40200, so these are
not used.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import linear_loops
import nonlinear_loops
from provenance import provenance
from scipy.stats import beta

WRONG, RIGHT = 0.01, 0.01 / 3
CONFIDENCE = 0.95
TARGET = Path(__file__).resolve().parents[1] / "docs" / "proof" / "trusted_loops.json"

_SHOWN = "wrong", "wrong_called_trusted", "right", "right_called_trusted"

Row = dict[str, Any]


def upper_bound(found: int, trials: int) -> float:
    """One-sided Clopper-Pearson upper bound of a rate."""
    return float(beta.ppf(CONFIDENCE, found + 1, trials - found)) if found < trials else 1.0


def lower_bound(found: int, trials: int) -> float:
    """One-sided Clopper-Pearson lower bound of a rate."""
    return 1.0 - upper_bound(trials - found, trials)


def summary(rows: Sequence[Row]) -> Row:
    """Counts of right and wrong results, trusted and not, with bounds of their rates."""
    known = [r for r in rows if (r.get("doubt") or 0.0) <= nonlinear_loops.KNOWN * WRONG]
    wrong = [r for r in known if r["error"] is None or r["error"] > WRONG]
    right = [r for r in known if r["error"] is not None and r["error"] <= RIGHT]
    deceived = [r["seed"] for r in wrong if r["trusted"]]
    trusted = sum(r["trusted"] for r in right)
    return {
        "loops": len(rows),
        "truth_not_known": len(rows) - len(known),
        "wrong": len(wrong),
        "wrong_called_trusted": deceived,
        "of_wrong_upper_95": upper_bound(len(deceived), len(wrong)),
        "of_all_upper_95": upper_bound(len(deceived), len(known)),
        "right": len(right),
        "right_called_trusted": trusted,
        "right_called_trusted_rate": trusted / len(right) if right else None,
        "right_called_trusted_lower_95": lower_bound(trusted, len(right)) if right else None,
        "between": len(known) - len(wrong) - len(right),
    }


def summaries(linear: Sequence[Row], nonlinear: Sequence[Row]) -> dict[str, Row]:
    """Summaries of all linear loops, of all others, and of each family of the others."""
    families = {f: [r for r in nonlinear if r["family"] == f] for f in nonlinear_loops.FAMILIES}
    groups = {"linear": linear, "nonlinear": nonlinear, **families}
    return {name: summary(rows) for name, rows in groups.items()}


def plain(o: linear_loops.Outcome | nonlinear_loops.Outcome) -> Row:
    """An outcome for JSON: without the reason, and with null for numbers that are not finite."""
    row = asdict(o)
    del row["reason"]
    return {k: (None if isinstance(v, float) and v - v != 0 else v) for k, v in row.items()}


def _outcomes(
    pool: ProcessPoolExecutor, made: Callable[[int], Any], kind: str, seeds: range
) -> list[Row]:
    rows = []
    for done, result in enumerate(pool.map(made, seeds, chunksize=10), start=1):
        rows.append(plain(result))
        if done % 50 == 0:
            found = summary(rows)
            counts = ", ".join(f"{k} {found[k]}" for k in _SHOWN)
            print(f"{kind}: {done} of {len(seeds)}: {counts}", file=sys.stderr)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--linear", type=int, default=1000, help="loops")
    parser.add_argument("--nonlinear", type=int, default=400, help="loops, a quarter each family")
    parser.add_argument("--first", type=int, default=50_000, help="first seed of either")
    options = parser.parse_args()
    linear, nonlinear = (
        range(options.first, options.first + count) for count in (options.linear, options.nonlinear)
    )
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor() as pool:
        rows = {
            "nonlinear": _outcomes(pool, nonlinear_loops.outcome, "nonlinear", nonlinear),
            "linear": _outcomes(pool, linear_loops.outcome, "linear", linear),
        }
    report = {
        **provenance("trusted_loops"),
        "seeds": {
            "linear": [linear.start, linear.stop],
            "nonlinear": [nonlinear.start, nonlinear.stop],
        },
        "summary": summaries(**rows),
        "outcomes": rows,
    }
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(report["summary"], indent=2))
    return 1 if any(s["wrong_called_trusted"] for s in report["summary"].values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())

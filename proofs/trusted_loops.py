"""Proof: over a thousand random stiff loops, no wrong result is called trusted.

Writes ``docs/proof/trusted_loops.json``: provenance, seeds and every outcome. A result is wrong
where some output is off by more than a percent of its range against the exact solution.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

from linear_loops import Outcome, outcome
from provenance import provenance
from scipy.stats import binomtest

WRONG = 0.01
TARGET = Path(__file__).resolve().parents[1] / "docs" / "proof" / "trusted_loops.json"


def upper_bound(failures: int, trials: int) -> float:
    """Wilson's upper bound of a rate, one-sided, 95 %."""
    test = binomtest(failures, trials, alternative="less")
    return float(test.proportion_ci(0.95, method="wilson").high)


def summary(outcomes: list[Outcome]) -> dict[str, object]:
    """Counts of right and wrong results, trusted and not."""
    wrong = [o for o in outcomes if o.error > WRONG]
    right = [o for o in outcomes if o.error <= WRONG]
    deceived = [o.seed for o in wrong if o.trusted]
    return {
        "loops": len(outcomes),
        "wrong": len(wrong),
        "wrong_called_trusted": deceived,
        "wrong_called_trusted_rate_upper_95": upper_bound(len(deceived), len(wrong)),
        "right": len(right),
        "right_called_trusted": sum(o.trusted for o in right),
        "far_right": sum(o.error <= WRONG / 3 for o in right),
        "far_right_called_trusted": sum(o.trusted for o in right if o.error <= WRONG / 3),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.loops)
    outcomes = []
    with ProcessPoolExecutor() as pool:
        for done, result in enumerate(pool.map(outcome, seeds, chunksize=10), start=1):
            outcomes.append(result)
            if done % 50 == 0:
                print(f"{done} of {options.loops}", file=sys.stderr)
    report = {
        **provenance("trusted_loops"),
        "seeds": [seeds.start, seeds.stop],
        "summary": summary(outcomes),
        "outcomes": [_plain(o) for o in outcomes],
    }
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(report["summary"], indent=2))
    return 1 if summary(outcomes)["wrong_called_trusted"] else 0


def _plain(o: Outcome) -> dict[str, object]:
    row = asdict(o)
    del row["reason"]
    return {k: (None if isinstance(v, float) and v - v != 0 else v) for k, v in row.items()}


if __name__ == "__main__":
    raise SystemExit(main())

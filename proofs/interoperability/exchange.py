"""Proof: modes in model exchange work under the actions of hosts.

200 random runs, half of them by FMI 2.0 and half by FMI 3.0: a host adds round-off to the states,
uses random communication steps and tolerances, and stops before, at or after an event. At
tolerances of 1e-9 to 1e-6 a run may differ from co-simulation by at most ten times the effect of
the same tolerance, steps and round-off there. At any tolerance, a body must never stick above its
break-away force. Writes ``docs/proof/exchange.json`` with the commit, a hash of the code, the seeds
and all outcomes.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TARGET = ROOT / "docs" / "proof" / "exchange.json"
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "proofs")]

from exchange_courses import COMPONENTS, cases, complaint, outcome  # noqa: E402
from provenance import provenance  # noqa: E402

COURSES = 200


def main() -> int:
    rows, wrong = [], []
    for name, subject in COMPONENTS.items():
        for fmi in (2, 3):
            with tempfile.TemporaryDirectory() as folder:
                kernel, path = subject.made(fmi, Path(folder))
                for one in cases(name, fmi, COURSES // (2 * len(COMPONENTS))):
                    seen = outcome(kernel, path, one)
                    wrong += [f"{name}, FMI {fmi}, {said}" for said in [complaint(seen)] if said]
                    rows.append(
                        {
                            "component": name,
                            "fmi": fmi,
                            "seed": one.seed,
                            "tolerance": one.tolerance,
                            "distance": seen.distance,
                            "allowed": seen.allowed,
                            "held": seen.held,
                            "events": seen.events,
                            "travel": seen.travel,
                        }
                    )
    judged = [r["distance"] / r["allowed"] for r in rows if r["tolerance"] <= 1e-6]
    report = {
        **provenance("exchange"),
        "courses": len(rows),
        "wrong": wrong,
        "largest_share_of_allowed": max(judged),
        "largest_force_while_stuck": max(r["held"] for r in rows),
        "moved": sum(r["travel"] > 1e-6 for r in rows),
    }
    print(json.dumps(report, indent=1))
    TARGET.write_text(json.dumps({**report, "rows": rows}, indent=1) + "\n", encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())

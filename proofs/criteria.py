"""Proof: the criteria of Table 2.12 find the features of synthetic laws, and no others.

Writes ``docs/proof/criteria.json``: for each law its true features and those that were found, with
the margin to the threshold.
"""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from provenance import provenance
from synthetic.laws import MADE, judged

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "criteria.json"


def found(what: str) -> dict[str, dict[str, object]]:
    """Decision and margin of every feature of one synthetic law."""
    return {
        feature: {"decision": cell.decision, "margin": cell.margin}
        for feature, cell in judged(what).items()
    }


def main() -> int:
    with ProcessPoolExecutor() as pool:
        results = dict(zip(MADE, pool.map(found, MADE), strict=True))
    rows = {
        what: {"made": MADE[what][2].split(), "found": cells} for what, cells in results.items()
    }
    wrong = [
        what
        for what, row in rows.items()
        if [cell["decision"] for cell in row["found"].values()] != row["made"]
    ]
    least = min(cell["margin"] for row in rows.values() for cell in row["found"].values())
    report = {**provenance("criteria"), "wrong": wrong, "least_margin": least, "laws": rows}
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps({k: report[k] for k in ("commit", "wrong", "least_margin")}, indent=1))
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())

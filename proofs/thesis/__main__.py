"""Compare the thesis with this program, row by row: ``python proofs/thesis``.

Computes every row, and writes ``docs/proof/thesis.json``, from which the tables of
``docs/reproduction.md`` are made. ``--only E5 G`` computes rows or sections and prints them;
``--pictures`` draws the figures of Chapters 2 and 3 into ``docs/images``. Exit code 1: a row
differs and no reason is given.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from provenance import FOLDER, provenance

from thesis import ROWS, SECTIONS
from thesis.rows import differing


def _figures_of(letter: str) -> dict[str, float]:
    """All figures of a section, in one process: its rows share their runs."""
    return {label: float(row.here()) for label, row in ROWS.items() if label[0] == letter}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="ROW", help="E5, or a section: E")
    parser.add_argument("--pictures", action="store_true", help="draw the figures (two minutes)")
    asked = parser.parse_args()
    if asked.pictures:
        from thesis import law_pictures, pictures

        pictures.save_all()
        law_pictures.save_all()
        return 0
    if asked.only:
        for label in [r for r in ROWS for want in asked.only if want in (r, r[0])]:
            row, here = ROWS[label], ROWS[label].here()
            print(
                f"{label} {row.where}: {row.says}: thesis {row.printed or '-'}, here {here:.7g}: "
                f"{row.verdict(here).strip('*') or 'not counted'}"
            )
        return 0
    figures: dict[str, float] = {}
    with ProcessPoolExecutor(2) as pool:
        for found in pool.map(_figures_of, [s.letter for s in SECTIONS]):
            figures |= found
            print(f"{next(iter(found))[0]}: {len(found)} rows", file=sys.stderr)
    text = json.dumps({**provenance("thesis"), "figures": figures}, indent=1)
    (FOLDER / "thesis.json").write_text(text + "\n", encoding="utf-8")
    lines = differing(ROWS, figures)
    print("\n".join(lines) or "every difference has its reason")
    return 1 if lines else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Table 2.12 of the thesis: which friction law shows which feature, in the thesis and here.

Writes ``docs/proof/features.json``, Figs. 2.14 to 2.19 into ``docs/images/features/``, and the
table into ``docs/features.md``. ``--laws lugre dahl`` prints the table of these laws only, and
writes nothing. Exit code 1: in some trial an instrument or the screw was out of range.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from features.pictures import save_pictures
from features.table import feature_table
from provenance import provenance

DOCS = Path(__file__).resolve().parents[1] / "docs"
BEGIN, END = "<!-- made by proofs/table_2_12.py -->\n```text\n", "\n```\n<!-- until here -->"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laws", nargs="+", metavar="NAME", help="print these alone")
    options = parser.parse_args()
    table = feature_table(options.laws, 2, lambda text: print(text, file=sys.stderr))
    print(table.text())
    if not options.laws:
        report = {**provenance("features"), **table.to_dict()}
        text = json.dumps(report, indent=1, allow_nan=False)
        (DOCS / "proof" / "features.json").write_text(text + "\n", encoding="utf-8")
        pictures = DOCS / "images" / "features"
        pictures.mkdir(exist_ok=True)
        save_pictures(table.observations, pictures)
        page = DOCS / "features.md"
        before, rest = page.read_text(encoding="utf-8").split(BEGIN)
        after = rest.split(END)[1]
        page.write_text(before + BEGIN + table.text() + END + after, encoding="utf-8")
    for note in table.notes:
        print(f"not trusted: {note}", file=sys.stderr)
    return 1 if table.notes else 0


if __name__ == "__main__":
    raise SystemExit(main())

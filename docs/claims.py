"""Figures on the pages beside the stored proofs that they come from.

``python docs/claims.py`` prints a line for each sentence of ``docs/claims.toml`` that does not
stand on its page with the figures of now, and ends with 1 if there is one. ``--write`` puts the
numbers right on the pages and writes ``docs/claims.md``. The site's build stops on such a line.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "proofs")]
import provenance  # noqa: E402
from claim_figures import figure  # noqa: E402

FILE = tomllib.loads((ROOT / "docs" / "claims.toml").read_text(encoding="utf-8"))
PAGE = ROOT / "docs" / "claims.md"
NUMBER = r"(?<![\w.])([-+]?\d+(?: \d{3})*(?:\.\d+)?(?:e[-+]?\d+)?|[A-Za-z]+)(?!\w|\.\d)"


def plain(text: str) -> tuple[str, list[int]]:
    """The text without links, emphasis, marks of code and breaks, and where each letter was."""
    kept = []
    for found in re.finditer(r"(\]\([^)\s]*\)|[][*`\\])|(\s+)|.", text):
        if not found[1]:
            kept.append((" " if found[2] else found[0], found.start()))
    return "".join(letter for letter, _ in kept), [place for _, place in kept]


def claims() -> list[dict[str, Any]]:
    """The claims one by one, each with its figures of ``now``; ``{k}`` is a key of ``each``."""
    reports = {name: provenance.stored(name) for name in FILE["commands"]}
    found = []
    for claim in FILE["claim"]:
        for k in claim.get("each", [""]):
            how = {n: v.replace("{k}", k) for n, v in claim.get("figures", {}).items()}
            now = {n: figure(v, reports[claim["proof"]]) for n, v in how.items()}
            said = {name: claim[name].replace("{k}", k) for name in ("page", "says")}
            found.append(claim | said | {"now": now, "key": k})
    return found


def is_there(place: str) -> bool:
    """Whether there is such a ``FILE``, or ``FILE::FUNCTION``."""
    file, _, function = place.partition("::")
    sought = f"\ndef {function}(" if function else ""
    return (ROOT / file).is_file() and sought in (ROOT / file).read_text(encoding="utf-8")


def check(root: Path = ROOT, write: bool = False) -> list[str]:
    """A line for each claim that does not hold on the pages of a folder."""
    stale = []
    for claim in claims():
        page, path, now = claim["page"], root / claim["page"], claim["now"]
        text = path.read_text(encoding="utf-8")
        letters, places = plain(text)
        parts, order = re.split(r"\{(\w+)\}", claim["says"]), []
        for k, part in enumerate(parts):
            if k % 2 and re.fullmatch(NUMBER, now[part]):
                parts[k] = NUMBER
                order.append(now[part])
            else:  # a figure that is words, such as a name, has to stand as it is
                exact = re.escape(plain(now[part] if k % 2 else part)[0])
                parts[k] = exact.replace(re.escape("..."), "[^|]*")
        found = list(re.finditer("".join(parts), letters))
        if len(found) != 1:
            stale.append(f"{page}: found {len(found)} times, not once: {claim['says']}")
            continue
        if not is_there(claim.get("by", "docs/claims.toml")):
            stale.append(f"{page}: {claim['by']} is not there to prove: {claim['says']}")
        for k, right in reversed(list(enumerate(order, start=1))):
            if found[0][k] != right:
                stale.append(f"{page}: {found[0][k]} has to be {right}: {found[0][0]}")
                end = places[found[0].end(k) - 1] + 1
                text = text[: places[found[0].start(k)]] + right + text[end:]
        if write:
            path.write_text(text, encoding="utf-8")
    return stale


def overview(ages: bool = False) -> str:
    """The text of ``docs/claims.md``; with the files that have other code since, on request."""
    head = [
        "claim",
        "page",
        "proof",
        "repeat it",
        "commit",
        "of",
        *["files with other code since"] * ages,
    ]
    rows = [head, ["---"] * len(head)]
    for claim in claims():
        keys = claim.get("each", [""])
        if claim["key"] != keys[0]:
            continue
        said = re.sub(r"\{(\w+)\}", lambda found, now=claim["now"]: now[found[1]], claim["says"])
        said = said.strip("| ").replace("|", "/").replace("*", "\\*")
        more = f" (and {len(keys) - 1} rows more)" if len(keys) > 1 else ""
        row = [said + more, re.sub(r"^docs/(.+)", r"[\1](\1)", claim["page"])]
        if name := claim.get("proof"):
            stored = provenance.stored(name)
            changed = provenance.changed_files(name, stored["commit"]) if ages else None
            row += [f"[{name}.json](proof/{name}.json)", f"`python {FILE['commands'][name]}`"]
            row += [stored["commit"][:12], stored["committed"][:10]]
            row += ["not known" if changed is None else str(len(changed))] * ages
        else:
            run = "pytest" if claim["by"].startswith("tests/") else "python"
            row += [f"`{claim['by'].partition('::')[0]}`", f"`{run} {claim['by']}`"]
            row += ["-"] * (len(head) - 4)
        rows.append(row)
    return FILE["head"].lstrip() + "\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the pages right")
    if parser.parse_args().write:
        print("\n".join(check(write=True)))
        PAGE.write_text(overview(), encoding="utf-8")
    stale = check()
    print("\n".join(stale) or f"{len(claims())} claims stand as they are proved now")
    return 1 if stale else 0


if __name__ == "__main__":
    raise SystemExit(main())

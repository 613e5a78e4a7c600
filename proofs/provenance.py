"""Where a stored proof came from: the commit of the code and the command."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "proof"
SHOWS = {  # {packages}: how many the file has
    "trusted_loops": "random loops, linear and nonlinear: no wrong result is trusted",
    "networks": "random networks of 3 to 20 FMUs: no wrong result is trusted",
    "fuzz": "damaged and hostile files: one line and an exit code, nothing else",
    "identification": "intervals of identified parameters contain the true value",
    "variational": "exponents over FMUs agree with those of one solver",
    "diagnosis_rule": "how often causes are named rightly and wrongly, by world",
    "thesis": "what the thesis says and prints, and what is computed here",
    "emps": "which effects added to the record of a real machine are named",
    "tro2021": "friction of two measured drives by direction, tested on speeds left out",
    "own_records": "which causes are named on records of this program, with its own parameters",
    "practice": "longest sampling periods and delays of the controllers; where they hunt",
    "swap_study": "equal controllers are seldom called different, one a tenth worse mostly is",
    "exchange": "plants that stick and slide, in model exchange with a simulated host",
    "tools": "{packages} other tools run the exported files without changes",
    "made_by_others": "controllers made by {packages} other programs run here and are trusted",
    "modelica": "two other compilers solve the exported Modelica like our solver",
    "interrupts": "interrupted and killed commands end in time and keep the previous run complete",
}


def git(*arguments: str) -> str:
    """Output of git; an empty string outside a checkout."""
    return subprocess.run(
        ["git", *arguments], capture_output=True, text=True, check=False, cwd=ROOT
    ).stdout.strip()


def provenance(name: str) -> dict[str, str]:
    """The first entries of the file ``name.json``.

    ``commit`` ends in ``-dirty`` if files outside ``docs/``, where the proofs are written, differ
    from it; ``committed`` is its time, ``command`` what runs.
    """
    if name not in SHOWS:
        raise KeyError(f"{name} has to stand in SHOWS of {__file__}")
    commit = git("rev-parse", "HEAD")
    if git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)docs"):
        commit += "-dirty"
    script = Path(sys.argv[0]).resolve()
    if script.name == "__main__.py":
        script = script.parent
    place = script.relative_to(ROOT) if script.is_relative_to(ROOT) else script.name
    return {
        "commit": commit,
        "committed": git("show", "-s", "--format=%cI", "HEAD"),
        "command": " ".join(["python", str(place), *sys.argv[1:]]),
    }


def stored(name: str) -> dict[str, Any]:
    """A proof's file."""
    report: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return report

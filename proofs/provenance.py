"""Which code a stored proof stands for, how old that code is, and whether it changed since.

``python proofs/provenance.py`` prints one line for each file of ``docs/proof/``: its commit, the
day of that commit, and how many commits have changed the code that the proof depends on since then.
``--write`` puts commit, day and seeds into ``docs/proof/README.md``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "proof"
PAGE = FOLDER / "README.md"
LOOP = ("solver", "plant", "controllers", "fmus", "orchestration")
ESTIMATED = ("records", "identification")
DEPENDS_ON = {
    "trusted_loops": (
        "orchestration solver plant/classical.py plant/lugre.py fmus/feedback_law.py "
        "proofs/linear_loops.py proofs/nonlinear_loops.py"
    ).split(),
    "networks": (
        "orchestration solver fmus/native fmus/feedback_law.py fmus/system_reading.py "
        "fmus/system_network.py fmus/system_parameters.py proofs/networks.py"
    ).split(),
    "fuzz": ("ballscrew", *LOOP, "proofs/mutations.py", "proofs/fuzz.py"),
    "identification": (
        "solver",
        "plant",
        "rig",
        "records",
        "identification",
        "proofs/synthetic",
    ),
    "criteria": ("solver", "plant", "rig", "proofs/features", "proofs/synthetic/laws.py"),
    "features": ("solver", "plant", "rig", "proofs/features"),
    "tables_of_trials": ("identification/stribeck_fit.py", "proofs/thesis_trials"),
    "variational": (*LOOP, "proofs/variational.py"),
    "diagnosis_sets": (
        "solver",
        "plant",
        *ESTIMATED,
        "diagnosis",
        "proofs/worlds",
        "proofs/calibrate_sets.py",
    ),
    "diagnosis_held_back": (
        "solver",
        "plant",
        *ESTIMATED,
        "diagnosis",
        "proofs/worlds",
        "proofs/calibrate_sets.py",
    ),
    "ablation": (
        "solver",
        "plant",
        *ESTIMATED,
        "diagnosis",
        "proofs/worlds",
        "proofs/ablation.py",
    ),
    "diagnosis_loop": (
        "solver",
        "plant",
        *ESTIMATED,
        "diagnosis",
        "proofs/worlds",
        "proofs/diagnosis_loop.py",
    ),
    "reproduction": (*LOOP, "proofs/reproduction.py", "proofs/thesis"),
    "emps": ("solver", "plant", *ESTIMATED, "diagnosis", "proofs/emps.py"),
    "tro2021": ("solver", "plant", *ESTIMATED, "diagnosis", "proofs/tro2021.py"),
    "own_records": ("ballscrew", *LOOP, "rig", *ESTIMATED, "diagnosis", "proofs/own_records.py"),
    "practice": (*LOOP, "instruments", "stability", "proofs/practice.py"),
    "swap_study": ("solver", "plant", "controllers", "orchestration/study", "proofs/swap_study.py"),
    "exchange": (
        "solver",
        "plant",
        "fmus",
        "proofs/exchange.py",
        "tests/support/exchange_host.py",
        "tests/support/exchange_courses.py",
    ),
    "tools": (*LOOP, "proofs/tools.py", "proofs/hosts"),
    "made_by_others": (*LOOP, "proofs/made_by_others.py", "proofs/makers"),
    "modelica": ("solver", "plant", "controllers", "fmus/modelica.py", "proofs/modelica.py"),
    "interrupts": (
        "ballscrew orchestration/run_folder.py orchestration/operating_system.py "
        "orchestration/isolated.py orchestration/workers.py "
        "tests/support/long_commands.py proofs/interrupts.py"
    ).split(),
}
SHOWS = {
    "trusted_loops": "random loops, linear and not: no wrong result is called trusted",
    "networks": "random networks of 3 to 20 FMUs: no wrong result is called trusted",
    "fuzz": "damaged and hostile files: one line and an exit code, nothing else",
    "identification": "intervals of identified parameters hold the truth",
    "criteria": "the features of made-up friction laws are found",
    "features": "which friction law shows which feature: Table 2.12 beside the thesis'",
    "tables_of_trials": "what scatters in the thesis' tables of trials; what an average costs",
    "variational": "exponents over FMUs are those of one solver",
    "diagnosis_sets": "what sets of suspects hold, by records of thirteen worlds",
    "diagnosis_held_back": "what sets hold, by records of two worlds never calibrated with",
    "ablation": "what each piece of the scores of a diagnosis brings",
    "diagnosis_loop": "whole diagnoses of worlds' records, before and after the next experiment",
    "reproduction": "Chapter 3 of the thesis beside this program",
    "emps": "effects hidden in the record of a real machine are named",
    "tro2021": "friction of two measured drives by direction, judged on speeds left out",
    "own_records": "what is named on records of this program, its parameters believed",
    "practice": "longest sampling periods and delays of the controllers; where they hunt",
    "swap_study": "equal controllers are seldom called different, one a tenth worse mostly is",
    "exchange": "plants that stick and slide, as model exchange, stand what hosts do",
    "tools": "thirteen tools of others run the exported files as they are",
    "made_by_others": "controllers made by seven programs of others run here and are trusted",
    "modelica": "two compilers of others solve the written Modelica as our solver does",
    "interrupts": "interrupted and killed commands end in time and leave the run before whole",
}


def git(*arguments: str) -> str:
    """What git prints; an empty string outside a checkout."""
    return subprocess.run(
        ["git", *arguments], capture_output=True, text=True, check=False, cwd=ROOT
    ).stdout.strip()


def code_digest(name: str) -> str:
    """Digest of the files that the proof depends on, as they are now."""
    digest = hashlib.sha256()
    for place in DEPENDS_ON[name]:
        path = ROOT / place
        files = [path] if path.is_file() else sorted(path.rglob("*.*"))
        for file in files:
            if file.suffix in (".py", ".c", ".h"):
                digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def provenance(name: str) -> dict[str, str]:
    """The first entries of a proof's file.

    Parameters
    ----------
    name : str
        The file's name without ``.json``.

    Returns
    -------
    dict
        ``commit``, with ``-dirty`` behind it where files differ from it; ``committed``, the time
        of that commit; ``code``, the digest of the files that the proof depends on.
    """
    commit = git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    return {
        "commit": commit,
        "committed": git("show", "-s", "--format=%cI", "HEAD"),
        "code": code_digest(name),
    }


def stored(name: str) -> dict[str, Any]:
    """A proof's file."""
    report: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return report


def changes_since(name: str, commit: str) -> int | None:
    """Commits since then that changed what the proof depends on; None where git does not know."""
    counted = git("rev-list", "--count", f"{commit.split('-')[0]}..HEAD", "--", *DEPENDS_ON[name])
    return int(counted) if counted else None


def page() -> str:
    """The text of ``docs/proof/README.md``."""
    lines = [
        "# Stored proofs",
        "",
        "Each file is what a command of `make prove` found, and stands for the code of one commit.",
        "`python proofs/provenance.py` counts how often that code has changed since. `make test`",
        "repeats a few trials by their seeds and fails where the results differ",
        "(`tests/test_stored_proofs.py`). The whole is repeated by hand only.",
        "",
        "| file | what it shows | commit | of |",
        "|---|---|---|---|",
    ]
    for name, shows in SHOWS.items():
        report = stored(name)
        day = report["committed"][:10]
        lines.append(f"| [{name}.json]({name}.json) | {shows} | {report['commit'][:12]} | {day} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write docs/proof/README.md, too")
    if parser.parse_args().write:
        PAGE.write_text(page(), encoding="utf-8")
    for name in SHOWS:
        report = stored(name)
        changes = changes_since(name, report["commit"])
        since = (
            "git does not know" if changes is None else f"its code changed {changes} times since"
        )
        print(f"{name:<16}{report['commit'][:12]}  {report['committed'][:10]}  {since}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

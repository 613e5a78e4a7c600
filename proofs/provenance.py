"""The code of a stored proof, the age of that code, and whether it changed since then.

``python proofs/provenance.py`` prints one line for each file of ``docs/proof/``: its commit, the
day of that commit, and how many of the files that the proof depends on have changed code since
then. Comments, docstrings and layout do not count as code. ``--write`` writes commit and day into
``docs/proof/README.md``.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import re
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "proof"
PAGE = FOLDER / "README.md"
CODE = (".py", ".c", ".h", ".csv", ".json", ".toml", ".jinja")
LOOP = ("solver", "plant", "controllers", "fmus", "orchestration")
ESTIMATED = ("measurement/records", "measurement/identification")
DIAGNOSED = (*ESTIMATED, "measurement/diagnosis")
DEPENDS_ON = {
    "trusted_loops": (
        "orchestration solver plant/classical.py plant/lugre.py fmus/feedback_law.py "
        "proofs/linear_loops.py proofs/nonlinear_loops.py"
    ).split(),
    "networks": (
        "orchestration solver fmus/native fmus/feedback_law.py fmus/system_reading.py "
        "fmus/system_network.py proofs/networks.py tests/support/networks_of_parts.py"
    ).split(),
    "fuzz": ("ballscrew", *LOOP, "proofs/mutations.py", "proofs/fuzz.py"),
    "identification": (
        "solver",
        "plant",
        "measurement/rig",
        *ESTIMATED,
        "proofs/synthetic",
    ),
    "variational": (*LOOP, "proofs/variational.py"),
    "diagnosis_sets": (
        "solver",
        "plant",
        *DIAGNOSED,
        "proofs/worlds",
        "proofs/calibrate_sets.py",
    ),
    "diagnosis_held_back": (
        "solver",
        "plant",
        *DIAGNOSED,
        "proofs/worlds",
        "proofs/calibrate_sets.py",
    ),
    "ablation": (
        "solver",
        "plant",
        *DIAGNOSED,
        "proofs/worlds",
        "proofs/ablation.py",
    ),
    "diagnosis_loop": (
        "solver",
        "plant",
        *DIAGNOSED,
        "proofs/worlds",
        "proofs/diagnosis_loop.py",
    ),
    "thesis": (*LOOP, "measurement/rig", "proofs/thesis"),
    "emps": ("solver", "plant", *DIAGNOSED, "proofs/emps.py"),
    "tro2021": ("solver", "plant", *DIAGNOSED, "proofs/tro2021.py"),
    "own_records": ("ballscrew", *LOOP, "measurement/rig", *DIAGNOSED, "proofs/own_records.py"),
    "practice": (*LOOP, "plant/instruments", "stability", "proofs/practice.py"),
    "swap_study": ("solver", "plant", "controllers", "orchestration/study", "proofs/swap_study.py"),
    "exchange": (
        "solver",
        "plant",
        "fmus",
        "proofs/interoperability/exchange.py",
        "tests/support/exchange_host.py",
        "tests/support/exchange_courses.py",
    ),
    "tools": (*LOOP, "proofs/interoperability"),
    "made_by_others": (*LOOP, "proofs/interoperability"),
    "modelica": ("solver", "plant", "controllers", "fmus/modelica.py", "proofs/interoperability"),
    "interrupts": (
        "ballscrew orchestration/loop/run_folder.py orchestration/fmu/operating_system.py "
        "orchestration/fmu/isolated.py orchestration/study/workers.py "
        "tests/support/long_commands.py proofs/interrupts.py"
    ).split(),
}
SHOWS = {
    "trusted_loops": "random loops, linear and nonlinear: no wrong result is trusted",
    "networks": "random networks of 3 to 20 FMUs: no wrong result is trusted",
    "fuzz": "damaged and hostile files: one line and an exit code, nothing else",
    "identification": "intervals of identified parameters contain the true value",
    "variational": "exponents over FMUs agree with those of one solver",
    "diagnosis_sets": "how often sets contain the right cause, for records of thirteen worlds",
    "diagnosis_held_back": "the same for records of two worlds not used for the calibration",
    "ablation": "contribution of each piece of the scores of a diagnosis",
    "diagnosis_loop": "whole diagnoses of worlds' records, before and after the next experiment",
    "thesis": "what the thesis says and prints, and what is computed here",
    "emps": "which effects added to the record of a real machine are named",
    "tro2021": "friction of two measured drives by direction, tested on speeds left out",
    "own_records": "which causes are named on records of this program, with its own parameters",
    "practice": "longest sampling periods and delays of the controllers; where they hunt",
    "swap_study": "equal controllers are seldom called different, one a tenth worse mostly is",
    "exchange": "plants that stick and slide, in model exchange with a simulated host",
    "tools": "thirteen other tools run the exported files without changes",
    "made_by_others": "controllers made by seven other programs run here and are trusted",
    "modelica": "two other compilers solve the exported Modelica like our solver",
    "interrupts": "interrupted and killed commands end in time and keep the previous run complete",
}


def git(*arguments: str) -> str:
    """Output of git; an empty string outside a checkout."""
    return subprocess.run(
        ["git", *arguments], capture_output=True, text=True, check=False, cwd=ROOT
    ).stdout.strip()


def code_digest(name: str) -> str:
    """Digest of the present files that the proof depends on."""
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
        ``commit``, with ``-dirty`` behind it if files outside ``docs/``, where the proofs are
        written, differ from it; ``committed``, the time of that commit; ``code``, the digest of
        the files that the proof depends on.
    """
    commit = git("rev-parse", "HEAD")
    if git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)docs"):
        commit += "-dirty"
    return {
        "commit": commit,
        "committed": git("show", "-s", "--format=%cI", "HEAD"),
        "code": code_digest(name),
    }


def stored(name: str) -> dict[str, Any]:
    """A proof's file."""
    report: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return report


@cache
def changed_files(name: str, commit: str) -> list[str] | None:
    """Files that the proof depends on and whose code differs from that of the commit.

    Returns
    -------
    list of str, or None
        None if git does not know the commit.
    """
    commit = commit.split("-")[0]
    if not git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"):
        return None
    paths = git("diff", "--name-only", commit, "--", *DEPENDS_ON[name]).splitlines()
    return [p for p in paths if p.endswith(CODE) and _differs(p, commit)]


@cache  # proofs have commits and files in common
def _differs(path: str, commit: str) -> bool:
    now, before = ROOT / path, git("show", f"{commit}:{path}")
    if not now.exists() or not before:
        return True
    return code_of(path, before) != code_of(path, now.read_text("utf-8"))


def code_of(path: str, text: str) -> str:
    """The code of a file, without comments, docstrings and layout."""
    if path.endswith(".py"):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [n for n in body if not _is_text(n)]  # type: ignore[attr-defined]
        return ast.dump(tree)
    if path.endswith((".c", ".h")):
        text = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.DOTALL)
    return " ".join(text.split())


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def page() -> str:
    """The text of ``docs/proof/README.md``."""
    lines = [
        "# Stored proofs",
        "",
        "Each file is the result of a command of `make prove` for the code of one commit.",
        "`python proofs/provenance.py` counts the files that have other code since then.",
        "CI repeats a few trials with their seeds and fails if the results differ",
        "(`tests/test_stored_proofs.py`). All of it is repeated by hand only.",
        "",
        "| file | what it shows | commit | date |",
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
        changed = changed_files(name, report["commit"])
        if changed is None:
            since = "git does not know this commit"
        else:
            since = f"{len(changed)} files have other code" if changed else "of this code"
        print(f"{name:<20}{report['commit'][:12]}  {report['committed'][:10]}  {since}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

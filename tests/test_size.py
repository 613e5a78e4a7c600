"""No folder grows: its non-blank lines, and its code without docstrings, are at most these.

A commit that takes lines out lowers its number. A number is raised only together with a larger one
lowered, and the commit says why.
"""

from __future__ import annotations

import ast
import subprocess
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST = {  # folder: lines, lines without docstrings
    "solver": (5911, 5260),
    "plant": (1688, 1409),
    "controllers": (1215, 955),
    "fmus": (4970, 4446),
    "orchestration": (9114, 8000),
    "stability": (2800, 2295),
    "ballscrew": (3499, 2893),
    "gallery": (2728, 2354),
    "measurement": (10474, 9146),
    "proofs": (6898, 6297),
    "benchmarks": (1098, 952),
    "docs": (293, 265),
    ".ci": (204, 184),
    "tests": (21978, 20970),
}
CODE = (".py", ".c", ".h", ".jinja")


def files() -> list[Path]:
    """What git tracks; in a copy without git all files of the folders."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z"]
    if (ROOT / ".git").exists():
        done = subprocess.run(command, capture_output=True, check=True, encoding="utf-8")
        return [path for name in done.stdout.split("\0")[:-1] if (path := ROOT / name).is_file()]
    return [path for folder in MOST for path in (ROOT / folder).rglob("*.*")]


def docstrings(text: str) -> set[int]:
    """The numbers of their lines."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    bodies = (n.body for n in ast.walk(ast.parse(text)) if isinstance(n, owners) and n.body)
    firsts = (body[0] for body in bodies if isinstance(body[0], ast.Expr))
    texts = (n.value for n in firsts if isinstance(n.value, ast.Constant))
    of_text = (n for n in texts if isinstance(n.value, str))
    return {line for n in of_text for line in range(n.lineno, (n.end_lineno or n.lineno) + 1)}


def sizes() -> tuple[Counter[str], Counter[str]]:
    """Non-blank lines, and those outside docstrings, by folder."""
    lines, code = Counter[str](), Counter[str]()
    for path in files():
        folder, *rest = path.relative_to(ROOT).parts
        table = path.suffix == ".toml" and folder == "docs" and "examples" not in rest
        if rest and (path.suffix in CODE or table):
            text = path.read_text("utf-8")
            inside = docstrings(text) if path.suffix == ".py" else set()
            filled = [n for n, line in enumerate(text.split("\n"), 1) if line.strip()]
            lines[folder] += len(filled)
            code[folder] += len(set(filled) - inside)
    return lines, code


@pytest.fixture(scope="module")
def today() -> tuple[Counter[str], Counter[str]]:
    return sizes()


@pytest.mark.parametrize("folder", MOST)
def test_a_folder_has_no_more_lines_than_before(today, folder: str) -> None:
    lines, code = (of[folder] for of in today)
    most, most_code = MOST[folder]
    assert lines <= most, f"{lines - most} lines too many in {folder}/"
    assert code <= most_code, f"{code - most_code} lines of code too many in {folder}/"


def test_every_folder_with_code_has_a_number(today) -> None:
    assert set(today[0]) == set(MOST)

"""The worlds import nothing of the program that they judge."""

from __future__ import annotations

import ast
from pathlib import Path

import worlds

PACKAGE = Path(worlds.__file__).parent
ALLOWED = {
    "__future__", "collections", "dataclasses", "getpass", "hashlib", "math", "os", "pathlib",
    "tempfile", "typing", "zlib",
    "numba", "numpy", "scipy", "worlds",
}  # fmt: skip


def imported(path: Path) -> set[str]:
    """Top names of all that a file imports, at any depth."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").split(".")[0])
        elif isinstance(node, ast.Name) and node.id in ("__import__", "importlib"):
            found.add(node.id)
    return found


def test_only_numerical_libraries_and_itself_are_imported():
    files = sorted(PACKAGE.glob("*.py"))
    assert len(files) > 10
    strange = {f.name: imported(f) - ALLOWED for f in files}
    assert not any(strange.values()), strange

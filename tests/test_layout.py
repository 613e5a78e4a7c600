"""A part of the program imports from its own folder and from those that it stands on."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STANDS_ON_THOSE_BEFORE = (
    "solver plant/instruments plant controllers fmus measurement/records orchestration/fmu "
    "orchestration/master orchestration/loop orchestration/study stability measurement/rig "
    "measurement/identification measurement/diagnosis ballscrew gallery"
).split()


def room_of(parts: tuple[str, ...]) -> str:
    """The folder of a file or of a module, in the list above."""
    two = "/".join(parts[:2])
    return two if two in STANDS_ON_THOSE_BEFORE else parts[0]


def imported(source: Path) -> Iterator[tuple[int, str]]:
    """Line and folder of each import from this project."""
    folder = source.relative_to(ROOT).parent.parts
    package = folder if folder[0] == "ballscrew" else ("ballscrew", *folder)
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            module = tuple(node.module.split(".")) if node.module else ()
            full = (*package[: len(package) - node.level + 1], *module) if node.level else module
            modules = [(*full, a.name) for a in node.names]
        elif isinstance(node, ast.Import):
            modules = [tuple(a.name.split(".")) for a in node.names]
        else:
            continue
        for module in modules:
            if module[0] == "ballscrew":
                room = room_of(module[1:] or ("ballscrew",))
                yield node.lineno, room if room in STANDS_ON_THOSE_BEFORE else "ballscrew"


@pytest.mark.parametrize("folder", STANDS_ON_THOSE_BEFORE)
def test_a_folder_imports_only_what_it_stands_on(folder: str) -> None:
    rank = STANDS_ON_THOSE_BEFORE.index(folder)
    inside = [
        p for p in (ROOT / folder).rglob("*.py") if room_of(p.relative_to(ROOT).parts) == folder
    ]
    assert inside
    against = [
        f"{source.relative_to(ROOT)}:{line} imports {name}"
        for source in sorted(inside)
        for line, name in imported(source)
        if STANDS_ON_THOSE_BEFORE.index(name) > rank
    ]
    assert not against


def test_the_reader_of_imports_sees_both_ways_of_writing_them() -> None:
    command = ROOT / "ballscrew" / "measured_commands.py"
    assert "measurement/identification" in {name for _, name in imported(command)}
    assert {name for _, name in imported(ROOT / "plant" / "lugre.py")} <= {"solver", "plant"}


def test_systems_of_the_gallery_use_the_public_api_alone() -> None:
    """And what all of them share, one folder up."""
    against = []
    for source in sorted((ROOT / "gallery").glob("*/*.py")):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module or ""]
            against += [f"{source}: {n}" for n in names if n.startswith("ballscrew.")]
            if isinstance(node, ast.ImportFrom) and node.level > 1:
                shared = ("drawing", "finding")
                against += [f"{source}: {node.module}"] if node.module not in shared else []
    assert not against


def test_every_folder_that_is_installed_has_its_place() -> None:
    found = {p.parent.name for p in ROOT.glob("*/__init__.py") if not p.parent.name.startswith(".")}
    assert found - {"tests", "proofs"} == {name.split("/")[0] for name in STANDS_ON_THOSE_BEFORE}

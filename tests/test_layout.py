"""A part of the program imports from its own folder and from those that it stands on."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
STANDS_ON_THOSE_BEFORE = (
    *("solver", "instruments", "plant", "controllers", "fmus", "orchestration"),
    *("stability", "rig", "records", "identification", "diagnosis", "ballscrew"),
    "gallery",
)


def imported(source: Path) -> Iterator[tuple[int, str]]:
    """Line and folder of each import from this project."""
    folder = source.relative_to(ROOT).parent.parts
    package = folder if folder[0] == "ballscrew" else ("ballscrew", *folder)
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        module = tuple(node.module.split(".")) if node.module else ()
        full = (*package[: len(package) - node.level + 1], *module) if node.level else module
        if full[0] != "ballscrew":
            continue
        for name in [a.name for a in node.names] if len(full) == 1 else [full[1]]:
            yield node.lineno, name if name in STANDS_ON_THOSE_BEFORE else "ballscrew"


@pytest.mark.parametrize("folder", STANDS_ON_THOSE_BEFORE)
def test_a_folder_imports_only_what_it_stands_on(folder: str) -> None:
    rank = STANDS_ON_THOSE_BEFORE.index(folder)
    sources = sorted((ROOT / folder).rglob("*.py"))
    assert sources
    against = [
        f"{source.relative_to(ROOT)}:{line} imports {name}"
        for source in sources
        for line, name in imported(source)
        if STANDS_ON_THOSE_BEFORE.index(name) > rank
    ]
    assert not against


def test_the_reader_of_imports_sees_both_ways_of_writing_them() -> None:
    command = ROOT / "ballscrew" / "identify_command.py"
    assert "identification" in {name for _, name in imported(command)}
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
    assert found - {"tests", "proofs"} == set(STANDS_ON_THOSE_BEFORE)


LARGE = {"Long file": 8, "Long": 15, "Many arguments": 11}  # how many there may be of each
MOST_LINES_OF_A_FILE, MOST_LINES_OF_A_FUNCTION, MOST_ARGUMENTS = 400, 80, 8


def large(text: str) -> Iterator[tuple[str, int, bool]]:
    """Kind and line of what is large in a source, and whether a comment above it says why.

    A method's `self` or `cls` is no argument.
    """
    lines = text.splitlines()
    if len(lines) > MOST_LINES_OF_A_FILE:
        yield "Long file", 1, lines[0].startswith("# Long file: ")
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        first = min([node.lineno, *(d.lineno for d in node.decorator_list)]) - 1
        above = first
        while above and lines[above - 1].lstrip().startswith("#"):
            above -= 1
        comments = [line.lstrip() for line in lines[above:first]]
        given = node.args.posonlyargs + node.args.args
        bound = bool(given) and given[0].arg in ("self", "cls")
        for kind, too_much in (
            ("Long", node.end_lineno - node.lineno + 1 > MOST_LINES_OF_A_FUNCTION),
            ("Many arguments", len(given + node.args.kwonlyargs) - bound > MOST_ARGUMENTS),
        ):
            if too_much:
                yield kind, node.lineno, any(c.startswith(f"# {kind}: ") for c in comments)


def all_large() -> Iterator[tuple[str, str, bool]]:
    for folder in (*STANDS_ON_THOSE_BEFORE, "proofs", "benchmarks", "docs"):
        for source in sorted((ROOT / folder).rglob("*.py")):
            for kind, line, said in large(source.read_text(encoding="utf-8")):
                yield kind, f"{source.relative_to(ROOT)}:{line}", said


@pytest.mark.parametrize("kind", LARGE)
def test_few_files_and_functions_are_large(kind: str) -> None:
    found = [where for what, where, _ in all_large() if what == kind]
    assert len(found) <= LARGE[kind], found


def test_what_is_large_says_why_in_a_comment_above_it() -> None:
    assert [f"{where} ({kind})" for kind, where, said in all_large() if not said] == []


def test_what_is_large_is_found() -> None:
    def source(reason: str, arguments: int, lines: int) -> str:
        given = ", ".join(["self", *(f"a{k}" for k in range(arguments))])
        body = "        pass\n" * (lines - 1)
        return f"class C:\n{reason}    @decorated\n    def f({given}):\n{body}"

    assert list(large(source("", 8, 80))) == []
    assert list(large(source("", 9, 81))) == [("Long", 3, False), ("Many arguments", 3, False)]
    reasons = "    # Long: a list.\n    # Many arguments: by name.\n"
    assert list(large(source(reasons, 9, 81))) == [("Long", 5, True), ("Many arguments", 5, True)]
    assert list(large("x = 1\n" * 401)) == [("Long file", 1, False)]
    assert list(large("# Long file: data.\n" + "x = 1\n" * 400)) == [("Long file", 1, True)]

"""Pages and code say things plainly: none of the phrases that docs/contributing.md lists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CONTRIBUTING = ROOT / "docs" / "contributing.md"
TABLE = CONTRIBUTING.read_text("utf-8").partition("| not | but |\n|---|---|\n")[2]
PLAIN = {
    phrase.lower(): plain
    for phrase, plain in re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|$", TABLE, re.M)
}
PHRASES = re.compile(
    r"(?<![\w-])(?:"
    + "|".join(r"\s+".join(map(re.escape, p.split())) for p in sorted(PLAIN, key=len, reverse=True))
    + r")(?![\w-])",
    re.IGNORECASE,
)
PAGES = [ROOT / "README.md"] + [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if page.name != "commands.md" and page.parent.name != "proof"  # generated
]
PACKAGE = (
    "ballscrew",
    "solver",
    "plant",
    "controllers",
    "instruments",
    "fmus",
    "orchestration",
    "stability",
    "rig",
    "records",
    "identification",
    "diagnosis",
    "gallery",
)
SOURCES = [f for folder in PACKAGE for f in sorted((ROOT / folder).rglob("*.py"))]


def found_in(text: str, name: str, first: int = 1) -> list[str]:
    """Place, phrase and plain phrase of each; `first` is the number of the text's first line."""
    return [
        f"{name}:{first + text.count(chr(10), 0, m.start())}: "
        f'"{" ".join(m[0].split())}", say "{PLAIN[" ".join(m[0].lower().split())]}"'
        for m in PHRASES.finditer(text)
    ]


def without_code(page: str) -> str:
    """The page with blocks of code, inline code and the table of phrases blank, line by line."""
    for code in (r"^ *(```+|~~~+).*?^ *\1", r"`[^`\n]+`", r"^\| not \| but \|$.*"):
        page = re.sub(code, lambda m: "\n" * m[0].count("\n"), page, flags=re.M | re.S)
    return page


def found_in_code(path: Path) -> list[str]:
    tree = ast.parse(path.read_text("utf-8"))
    name = path.relative_to(ROOT).as_posix()
    return [
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for line in found_in(node.value, name, node.lineno)
    ]


def test_the_table_has_phrases_and_plain_ones_in_order():
    assert 25 <= len(PLAIN) <= 50
    assert list(PLAIN) == sorted(PLAIN)
    assert not [plain for plain in PLAIN.values() if PHRASES.search(plain)]


def test_a_phrase_is_found_across_lines_and_not_in_code_or_within_a_word():
    page = "A line.\n\n```\nanew\n```\n\nIt Stands\nfor `anew`, renewanew.\n"
    assert found_in(without_code(page), "page.md") == ['page.md:7: "Stands for", say "means"']


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_a_page_is_in_plain_english(page):
    found = found_in(without_code(page.read_text("utf-8")), page.relative_to(ROOT).as_posix())
    assert found == [], "\n".join(found)


def test_messages_and_docstrings_are_in_plain_english():
    found = [line for path in SOURCES for line in found_in_code(path)]
    assert found == [], "\n".join(found)

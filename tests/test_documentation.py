"""The documentation leads to the code: three links, or one word of the field."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ballscrew

ROOT = Path(__file__).resolve().parents[1]
GLOSSARY = ROOT / "docs" / "glossary.md"
ROWS = re.findall(r"^\| ([^|]+) \| ([^|]+) \| `([^`]+)` \|$", GLOSSARY.read_text("utf-8"), re.M)
PAGES = [p for p in sorted((ROOT / "docs").rglob("*.md")) if p.name != "commands.md"]


def test_the_table_of_the_python_page_has_every_function():
    page = (ROOT / "docs" / "reference" / "api.md").read_text("utf-8")
    functions = {
        n for n in ballscrew.__all__ if getattr(ballscrew, n).__module__ == "ballscrew.api"
    }
    assert functions == set(re.findall(r"<ballscrew\.api\.(\w+)>", page))


def test_the_first_page_links_to_the_glossary():
    assert "(docs/glossary.md)" in (ROOT / "README.md").read_text("utf-8")
    assert len(ROWS) > 20


@pytest.mark.parametrize(("word", "file"), [(w, f) for w, _, f in ROWS])
def test_each_word_of_the_glossary_leads_to_a_file_that_is_there(word, file):
    assert (ROOT / file).is_file(), word


@pytest.mark.parametrize(
    ("word", "written"),
    [
        ("Stribeck curve", "stribeck"),
        ("interface-Jacobian coupling", "interface-jacobian"),
        ("saltation matrix", "saltation matrix"),
        ("score of a suspect", "score"),
        ("doStep of an FMU", "def do_step"),
    ],
)
def test_a_word_of_the_field_is_found_where_the_glossary_says(word, written):
    (file,) = [f for w, _, f in ROWS if w == word]
    assert written in (ROOT / file).read_text("utf-8").lower()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_within_the_documentation_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), target


WRITTEN_BY_THE_READER = {"controllers/pi.py"}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md", ROOT / "CHANGELOG.md"])
def test_every_source_that_a_page_names_is_there(page):
    named = set(re.findall(r"`((?:[\w-]+/)+[\w-]+\.(?:py|c|h))`", page.read_text("utf-8")))
    assert [n for n in sorted(named - WRITTEN_BY_THE_READER) if not (ROOT / n).exists()] == []


def test_every_page_is_in_the_site_s_contents():
    index = (ROOT / "docs" / "index.md").read_text("utf-8")
    listed = set(re.findall(r"^([\w/-]+)$", index, re.M))
    pages = {p.relative_to(ROOT / "docs").with_suffix("").as_posix() for p in PAGES}
    assert pages - {"index"} <= listed

"""Numbers and tables on the pages are those of the stored proofs."""

from __future__ import annotations

from pathlib import Path

import pytest
import runner
from cogapp import Cog

ROOT = Path(__file__).resolve().parents[1]
FILES = (ROOT / "README.md", ROOT / "proofs" / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
PAGES = {
    str(f.relative_to(ROOT)): text for f in FILES if "[[[cog" in (text := f.read_text("utf-8"))
}
pytestmark = pytest.mark.ci


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_is_what_is_stored(monkeypatch, page):
    monkeypatch.chdir(ROOT)
    assert Cog().process_string(PAGES[page], page) == PAGES[page]


def test_every_stored_proof_is_listed():
    assert {p.stem for p in runner.FOLDER.glob("*.json")} == set(runner.PROOFS)

"""Names with HTML that must not become part of a page, and checks of pages with them."""

from __future__ import annotations

import time
from html.parser import HTMLParser
from pathlib import Path

from browser import opened

HOSTILE = (
    "<script>window.boom=1</script>",
    '"><img src=x onerror="window.boom=1">',
    "{{7*7}}",
    "</script><script>window.boom=1</script>",
    "<a href='https://x.invalid'>x</a>&amp;",
)
ALL = " ".join(HOSTILE)


class _Elements(HTMLParser):
    """The elements of a page, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.said: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        assert not [name for name, _ in attrs if name.startswith("on")]

    def handle_data(self, data):
        self.said.append(data)


def check_text(page: str) -> None:
    """Check that the page has hostile names as text only, and no other element than its own."""
    found = _Elements(page)
    assert found.names.count("script") == 2
    assert not {"img", "a", "iframe", "object"} & set(found.names)
    said = " ".join(" ".join(found.said).split())
    for name in HOSTILE:
        assert name in said, name


def check_in_browser(path: Path, in_pictures: bool = True) -> None:
    """Check that no hostile script runs, no error occurs, and each picture is drawn.

    `in_pictures`: texts of pictures also contain names from the user.
    """
    with opened(path) as page:
        end = time.monotonic() + 60.0
        while not page.evaluate("document.documentElement.dataset.pictures"):
            assert time.monotonic() < end, page.errors
            time.sleep(0.05)
        assert page.errors == []
        assert [r for r in page.requests if not r.startswith("data:")] == [path.resolve().as_uri()]
        assert page.evaluate("window.boom === undefined")
        inside = "document.querySelectorAll('main img, main a[href], svg a').length"
        assert page.evaluate(inside) == 0
        shown = page.evaluate("[...document.querySelectorAll('svg text')].map(t => t.textContent)")
        assert shown
        assert any(HOSTILE[0] in text for text in shown) == in_pictures  # unchanged

"""Pages of results as read by a parser, and names with HTML that must stay text in them."""

from __future__ import annotations

from html.parser import HTMLParser

HOSTILE = (
    "<script>window.boom=1</script>",
    '"><img src=x onerror="window.boom=1">',
    "{{7*7}}",
    "</script><script>window.boom=1</script>",
    "<a href='https://x.invalid'>x</a>&amp;",
)
ALL = " ".join(HOSTILE)
_ACTIVE = {"script", "iframe", "object", "embed", "a", "link", "form", "base"}


class Page(HTMLParser):
    """A page: its text, its first headline, and the rows of each table by its title.

    It is below 500 kB, without scripts, and it requests nothing.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        assert len(text) < 500_000
        self.pictures = 0
        self.headline = ""
        self.tables: dict[str, list[list[str]]] = {}
        self.changed: list[str] = []
        self._words: list[str] = []
        self._cell: list[str] = []
        self.feed(text)
        self.said = " ".join(" ".join(self._words).split())

    def handle_starttag(self, tag, attrs):
        assert tag not in _ACTIVE, tag
        for name, value in attrs:
            assert not name.startswith("on"), name
            if name in ("src", "href", "xlink:href"):
                assert value.startswith(("data:image/png;base64,", "#")), value
        self.pictures += tag == "figure"
        if tag == "tr" and self.tables:
            list(self.tables.values())[-1].append([])
            self._marked = ("class", "changed") in attrs
        if tag in ("h1", "h2", "th", "td"):
            self._cell = []

    def handle_endtag(self, tag):
        said = " ".join("".join(self._cell).split())
        if tag == "h1":
            self.headline = said
        elif tag == "h2":
            self.tables[said] = []
        elif tag in ("th", "td"):
            row = list(self.tables.values())[-1][-1]
            if self._marked and not row:
                self.changed.append(said)
            row.append(said)

    def handle_data(self, data):
        self._words.append(data)
        self._cell.append(data)


def check_hostile(page: str) -> None:
    """Check that the page has hostile names as text only."""
    said = Page(page).said
    for name in HOSTILE:
        assert name in said, name

"""Open every page of the built site in Chromium: no complaint, and readable at a phone's width."""

from __future__ import annotations

import sys
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TOP / "tests" / "support"))

import browser  # noqa: E402  (where the tests keep it)

WIDTH = 360  # pixels


def main() -> int:
    """Check the site in the folder that is given; the number of pages with a fault is told."""
    site = Path(sys.argv[1])
    pages = sorted(p for p in site.rglob("*.html") if "_static" not in p.parts)
    if not pages:
        print(f"no pages in {site}; build them with make docs", file=sys.stderr)
        return 2
    faults = []
    with browser.opened(pages[0], WIDTH, 740) as page:
        for path in pages:
            page.errors.clear()
            page.open(path, WIDTH, 740, touch=True)
            wide = page.evaluate("document.documentElement.scrollWidth")
            name = path.relative_to(site)
            faults += [f"{name}: {error}" for error in page.errors]
            if wide > WIDTH:
                faults.append(f"{name}: {wide} pixels wide, expected at most {WIDTH}")
    print(*faults, f"{len(pages)} pages, {len(faults)} faults", sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())

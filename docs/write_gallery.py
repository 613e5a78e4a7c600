"""Make tables and pictures of the gallery anew: `python docs/write_gallery.py [NAME ...]`."""

import sys
from importlib import import_module
from pathlib import Path

from ballscrew.gallery import SYSTEMS
from ballscrew.gallery.drawing import write_figure
from ballscrew.gallery.finding import with_table

for name in sys.argv[1:] or SYSTEMS:
    system = import_module(f"ballscrew.gallery.{name}.findings")
    folder = Path(__file__).resolve().parents[1] / "gallery" / name
    page = folder / "page.md"
    page.write_text(with_table(page.read_text("utf-8"), system.findings()), "utf-8")
    write_figure(system.picture(), folder, "picture")
    print(name)

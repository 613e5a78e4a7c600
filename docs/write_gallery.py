"""Make tables and pictures of the gallery anew: `python docs/write_gallery.py [NAME ...]`."""

import sys
from importlib import import_module
from pathlib import Path

from matplotlib.figure import Figure

from ballscrew.gallery import SYSTEMS
from ballscrew.gallery.drawing import write_figure
from ballscrew.gallery.finding import with_table

ROOT = Path(__file__).resolve().parents[1]
FIRST_PAGE = {  # which panel of a picture stands there
    "belt": 0,
    "impact_oscillator": 1,
    "pid_mass": 0,
    "cart_pendulum": 0,
    "backlash_drive": 0,
    "bouncing_ball": 1,
}


def write_panel(figure: Figure, number: int, path: Path) -> None:
    """Write one panel of a picture, with its labels; a legend of all panels is left out."""
    for legend in figure.legends:
        legend.set_visible(False)
    figure.canvas.draw()
    box = figure.axes[number].get_tightbbox().padded(6)
    inches = box.transformed(figure.dpi_scale_trans.inverted())
    figure.savefig(path, dpi=130, bbox_inches=inches, metadata={"Software": None})


for name in sys.argv[1:] or SYSTEMS:
    system = import_module(f"ballscrew.gallery.{name}.findings")
    folder = ROOT / "gallery" / name
    page = folder / "page.md"
    page.write_text(with_table(page.read_text("utf-8"), system.findings()), "utf-8")
    picture = system.picture()
    write_figure(picture, folder, "picture")
    if name in FIRST_PAGE:
        write_panel(picture, FIRST_PAGE[name], ROOT / "docs" / "images" / "gallery" / f"{name}.png")
    print(name)

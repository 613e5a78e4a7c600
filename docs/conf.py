"""The documentation as a site: `make docs`."""

import os
import tempfile
from pathlib import Path

from ballscrew import __version__
from ballscrew.cli import command_parser

project = "ballscrew"
version = release = __version__
copyright = "the authors of ballscrew"
extensions = ["myst_nb", "numpydoc", "sphinx.ext.autodoc", "sphinx-mathjax-offline"]
html_theme = "furo"
html_title = f"ballscrew {__version__}"
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_in_temp = True
numpydoc_show_class_members = False
add_module_names = False
autodoc_typehints = "none"
os.environ.setdefault("BALLSCREW_CACHE", tempfile.mkdtemp(prefix="ballscrew-docs-"))


def write_commands(app):
    """The page of the commands, from their own help."""
    os.environ["COLUMNS"] = "90"
    parser = command_parser()
    (commands,) = (a.choices for a in parser._actions if getattr(a, "choices", None))
    lines = ["# Commands", "", "What each prints with `--help`.", ""]
    for name, one in commands.items():
        lines += [f"## ballscrew {name}", "", "```text", one.format_help().rstrip(), "```", ""]
    page = Path(app.srcdir) / "reference" / "commands.md"
    text = "\n".join(lines)
    if not page.is_file() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def setup(app):
    app.connect("builder-inited", write_commands)

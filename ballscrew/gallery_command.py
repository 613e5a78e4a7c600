"""``ballscrew gallery``: well-known systems, with published results and ours."""

from __future__ import annotations

import argparse
import json
import re
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

from .options import TRUSTED, out_folder
from .results_folder import prepare_folder, save_results
from .solver.errors import UserError, did_you_mean
from .supervision import tell

GALLERY = "ballscrew.gallery"  # uses this package, and is imported by name
_EXAMPLES = """examples:
  ballscrew gallery
  ballscrew gallery van_der_pol --out out/van_der_pol
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    del parser_class
    parser = commands.add_parser(
        "gallery",
        help="well-known systems with friction, impacts and limit cycles",
        description="Without NAME, list the systems. With NAME, compute its known "
        "results: write components.py (its equations, to run and to change), page.md, "
        "findings.json and picture.png. Exit code 1: a number differs from the literature, "
        "and no reason is given.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="a system of the list")
    parser.add_argument("--out", type=out_folder, metavar="DIR", help="folder for the results")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.set_defaults(action=gallery)


def gallery(options: argparse.Namespace) -> int:
    systems: dict[str, str] = import_module(GALLERY).SYSTEMS
    if options.name is None:
        if options.out is not None:
            raise UserError("--out is for one system; give its NAME as well")
        return _list(systems, options.json)
    if options.name not in systems:
        hint = did_you_mean(options.name, systems)
        raise UserError(f"no system {options.name!r}; there are {', '.join(systems)}{hint}")
    if options.out is None:
        raise UserError(f"--out is missing, expected a folder for what {options.name} gives")
    return _show(options.name, options.out, options.json)


def _list(systems: dict[str, str], as_json: bool) -> int:
    if as_json:
        print(json.dumps(systems))
        return TRUSTED
    wide = max(map(len, systems))
    for name, about in systems.items():
        print(f"{name:<{wide}}  {about}")
    return TRUSTED


def _show(name: str, folder: Path, as_json: bool) -> int:
    from dataclasses import asdict

    from .orchestration.loop.pictures import write_figure
    from .solver.files import finite_or_null, write_json

    prepare_folder(folder)
    system = import_module(f"{GALLERY}.{name}.findings")
    finding = import_module(f"{GALLERY}.finding")
    tell(f"{name}: computing its known results")
    found = system.findings()
    figure = system.picture()
    rows = [finite_or_null(asdict(f) | {"agrees": f.agrees}) for f in found]
    source = Path(str(system.__file__)).parent

    def save(stage: Path) -> None:
        shutil.copyfile(source / "components.py", stage / "components.py")
        page = (source / "page.md").read_text("utf-8")
        (stage / "page.md").write_text(finding.with_table(page, found), "utf-8")
        write_json(stage / "findings.json", {"system": name, "findings": rows})
        write_figure(figure, stage, "picture")

    save_results(folder, save)
    if as_json:
        print(json.dumps({"system": name, "findings": rows}))
    else:
        for f in found:
            print(finding.line_of(f))
        print(f"components.py, page.md, findings.json, picture.png in {folder}; there, try")
        for command in re.findall(
            r"^\s*(ballscrew .+)$", (source / "page.md").read_text("utf-8"), re.M
        ):
            print(f"  {command}")
    unexplained = [f for f in found if f.agrees is False and not f.remark]
    return 1 if unexplained else TRUSTED

"""``ballscrew new``: a first controller of your own, and its test."""

from __future__ import annotations

import argparse
import keyword
import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .options import TRUSTED, out_folder
from .results_folder import write_or_refuse
from .solver.errors import UserError

_SIDES = ("plant", "controller")  # reserved words of --set and --map


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add this command to those of the program."""
    del parser_class
    parser = commands.add_parser(
        "new",
        help="write a first controller of your own, and its test",
        description="Write NAME.py, a small working controller, and test_NAME.py, its test.",
        epilog="example:\n  ballscrew new controller mine --out my_controllers\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("kind", choices=("controller",))
    parser.add_argument("name", metavar="NAME", help="an identifier of Python")
    parser.add_argument(
        "--out", type=out_folder, default=Path(), metavar="DIR", help="folder (default this one)"
    )
    parser.set_defaults(action=new)


def new(options: argparse.Namespace) -> int:
    name, folder = options.name, options.out
    targets = {
        folder / f"{name}.py": "controller.py.jinja",
        folder / f"test_{name}.py": "test_controller.py.jinja",
    }
    _check_name(name)
    for target in targets:
        if target.exists() or target.is_symlink():
            raise UserError(f"{target} exists already; choose another NAME or --out")
    if find_spec(name) is not None:
        raise UserError(
            f"NAME is {name!r}, which is a module of this Python that the file would hide; choose "
            "another"
        )

    def write() -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for target, template in targets.items():
            with target.open("x", encoding="utf-8", newline="\n") as stream:
                stream.write(_fill(template, name))

    write_or_refuse(write)
    file, test = map(str, targets)
    part = shlex.quote(f"{file}:{name}")
    print(f"{file} and {test} are written. Next:")
    print(f"  ballscrew run --controller {part} --out out/{name}")
    print(f"  pytest {shlex.quote(test)}")
    print(f"  ballscrew export --component {part} --out fmus")
    return TRUSTED


def _check_name(name: str) -> None:
    from .orchestration.loop.catalogue import NAMES

    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or keyword.iskeyword(name):
        raise UserError(f"NAME is {name!r}, expected an identifier, such as my_controller")
    if name in NAMES or name in _SIDES:
        raise UserError(f"NAME is {name!r}, which is already the name of a part; choose another")


def _fill(template: str, name: str) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("ballscrew"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return environment.get_template(template).render(name=name)

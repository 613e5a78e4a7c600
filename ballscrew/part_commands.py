"""``ballscrew export``, ``new`` and ``gallery``: parts as files, a first part, known systems."""

from __future__ import annotations

import argparse
import keyword
import re
import shlex
import shutil
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from .api import check_name, check_whole_number, file_of
from .console import (
    BAD_REQUEST,
    NOT_TRUSTED,
    TRUSTED,
    print_notes,
    print_result,
    side_by_side,
    warn,
)
from .controllers import CONTROLLERS
from .loop_options import parts_of
from .options import exclude
from .plant import PLANTS
from .plant.instruments import INSTRUMENTS
from .results_folder import prepare_folder, save_results, write_or_refuse
from .solver.errors import ContractError, FmuError, UserError
from .supervision import tell, tell_kept

if TYPE_CHECKING:
    from .orchestration.loop.parameter_file import ParameterFile
    from .part_api import Export

EXPORT = r"""
Write parts as FMUs.

examples:
  ballscrew export --out fmus --only plant iol
  ballscrew export --all --out fmus
  ballscrew export --ssp --out loops
  ballscrew export --native --platforms linux64,win64 --out native
  ballscrew export --loop iol --plant mine.py:axis --native --out loops
  ballscrew export --component mine.py:pi --native --out native
  ballscrew export --modelica --component plant pid --out modelica
"""
GALLERY = r"""
Without NAME, list the systems. With NAME, compute its known results: write components.py (its
equations, to run and to change), page.md, findings.json and picture.png. Exit code 1: a number
differs from the literature, and no reason is given.

examples:
  ballscrew gallery
  ballscrew gallery van_der_pol --out out/van_der_pol
"""
NEW = r"""
Write NAME.py, a small working controller, and test_NAME.py, its test.

example:
  ballscrew new controller mine --out my_controllers
"""
DEFAULTS = ("plant", "iol", "nctf", "pid")  # what is written if nothing is named
_GALLERY = "ballscrew.gallery"  # uses this package, and is imported by name


def export(options: argparse.Namespace) -> int:
    whole = options.ssp or options.loop is not None
    exclude(options, "loop", "component all ssp variational")
    exclude(options, "component", "all")
    exclude(options, "variational", "ssp")
    exclude(options, "modelica", "native ssp variational")
    for option, needed in (("tangents", "variational"), ("plant", "loop or --ssp")):
        if getattr(options, option) is not None and not (whole or getattr(options, needed, False)):
            raise UserError(f"--{option} is for --{needed}")
    file = file_of(options.params)
    known = [*CONTROLLERS] if whole else [*PLANTS, *CONTROLLERS, *INSTRUMENTS]
    names = _names(options, file, known)
    parts_of("component" if options.loop is None else "loop", names, known, fmus=False)
    if options.plant is not None:
        parts_of("plant", [options.plant], PLANTS, fmus=False)
    how = _how(options, file, whole)
    prepare_folder(options.out)
    return _write(options, names, how)


def _how(options: argparse.Namespace, file: ParameterFile | None, whole: bool) -> Export:
    from .orchestration.loop.loop import plant_of
    from .part_api import Export

    tangents = 0
    if options.variational:
        tangents = check_whole_number("tangents", options.tangents or "5", 1, 12)
    platforms = None if options.platforms is None else options.platforms.split(",")
    around = plant_of(file, options.plant) if whole else ""
    return Export(around, tangents, file, options.native, options.fmi or 2, platforms)


def _write(options: argparse.Namespace, names: list[str], how: Export) -> int:
    from .orchestration.loop.catalogue import name_of
    from .solver.compilers import CompilerFailed
    from .solver.files import temporary_folder

    kind = "_variational" if options.variational else "_loop" if options.loop else ""
    ending = ".ssp" if options.ssp else kind + (".mo" if options.modelica else ".fmu")
    with temporary_folder("export") as folder:
        for k, name in enumerate(names):
            tell(f"{k} of {len(names)} files written, at {name}")
            tell_kept("each file that exists is complete")
            target = options.out / (name_of(name) + ending)
            try:
                made = write_or_refuse(lambda: how.write(name, target, Path(folder)))  # noqa: B023
            except (ContractError, FmuError) as error:
                if options.component or options.loop:
                    raise
                warn(f"left out: {error}")
                continue
            except CompilerFailed as error:
                warn(f"ballscrew: {error}")  # with the lines of the compiler
                return BAD_REQUEST
            print(target)
            print_notes(filter(None, [made.note]))
    return TRUSTED


def _names(options: argparse.Namespace, file: ParameterFile | None, known: list[str]) -> list[str]:
    """What to export; a parameter file's plant takes the place of all plants."""
    if options.loop is not None:
        return [options.loop]
    if options.component:
        return list(options.component)
    names = known if options.all else [name for name in DEFAULTS if name in known]
    if file is None or options.ssp:
        return names
    return [file.plant_name, *(name for name in names if name not in PLANTS)]


def gallery(options: argparse.Namespace) -> int:
    systems: dict[str, str] = import_module(_GALLERY).SYSTEMS
    if options.name is None:
        if options.out is not None:
            raise UserError("--out is for one system; give its NAME as well")
        print_result(options.json, systems, side_by_side([*systems.items()]))
        return TRUSTED
    check_name("NAME", options.name, systems)
    if options.out is None:
        raise UserError(f"--out is missing, expected a folder for what {options.name} gives")
    return _show(options.name, options.out, options.json)


def _show(name: str, folder: Path, as_json: bool) -> int:
    from dataclasses import asdict

    from .orchestration.loop.pictures import write_figure
    from .solver.files import finite_or_null, write_json

    prepare_folder(folder)
    system = import_module(f"{_GALLERY}.{name}.findings")
    finding = import_module(f"{_GALLERY}.finding")
    tell(f"{name}: computing its known results")
    found = system.findings()
    figure = system.picture()
    rows = [finite_or_null(asdict(f) | {"agrees": f.agrees}) for f in found]
    source = Path(str(system.__file__)).parent
    page = (source / "page.md").read_text("utf-8")

    def save(stage: Path) -> None:
        shutil.copyfile(source / "components.py", stage / "components.py")
        (stage / "page.md").write_text(finding.with_table(page, found), "utf-8")
        write_json(stage / "findings.json", {"system": name, "findings": rows})
        write_figure(figure, stage, "picture")

    save_results(folder, save)
    commands = re.findall(r"^\s*(ballscrew .+)$", page, re.M)
    files = f"components.py, page.md, findings.json, picture.png in {folder}; there, try"
    text = "\n".join([*map(finding.line_of, found), files, *(f"  {c}" for c in commands)])
    print_result(as_json, {"system": name, "findings": rows}, text)
    unexplained = [f for f in found if f.agrees is False and not f.remark]
    return NOT_TRUSTED if unexplained else TRUSTED


def new(options: argparse.Namespace) -> int:
    name, folder = options.name, options.out or Path()
    targets = {
        folder / f"{name}.py": "controller.py.jinja",
        folder / f"test_{name}.py": "test_controller.py.jinja",
    }
    _check_new_name(name, targets)

    def write() -> None:
        from jinja2 import Environment, PackageLoader

        made = Environment(loader=PackageLoader("ballscrew"), keep_trailing_newline=True)
        folder.mkdir(parents=True, exist_ok=True)
        for target, template in targets.items():
            with target.open("x", encoding="utf-8", newline="\n") as stream:
                stream.write(made.get_template(template).render(name=name))

    write_or_refuse(write)
    file, test = map(str, targets)
    part = shlex.quote(f"{file}:{name}")
    print(f"{file} and {test} are written. Next:")
    print(f"  ballscrew run --controller {part} --out out/{name}")
    print(f"  pytest {shlex.quote(test)}")
    print(f"  ballscrew export --component {part} --out fmus")
    return TRUSTED


def _check_new_name(name: str, targets: Iterable[Path]) -> None:
    from .orchestration.loop.catalogue import NAMES

    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or keyword.iskeyword(name):
        raise UserError(f"NAME is {name!r}, expected an identifier, such as my_controller")
    if name in (*NAMES, "plant", "controller"):
        raise UserError(f"NAME is {name!r}, which is already the name of a part; choose another")
    for target in targets:
        if target.exists() or target.is_symlink():
            raise UserError(f"{target} exists already; choose another NAME or --out")
    if find_spec(name) is not None:
        raise UserError(
            f"NAME is {name!r}, which is a module of this Python that the file would hide; choose "
            "another"
        )


COMMANDS = {"export": (export, EXPORT), "gallery": (gallery, GALLERY), "new": (new, NEW)}

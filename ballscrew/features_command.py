"""``ballscrew features``: which friction law shows which feature, beside the thesis' table."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .options import NOT_TRUSTED, TRUSTED, BadRequest, out_folder
from .results_folder import prepare_folder, save_results
from .supervision import tell

if TYPE_CHECKING:
    from .rig.feature_table import Identified

_EXAMPLES = """examples:
  ballscrew features --out out/features
  ballscrew features --laws lugre dahl --out out/two
  ballscrew features --json --out out/features
  ballscrew features --identified out/identified/identified.json --out out/features
"""
PROCESSES = 2
ENDLESS = (RecursionError, OverflowError)  # nested too deep; a whole number of 400 digits


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the command's sub-parsers, which make it a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "features",
        help="decide which friction law shows which feature",
        description="Run the five experiments of Section 2.4 on the friction laws, decide each "
        "cell of Table 2.12, print it beside the thesis' with every difference explained, and "
        "write features.json and Figs. 2.14 to 2.19. Exit code 1: decided, but in some trial an "
        "instrument or the screw was past its range.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--laws", nargs="+", metavar="NAME", help="some of the friction laws (default all)")
    add(
        "--identified",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="identified.json of `ballscrew identify`, one for a law: what it calls identified "
        "takes the place of the thesis' values",
    )
    add("--json", action="store_true", help="print features.json instead of the table")
    add("--out", type=out_folder, required=True, metavar="DIR", help="for figures and numbers")
    parser.set_defaults(action=_features)


def _features(options: argparse.Namespace) -> int:
    from .plant import LAWS

    for name in options.laws or ():
        _known("--laws", name, LAWS)
    read = [_read_identified(path) for path in options.identified]
    for path, (law, _) in zip(options.identified, read, strict=True):
        _known(str(path), law, LAWS)
        if options.laws and law not in options.laws:
            raise BadRequest(f"{path} is of {law}, which is not among --laws")
        if [other for other, _ in read].count(law) > 1:
            raise BadRequest(f"{path}: another file is of {law}, too; give one for each law")
    prepare_folder(options.out, options.identified)
    from .rig.feature_table import feature_table
    from .rig.setup import BadRig
    from .solver.kernel import IntegrationError

    try:
        table = feature_table(options.laws, PROCESSES, dict(read), tell)
    except BadRig as error:
        raise BadRequest(f"--identified: {error}") from error
    except IntegrationError as error:
        raise BadRequest(f"{error}; this law cannot take part") from error
    from .rig.feature_pictures import save_pictures

    def save(folder: Path) -> None:
        save_pictures(table.observations, folder)
        table.save(folder)

    save_results(options.out, save)
    if options.json:
        print(json.dumps(table.to_dict(), indent=1))
    else:
        print(table.text())
        print(f"\nfeatures.json and Figs. 2.14 to 2.19 in {options.out}")
    for note in table.notes:
        print(f"not trusted: {note}", file=sys.stderr)
    return NOT_TRUSTED if table.notes else TRUSTED


def _read_identified(path: Path) -> tuple[str, Identified]:
    """A law's name and what a file of `ballscrew identify` says was identified of it."""
    from .rig.feature_table import Identified

    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        values = {n: float(p["value"]) for n, p in data["parameters"].items() if p["identified"]}
        law = str(data["law"])
        if not all(map(math.isfinite, values.values())):
            raise ValueError
    except OSError as error:
        raise BadRequest(f"--identified {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, *ENDLESS) as error:
        raise BadRequest(
            f"--identified {path} is no identified.json, expected what `ballscrew identify` writes"
        ) from error
    return law, Identified(values, f"identified, {path.name}")


def _known(option: str, name: str, laws: dict[str, str]) -> None:
    import difflib

    if name not in laws:
        near = difflib.get_close_matches(name, laws, n=1, cutoff=0.5)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise BadRequest(f"{option}: no friction law {name!r}; there are {', '.join(laws)}{hint}")

"""The ``ballscrew`` command: a thin layer over the library's functions.

Exit codes: 0 done and trusted; 1 done, but the result is not trusted or the run stopped
early; 2 the request is invalid, and one line on standard error says why; 70 an error in
this program, and one line says what to report.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import shlex
import sys
from collections.abc import Sequence
from typing import Any

from . import (
    compare_command,
    diagnose_command,
    export_command,
    gallery_command,
    identify_command,
    lyapunov_command,
    map_command,
    new_command,
    rig_command,
    run_command,
    study_command,
    swap_command,
    tune_command,
)
from .console import complain, complain_of_ourselves, forget_output
from .options import Parser
from .printable import printing, unchanged
from .solver.errors import UserError
from .supervision import interrupted

_EXAMPLES = """examples:
  ballscrew run --controller iol --out out/iol
  ballscrew swap --controllers iol nctf pid --out out/swap
  ballscrew tune --controller p_pi --params axis.toml --out out/tuned
  ballscrew study STUDY.toml --out out/study
  ballscrew export --out fmus
  ballscrew rig 2.4/7 --out out/trial
  ballscrew identify out/trial --law dahl --out out/dahl
  ballscrew diagnose run.csv --params axis.toml --out out/diagnosis
  ballscrew compare other.csv --params out/diagnosis/parameters.toml
  ballscrew gallery
  ballscrew new controller mine
"""


_DRAWING = ("run", "swap", "tune", "lyapunov", "map", "identify", "diagnose", "compare", "gallery")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    out, errors = printing(sys.stdout), printing(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        return _main(arguments)


def _main(arguments: Sequence[str] | None) -> int:
    # pictures go into files, so that the window system does not matter
    os.environ["MPLBACKEND"] = "agg"
    # matrices are small here: threads cost more time than they save
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in map(unchanged, (sys.stdout, sys.stderr)):
        if isinstance(
            stream, io.TextIOWrapper
        ):  # a name may have letters that a terminal cannot print
            stream.reconfigure(errors="backslashreplace")
    try:
        options = command_parser().parse_args(arguments)
        given = sys.argv[1:] if arguments is None else arguments
        options.command = shlex.join(["ballscrew", *map(str, given)])  # for pages
        os.environ["BALLSCREW_SVG"] = "1" if getattr(options, "svg", False) else ""
        code = int(options.action(options))
        print(end="", flush=True)
        return code
    except UserError as error:
        return complain(str(error))
    except MemoryError:
        return complain("not enough memory; reduce the work, for example by a longer --step")
    except OSError as error:
        forget_output()
        where = f"{error.filename}: " if error.filename else "output cannot be written: "
        return complain(f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        return interrupted()
    except Exception as error:
        return complain_of_ourselves(error)


class _Version(argparse.Action):
    """Print the version, which takes time to look up, and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from . import __version__

        print(f"ballscrew {__version__}")
        parser.exit()


def command_parser() -> argparse.ArgumentParser:
    """The parser of the command with all its subcommands."""
    parser = Parser(
        prog="ballscrew",
        description="Friction, co-simulation and stability of a ball-screw axis and its "
        "controllers. Plant and "
        "controllers are FMUs; each closed-loop run checks its own coupling error.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="show program's version number and exit"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)

    for command in (
        export_command,
        run_command,
        swap_command,
        tune_command,
        study_command,
        lyapunov_command,
        map_command,
        rig_command,
        identify_command,
        diagnose_command,
        compare_command,
        gallery_command,
        new_command,
    ):
        command.add_parser(commands, Parser)
    for name in _DRAWING:
        commands.choices[name].add_argument(
            "--svg", action="store_true", help="write the pictures also as SVG"
        )
    return parser

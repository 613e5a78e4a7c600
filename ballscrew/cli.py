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
from collections.abc import Collection, Sequence
from importlib import import_module
from typing import Any

from .console import complain, complain_of_ourselves, forget_output
from .printable import Printable, unchanged
from .solver.errors import UserError
from .supervision import interrupted

_EXAMPLES = """examples:
  ballscrew run --controller iol --out out/iol
  ballscrew swap --controllers iol nctf pid --out out/swap
  ballscrew tune --controller p_pi --params axis.toml --out out/tuned
  ballscrew export --out fmus
  ballscrew rig 2.4/7 --out out/trial
  ballscrew identify out/trial --law dahl --out out/dahl
  ballscrew diagnose run.csv --params axis.toml --out out/diagnosis
  ballscrew new controller mine
"""
COMMANDS = {  # module, and what it does
    "export": ("part_commands", "write the components as FMUs"),
    "run": ("loop_commands", "run a closed loop"),
    "swap": ("loop_commands", "run several controllers on the same plant and compare them"),
    "tune": ("study_commands", "find the gains of one controller, and test them on another motion"),
    "study": ("study_commands", "tune controllers in the same way, and test them on unseen duties"),
    "lyapunov": ("loop_commands", "Lyapunov exponents, and what the motion becomes"),
    "map": ("loop_commands", "stability maps over two parameters of plant or controller"),
    "rig": ("measured_commands", "run trials on the virtual test rig, of the thesis or your drive"),
    "identify": ("measured_commands", "find friction parameters in recorded data"),
    "diagnose": ("measured_commands", "find the errors of a model on data, and their causes"),
    "compare": ("measured_commands", "compare a model with a record: force and position"),
    "gallery": ("part_commands", "well-known systems with friction, impacts and limit cycles"),
    "new": ("part_commands", "write a first controller of your own, and its test"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    streams: Any = Printable(sys.stdout), Printable(sys.stderr)
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        return _main(sys.argv[1:] if arguments is None else arguments)


def _main(arguments: Sequence[str]) -> int:
    # pictures go into files, so that the window system does not matter
    os.environ["MPLBACKEND"] = "agg"
    # matrices are small here: threads cost more time than they save
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in map(unchanged, (sys.stdout, sys.stderr)):
        # a name may have letters that a terminal cannot print
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        options = command_parser(arguments[:1]).parse_args(arguments)
        options.command = shlex.join(["ballscrew", *map(str, arguments)])  # for pages
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


def command_parser(filled: Collection[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """The parser of the command; only the `filled` subcommands are loaded and have options."""
    from .options import Parser

    parser = Parser(
        prog="ballscrew",
        description="Friction, co-simulation and stability of a ball-screw axis and its "
        "controllers. Plant and controllers are FMUs; each closed-loop run checks its own coupling "
        "error.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="show program's version number and exit"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)
    for name, (module, does) in COMMANDS.items():
        command = commands.add_parser(
            name, help=does, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name in filled:
            action, about = import_module(f".{module}", __package__).COMMANDS[name]
            command.description, _, command.epilog = about.strip("\n").partition("\n\n")
            command.add_options(name)
            command.set_defaults(action=action)
    return parser

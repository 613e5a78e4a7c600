"""Options that say how measured data are written: names, units, and the screw's lead."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from .options import read_named, read_number
from .solver.errors import UserError

if TYPE_CHECKING:
    from .orchestration.loop.parameter_file import ParameterFile


class RecordOptions(NamedTuple):
    """Names and units of the columns as given by the user.

    Attributes
    ----------
    mapping, units : mapping of str to str
        ``theirs -> ours`` names, and units by our names.
    lead : float or None
        Lead of the screw, travel per turn, from ``--lead`` [m].
    """

    mapping: Mapping[str, str]
    units: Mapping[str, str]
    lead: float | None

    def lead_with(self, told: ParameterFile | None) -> float | None:
        """The lead [m] by ``--lead``, else by the parameter file; None if neither says it."""
        return self.lead or (told.lead if told else None)


def add_record_options(add: Any) -> None:
    """Add ``--map``, ``--unit`` and ``--lead`` to a parser, by its `add_argument`."""
    add("--map", action="append", default=[], metavar="THEIRS=OURS", help="a column's name")
    add(
        "--unit",
        action="append",
        default=[],
        metavar="OURS=UNIT",
        help="a column's unit, or its size: time=ms, x=mm, x=rad, x=2.5e-6*m, "
        "u=N*m (default: the unit in the file; SI if the column has one of our names)",
    )
    add(
        "--lead",
        metavar="METRES",
        help="lead of the screw, travel per turn, for rad, deg, rev, rpm and N*m (default: by "
        "p, or the gain of a drive with command torque, of --params)",
    )


def read_record_options(options: argparse.Namespace) -> RecordOptions:
    """The values of the options.

    Raises
    ------
    UserError
    """

    mapping = read_named("--map", options.map, "THEIRS=OURS")
    units = read_named("--unit", options.unit, "OURS=UNIT")
    lead = None if options.lead is None else read_number("--lead", options.lead)
    if lead is not None and not 0 < lead < math.inf:
        raise UserError(f"--lead is {options.lead}, expected a number of metres above 0")
    return RecordOptions(mapping, units, lead)


def print_notes(notes: Sequence[str], as_json: bool) -> None:
    """Notes for the user; the notes on names for a rotating body are only for readers of JSON."""
    from .orchestration.loop.parameter_file import TURNS
    from .orchestration.loop.shown_units import words_for

    words = words_for(notes)
    for note in notes:
        if note != TURNS:
            print(f"note: {words(note)}", file=sys.stderr)
        elif as_json:
            print(f"note: {note}", file=sys.stderr)

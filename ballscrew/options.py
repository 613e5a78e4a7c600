"""Reading and checking of single options; an invalid one gives a one-line message."""

from __future__ import annotations

import argparse
import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .orchestration.fmu.limits import as_number, check_length, check_step
from .solver.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from .orchestration.loop.parts import Part

# A word that begins like a number is a value, also where argparse takes it for an option: -3e-2.
NEGATIVE_NUMBER = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)
TRUSTED, NOT_TRUSTED, BAD_REQUEST, INTERNAL = 0, 1, 2, 70


OWN = (
    "a function of a Python file that returns a Component, such as mine.py:pi, or the path of "
    "an FMU"
)
PART = f"a name, a controller's as NAME+INSTRUMENT+..., {OWN}"


class Parser(argparse.ArgumentParser):
    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see {self.prog} --help")


def read_number(option: str, text: str | float) -> float:
    return as_number(option, text)


def read_length(option: str, text: str | float) -> float:
    """Length of a motion [s]."""
    return check_length(option, text)


def read_step(option: str, text: str | float, stop: float | None) -> float:
    """A communication step [s] of a motion of this length; None is a length not known yet."""
    return check_step(option, text, stop)


def read_part(option: str, name: str, known: Collection[str], fmus: bool = True) -> Part:
    """One of the `known` names, a function of a file or, with `fmus`, an FMU.

    A Python file is run here; the command uses the component that its function returned.
    """
    from .orchestration.loop.parts import resolve

    return resolve(option, name, known, fmus)


def check_name(option: str, name: str, known: Iterable[str]) -> None:
    """Reject a name that is not among the `known` ones."""
    if name not in known:
        near = did_you_mean(name, known)
        raise UserError(f"{option} {name!r} is none of {', '.join(known)}{near}")


def read_pair(option: str, text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise UserError(f"{option} {text!r} is not of the form {form}")
    return name.strip(), value.strip()


def read_named(option: str, texts: Sequence[str], form: str) -> dict[str, str]:
    """Values of a repeated option by name; a name that is given twice is an error."""
    pairs = [read_pair(option, text, form) for text in texts]
    named = dict(pairs)
    for name in named:
        values = [value for other, value in pairs if other == name]
        if len(values) > 1:
            raise UserError(f"{option} {name} is given as {' and as '.join(values)}; expected one")
    return named


def read_whole_number(option: str, text: str | int, least: int, most: int | None = None) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or (most is not None and value > most):
        range_ = f"from {least} on" if most is None else f"from {least} to {most}"
        raise UserError(f"{option} is {text!r}, expected a whole number {range_}")
    return value


def out_folder(text: str) -> Path:
    """The folder of ``--out``; an empty name would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty; expected a folder ('.' is the current one)")
    return Path(text)

"""Reading and checking of single options; what makes no sense becomes one line for the user."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

# A word that begins as a number does is a value, also where argparse takes it for an option: -3e-2.
NEGATIVE_NUMBER = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)
TRUSTED, NOT_TRUSTED, BAD_REQUEST, INTERNAL = 0, 1, 2, 70


OWN = "a function of a Python file that returns a Component, as mine.py:pi, or the path of an FMU"
PART = f"a name, a controller's as NAME+INSTRUMENT+..., {OWN}"
SHORTEST = 1e-9  # motion [s]


class BadRequest(ValueError):
    """Something on the command line makes no sense; the message is one line for the user."""


class Parser(argparse.ArgumentParser):
    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        raise BadRequest(f"{message}; see {self.prog} --help")


def read_length(option: str, text: str | float) -> float:
    """How long a motion is to be [s]; what is nearly nothing has no steps."""
    stop = read_number(option, text)
    if stop <= 0:
        raise BadRequest(f"{option} is {text} s, expected more than 0")
    if stop < SHORTEST:
        raise BadRequest(f"{option} is {text} s, expected at least {SHORTEST:g} s")
    return stop


def read_step(option: str, text: str | float, stop: float | None) -> float:
    """A communication step [s] of a motion of this length; None is a length not known yet."""
    step = read_number(option, text)
    if step <= 0 or (stop is not None and step > stop):
        longest = option.replace("step", "stop")
        raise BadRequest(f"{option} is {text} s, expected more than 0 and at most {longest}")
    if stop is not None:
        check_steps(stop, step)
    return step


def check_steps(stop: float, step: float) -> None:
    """Refuse steps [s] that are so short that no run of so many would end."""
    if stop / step > 1e9:
        raise BadRequest(f"--step {step:g} makes {stop / step:.3g} steps; use a larger one")


def check_part(option: str, name: str, known: Iterable[str], fmus: bool = True) -> None:
    """Refuse what is none of the `known` names, no function of a file and, with `fmus`, no FMU.

    A Python file is run here, as it is now; the command goes on with what its function made.
    """
    from .instruments import INSTRUMENTS, SAMPLED, bare
    from .solver.component_file import BadComponentFile, names_file, read_component

    base = bare(name)
    if names_file(base):
        try:
            read_component(base)
        except BadComponentFile as error:
            raise BadRequest(f"{option}: {error}") from error
        return
    if base in known or (fmus and (Path(name).suffix == ".fmu" or os.path.exists(name))):
        return
    first, *rest = name.split("+")
    if rest and first in known:
        wrong = next((part for part in rest if part not in INSTRUMENTS), "")
        if wrong == SAMPLED:
            raise BadRequest(f"{option} {name!r}: {SAMPLED!r} comes right behind {first!r}, once")
        raise BadRequest(
            f"{option} {name!r}: no instrument {wrong!r}; there are {', '.join(INSTRUMENTS)}"
        )
    hint = did_you_mean(name, known)
    files = "FILE.py:FUNCTION nor the path of an FMU" if fmus else "FILE.py:FUNCTION"
    raise BadRequest(f"{option} {name!r} is neither one of {', '.join(known)} nor {files}{hint}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a line on a name that is not known; empty where none is near."""
    import difflib

    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f", did you mean {near[0]}?" if near else ""


def check_name(option: str, name: str, known: Iterable[str]) -> None:
    """Refuse what is none of the `known` names."""
    if name not in known:
        near = did_you_mean(name, known)
        raise BadRequest(f"{option} {name!r} is none of {', '.join(known)}{near}")


def read_pair(option: str, text: str, form: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise BadRequest(f"{option} {text!r} is not of the form {form}")
    return name.strip(), value.strip()


def read_named(option: str, texts: Sequence[str], form: str) -> dict[str, str]:
    """What repeated options say of each name; to say it twice would leave the first without use."""
    pairs = [read_pair(option, text, form) for text in texts]
    named = dict(pairs)
    for name in named:
        values = [value for other, value in pairs if other == name]
        if len(values) > 1:
            raise BadRequest(f"{option} {name} is given as {' and as '.join(values)}; expected one")
    return named


def read_whole_number(option: str, text: str | int, least: int, most: int | None = None) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or (most is not None and value > most):
        range_ = f"from {least} on" if most is None else f"from {least} to {most}"
        raise BadRequest(f"{option} is {text!r}, expected a whole number {range_}")
    return value


def read_number(option: str, text: str | float) -> float:
    try:
        value = float(text)
    except (ValueError, TypeError):
        raise BadRequest(f"{option} is {text!r}, expected a number") from None
    if not math.isfinite(value):
        raise BadRequest(f"{option} is {text}, expected a finite number")
    return value


def out_folder(text: str) -> Path:
    """The folder of ``--out``; an empty name would mean the folder that the user is in."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty, expected a folder; '.' is the present one")
    return Path(text)


def guard(action: Any) -> Any:
    """Run and turn what the user can mend into one line."""
    from .fmus.catalogue import UnknownComponent
    from .fmus.reading import FmuError
    from .fmus.system_reading import BadSystem
    from .fmus.units import BadUnit
    from .orchestration.closed_loop import BadParameter
    from .orchestration.fmu_instance import StepFailed
    from .orchestration.loop_run import CouplingError
    from .orchestration.memory import NotEnoughMemory
    from .orchestration.wiring import WiringError
    from .solver.component_file import BadComponentFile
    from .solver.contract_error import ContractError
    from .solver.tape import UnsupportedComponent

    try:
        return action()
    except (
        FmuError,
        BadSystem,
        WiringError,
        CouplingError,
        NotEnoughMemory,
        BadParameter,
        UnknownComponent,
        StepFailed,
        BadComponentFile,
        ContractError,
        UnsupportedComponent,
        BadUnit,
    ) as error:
        raise BadRequest(str(error)) from error

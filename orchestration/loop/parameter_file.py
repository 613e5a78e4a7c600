"""The parameter file: values with intervals, units and sources, one form for all commands.

`docs/parameters.md` describes it. Only this module reads and writes it: every line is checked, and
errors name their place. The readers of values at its end are for all TOML files, and raise
`BadParameters`.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...fmus.units import base_exponents
from ...plant import DEFAULT_LAW, LAWS, NOMINAL, TURNING, plant_of
from ...plant.instruments import UNLIMITED
from ...solver.errors import BadParameters, did_you_mean
from ...solver.files import readable, write_atomically
from ...solver.signals import unit_in
from .parts import Part

if TYPE_CHECKING:
    from ...solver.signals import Parameter

FORMAT = "ballscrew-parameters 1"
FILE_NAME = "parameters.toml"
BALL_SCREW, DRIVE, ROTARY, FMU = "ball_screw", "drive", "rotary_drive", "fmu"
NEUTRAL = ("gain", "Kv", "current_limit_time")
"""Parameters of plants whose defaults, other than zero, say nothing of a machine."""
KINDS = (BALL_SCREW, DRIVE, ROTARY, FMU)
COMMANDS = ("voltage", "current", "force")
COMMANDS_OF = {DRIVE: (*COMMANDS, "torque"), ROTARY: ("voltage", "current", "torque")}
"""Kinds of command of a drive, by its kind; others have a fixed one."""
TURNS = "rotating body: here N means N*m, m means rad, and kg means kg*m^2"  # of `sliding`


@dataclass(frozen=True)
class Value:
    """One parameter's value, in SI units."""

    value: float
    unit: str = ""  # empty: not given
    interval: tuple[float, float] | None = None  # 95 %; an end may be infinite
    source: str = ""  # where the value comes from


@dataclass(frozen=True)
class Diagnosed:
    """Prior model and named causes of a diagnosis, in addition to its final values; SI."""

    records: tuple[str, ...]  # their names
    command: str  # quantity of `u` in the records
    command_shift: float  # the command acts before its stamp by this, in sampling intervals
    law: str  # of the prior model; the file's own may have bristles in addition
    prior: Mapping[str, float]  # the plant's values
    adjusted: Mapping[str, float]  # within their tolerances, without any cause
    causes: Mapping[str, Mapping[str, float]]  # numbers of each


Values = Mapping[str, Value]
Known: TypeAlias = "Mapping[str, Parameter]"


@dataclass(frozen=True)
class ParameterFile:
    """Content of a parameter file; `docs/parameters.md` says what each table means."""

    path: Path | None = None  # the file it was read from
    kind: str = BALL_SCREW  # one of `KINDS`; "fmu" is any plant outside the catalogue
    law: str = ""  # of friction; empty if not given
    plant: Values = field(default_factory=dict)
    found: Values = field(default_factory=dict)  # of forces that are not in the basic plant
    controllers: Mapping[str, Values] = field(default_factory=dict)
    rig: Mapping[str, Values] = field(default_factory=dict)  # by part of the rig
    tolerance: Mapping[str, float] = field(default_factory=dict)  # relative
    not_identified: Mapping[str, str] = field(default_factory=dict)  # and why
    diagnosis: Diagnosed | None = None
    command: str = ""  # quantity of a drive's `u`, one of `COMMANDS_OF`; empty: a voltage
    turns: bool = False  # whether a rotating body is described as a sliding one, see `sliding`

    @property
    def plant_name(self) -> str:
        """The plant of the catalogue that the file describes; else raises `BadParameters`."""
        if self.kind not in NOMINAL:
            said = "no plant of the catalogue; give the plant of these values"
            raise BadParameters(f"{self.path}: kind is {self.kind!r}, {said}")
        return plant_of(self.law or DEFAULT_LAW, self.kind, self.command or COMMANDS[0])

    @property
    def lead(self) -> float | None:
        """Travel of the screw per turn [m], by `p`, or a drive's gain; 2 pi if m means rad."""
        if self.turns:
            return 2 * math.pi
        gain = self.plant.get("gain", Value(0.0)).value
        if gain > 0 and (self.kind, self.command) == (DRIVE, "torque"):
            return 2 * math.pi / gain
        return 1 / self.plant["p"].value if "p" in self.plant else None

    def with_lead(self, lead: float | None) -> ParameterFile:
        """The file with this travel of the screw per turn [m]; a rotating body as by `sliding`."""
        if self.kind == ROTARY:
            if lead is not None:
                body = f"{self.path} describes a rotating body without one; leave the lead out"
                raise BadParameters(f"a lead is for a screw, but {body}")
            return self.sliding()
        if lead is None or self.kind != BALL_SCREW:
            return self
        if self.plant and "p" not in self.plant:
            return replace(self, plant={**self.plant, "p": Value(1 / lead, "1/m", None, "given")})
        own = self.lead or 1 / Part(self.plant_name).parameters["p"].default
        if not math.isclose(lead, own, rel_tol=1e-6):
            raise BadParameters(
                f"the lead is given as {lead:g} m, but {self.path or 'the nominal axis'} has "
                f"{own:g} m; expected the same, or a parameter file of this machine"
            )
        return self

    def checked(self) -> ParameterFile:
        """The file; raises `BadParameters` for values that its plant does not have."""
        self.plant_values(Part(self.plant_name).parameters)
        return self

    def sliding(self) -> ParameterFile:
        """A rotating body described as a sliding one with a lead of 2 pi, with `m` for `J`."""
        self.checked()
        plant = {"m" if n == "J" else n: replace(v, unit="") for n, v in self.plant.items()}
        tolerance = {"m" if n == "J" else n: share for n, share in self.tolerance.items()}
        command = "force" if self.command == "torque" else self.command
        slides = replace(self, kind=DRIVE, command=command, turns=True)
        return replace(slides, plant=plant, tolerance=tolerance)

    def turning(self) -> ParameterFile:
        """The rotating body, if this is a result of `sliding`; else unchanged."""
        if not self.turns:
            return self
        command = "torque" if self.command == "force" else self.command
        turns = replace(self, kind=ROTARY, command=command, turns=False)
        return replace(turns, plant=_turned(self.plant), found=_turned(self.found))

    def plant_values(self, known: Known, others: Collection[str] = ()) -> dict[str, float]:
        """Checked values for a plant with `known` parameters; what it lacks of `others` is left."""
        use = {n: v for n, v in self.plant.items() if n in known or n not in others}
        values = check_values(use, known, f"{self.path}: [plant]")
        use = {n: v for n, v in self.found.items() if n in known}
        values |= check_values(use, known, f"{self.path}: [found]")
        for coulomb in [n for n in values if n in ("Fc", "Fc_pos", "Fc_neg")]:
            breakaway, speed = (coulomb.replace("Fc", other) for other in ("Fs", "Vs"))
            if breakaway in known:
                values.setdefault(breakaway, values[coulomb])
                if speed in known and values[breakaway] == values[coulomb]:  # it has no effect
                    values.setdefault(speed, known[speed].default)
        return values

    def check_complete(self, known: Known, values: Collection[str]) -> None:
        """Raise `BadParameters` if a parameter of a machine is not among those with values.

        Its default would be that of another machine. Zero, no limit and `NEUTRAL` say nothing of
        one; a file without ``[plant]`` is of the nominal plant.
        """
        for name, p in known.items() if self.plant else ():
            if name not in values and name not in NEUTRAL and 0.0 < abs(p.default) < UNLIMITED:
                raise BadParameters(
                    f"{self.path}: [plant] has no {name} ({p.meaning}), and the nominal axis' is "
                    "that of another machine; give its value"
                )

    def text(self) -> str:
        """The file's text, TOML."""
        import tomli_w

        data: dict[str, Any] = {"format": FORMAT, "kind": self.kind, "command": self.command}
        data |= {"law": self.law, "plant": _tables(self.plant), "found": _tables(self.found)}
        for name, group in (("controller", self.controllers), ("rig", self.rig)):
            data[name] = {n: _tables(values) for n, values in group.items() if values}
        data["tolerance"] = dict(self.tolerance)
        data["not_identified"] = {n: readable(why) for n, why in self.not_identified.items()}
        if self.diagnosis:
            records = [readable(name) for name in self.diagnosis.records]
            data["diagnosis"] = {**asdict(self.diagnosis), "records": records}
        return tomli_w.dumps({n: part for n, part in data.items() if part or n == "plant"})

    def save(self, folder: Path | str) -> Path:
        """Write ``parameters.toml`` into `folder`; raises OSError if it cannot be written."""
        path = Path(folder) / FILE_NAME
        write_atomically(path, self.text().encode())
        return path


def _tables(values: Values) -> dict[str, dict[str, Any]]:
    tables = {}
    for name, v in values.items():
        ends = v.interval and [float(end) for end in v.interval]
        table = {"unit": v.unit, "interval": ends, "source": readable(v.source)}
        tables[name] = {"value": float(v.value)} | {n: t for n, t in table.items() if t}
    return tables


def _turned(values: Values) -> Values:
    units = {n: unit_in(v.unit, TURNING) for n, v in values.items()}
    return {"J" if n == "m" else n: replace(v, unit=units[n]) for n, v in values.items()}


def check_values(values: Values, known: Known, where: str) -> dict[str, float]:
    """The plain numbers of values whose names, units and ranges fit; else `BadParameters`."""
    check_names(where, values, known)
    for name, v in values.items():
        p = known[name]
        if v.unit and p.unit and not _same(v.unit, p.unit):
            raise BadParameters(f"{where} {name} has the unit {v.unit!r}, expected {p.unit!r}")
        if not p.minimum <= v.value <= p.maximum:
            limits = f"{p.minimum:g} to {p.maximum:g} ({p.meaning})"
            raise BadParameters(f"{where} {name} is {v.value:g} {p.unit}, expected {limits}")
    return {name: v.value for name, v in values.items()}


def _same(one: str, other: str) -> bool:
    """Whether two units are the same, in any spelling."""
    try:
        return one == other or base_exponents(one) == base_exponents(other)
    except ValueError:
        return False


def read_parameters(path: Path | str) -> ParameterFile:
    """Read a parameter file; raises `BadParameters`. Names are checked where they are used."""
    try:
        given = as_record("", read_toml(Path(path)), _READERS)
        form, kind = given.pop("format", FORMAT), given.setdefault("kind", BALL_SCREW)
        if form != FORMAT:
            raise BadParameters(f"format is {form!r}, expected {FORMAT!r}")
        if (command := given.get("command")) is not None:
            if kind not in COMMANDS_OF:
                raise BadParameters(
                    f"has the key command, and a plant of the kind {kind!r} has its own; remove "
                    f"it, or set kind to one of {', '.join(COMMANDS_OF)}"
                )
            command = as_choice("command", command, COMMANDS_OF[kind])
            given["command"] = "" if command == COMMANDS[0] else command
    except BadParameters as error:
        raise BadParameters(f"{path}: {error}") from error
    return ParameterFile(Path(path), controllers=given.pop("controller", {}), **given)


Reader: TypeAlias = Callable[[str, Any], Any]  # reads a value; the text is its place, for messages
Readers: TypeAlias = Mapping[str, Reader]  # by keys of a table


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadParameters(f"cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:  # of TOML, of UTF-8, or too many digits
        why = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise BadParameters(f"is not a TOML file: {why}") from error


def _reader(kind: type, called: str) -> Reader:
    def read(where: str, given: Any) -> Any:
        if not isinstance(given, kind):
            raise BadParameters(f"{where} is {given!r:.80}, expected {called}")
        return kind(given)

    return read


as_table, as_list = _reader(dict, "a table"), _reader(list, "a list")  # copies
as_flag, as_text = _reader(bool, "true or false"), _reader(str, "a text")


def as_texts(where: str, given: Any) -> tuple[str, ...]:
    return tuple(as_text(where, name) for name in as_list(where, given))


def as_choice(where: str, given: Any, names: Iterable[str]) -> str:
    """One of these names."""
    names = list(names)
    if given not in names:
        raise BadParameters(f"{where} is {given!r}, expected one of {', '.join(names)}")
    return str(given)


def as_finite(where: str, given: Any) -> float:
    """A finite number; an integer may have more digits than a float can hold."""
    plain = isinstance(given, int | float) and not isinstance(given, bool)
    if not (plain and abs(given) <= sys.float_info.max):
        shown = "a number beyond 1e308" if type(given) is int else f"{given!r:.80}"
        raise BadParameters(f"{where} is {shown}, expected a finite number in SI units")
    return float(given)


def as_range(where: str, given: Any) -> tuple[float, float]:
    """Two finite numbers, the lower one first."""
    low, high = _ends(where, given)
    if not -math.inf < low < high < math.inf:
        said = "expected two finite numbers, the lower one first"
        raise BadParameters(f"{where} is {given!r:.80}, {said}")
    return low, high


def within(least: float, most: float = math.inf, whole: bool = False) -> Reader:
    """The reader of a number within limits."""
    expected = f"a whole number, {least} to {most}" if whole else f"{least:g} or more"

    def read(where: str, given: Any) -> float:
        number = as_finite(where, given)
        if not least <= number <= most or (whole and number != int(number)):
            raise BadParameters(f"{where} is {given!r}, expected {expected}")
        return int(given) if whole else number

    return read


def check_names(where: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Make sure that all names are known."""
    known = list(known)
    for name in given:
        if name not in known:
            hint = did_you_mean(name, known) or f"; there are {', '.join(known)}"
            raise BadParameters(f"{where} there is no {name!r}{hint}".lstrip())


def as_record(where: str, given: Any, readers: Readers, *required: str) -> dict[str, Any]:
    """A table with known keys, each value read by its reader; `required` are there."""
    table = as_table(where, given)
    check_names(where, table, readers)
    for name in required:
        if name not in table:
            raise BadParameters(f"{where} has no {name}")
    return {name: readers[name](f"{where} {name}".lstrip(), v) for name, v in table.items()}


def _table_of(read: Reader, form: str) -> Reader:
    """The reader of a table, each value read by `read` with its place in this form."""

    def read_table(where: str, given: Any) -> dict[str, Any]:
        table = as_table(where, given)
        return {name: read(form.format(where, name), value) for name, value in table.items()}

    return read_table


def _value(where: str, given: Any) -> Value:
    if not isinstance(given, dict):
        return Value(as_finite(where, given))
    readers = {"value": as_finite, "unit": as_text, "interval": _ends, "source": as_text}
    value = Value(**as_record(where, given, readers, "value"))
    low, high = value.interval or (value.value, value.value)
    if not low <= value.value <= high:
        form = f"[low, high] with the value {value.value:g} between them"
        raise BadParameters(f"{where}: the interval is not of the form {form}")
    return value


def _ends(where: str, given: Any) -> tuple[float, float]:
    """The ends of an interval, which may be infinite."""
    if len(pair := as_list(where, given)) != 2:
        raise BadParameters(f"{where} is {given!r}, expected [low, high]")
    low, high = (end if isinstance(end, float) else as_finite(where, end) for end in pair)
    return low, high


def _diagnosed(where: str, given: Any) -> Diagnosed:
    return Diagnosed(**as_record(where, given, _OF_DIAGNOSIS, *_OF_DIAGNOSIS))


as_numbers, as_ranges = (_table_of(read, "{}: {}") for read in (as_finite, as_range))
_law = partial(as_choice, names=(*LAWS,))
_values = _table_of(_value, "[{}] {}")
_groups = _table_of(_values, "{}.{}")
_OF_DIAGNOSIS: dict[str, Reader] = {
    "records": as_texts,
    "command": partial(as_choice, names=COMMANDS_OF[DRIVE]),
    "command_shift": as_finite,
    "law": _law,
    **dict.fromkeys(("prior", "adjusted"), as_numbers),
    "causes": _table_of(as_numbers, "{}.{}"),
}
_READERS: dict[str, Reader] = {
    "format": as_text,
    "kind": partial(as_choice, names=KINDS),
    "command": as_text,
    "law": _law,
    **dict.fromkeys(("plant", "found"), _values),
    **dict.fromkeys(("controller", "rig"), _groups),
    "tolerance": as_numbers,
    "not_identified": _table_of(lambda _, reason: str(reason), ""),
    "diagnosis": _diagnosed,
}

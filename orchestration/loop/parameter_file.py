"""The parameter file: values with intervals, units and sources, one form for all commands.

`docs/parameters.md` describes it. Only this module reads and writes it: every line is checked, and
errors name their place.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...fmus.interface import START, TOLERANCE
from ...fmus.units import base_exponents
from ...plant import DEFAULT_LAW, LAWS, NOMINAL, TURNING, plant_of
from ...plant.instruments import UNLIMITED
from ...solver.errors import BadParameters
from ...solver.files import write_atomically
from . import toml_tables as toml

if TYPE_CHECKING:
    from ...solver.component import Parameter
    from ...solver.kernel import ParameterInfo

FORMAT = "ballscrew-parameters 1"
FILE_NAME = "parameters.toml"
BALL_SCREW, DRIVE, ROTARY, FMU = "ball_screw", "drive", "rotary_drive", "fmu"
NEUTRAL = ("gain", "Kv", "current_limit_time")
"""Parameters of plants whose defaults, other than zero, say nothing of a machine."""
KINDS = (BALL_SCREW, DRIVE, ROTARY, FMU)
COMMANDS = ("voltage", "current", "force")
COMMANDS_OF = {DRIVE: (*COMMANDS, "torque"), ROTARY: ("voltage", "current", "torque")}
"""Kinds of command of a drive, by its kind; others have a fixed one."""
TURNS = "rotating body: here N means N*m, m means rad, and kg means kg*m^2"
"""Note for the use of `ParameterFile.sliding`."""


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
Known: TypeAlias = "Mapping[str, ParameterInfo] | Mapping[str, Parameter]"


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
        """The plant of the catalogue that the file describes.

        Raises `BadParameters` if there is none.
        """
        if self.kind not in NOMINAL:
            raise BadParameters(
                f"{self.path}: kind is {self.kind!r}, which is not a plant of the "
                "catalogue; give the plant of these values"
            )
        return plant_of(self.law or DEFAULT_LAW, self.kind, self.command or COMMANDS[0])

    @property
    def lead(self) -> float | None:
        """Travel of the screw per turn [m], by `p`, or a drive's gain; 2 pi if m means rad."""
        if self.turns:
            return 2 * math.pi
        gain = self.plant.get("gain") if (self.kind, self.command) == (DRIVE, "torque") else None
        if gain and gain.value > 0:
            return 2 * math.pi / gain.value
        return 1 / self.plant["p"].value if "p" in self.plant else None

    def with_lead(self, lead: float | None) -> ParameterFile:
        """The file with this travel of the screw per turn [m], if its plant has a screw.

        A rotating body has none, and is described as a sliding one, see `sliding`. Raises
        `BadParameters` if the plant has another lead, or the body rotates.
        """
        if self.kind == ROTARY:
            if lead is not None:
                raise BadParameters(
                    f"a lead is for a screw, but {self.path} describes a rotating body "
                    "without one; leave the lead out"
                )
            return self.sliding()
        if lead is None or self.kind != BALL_SCREW:
            return self
        if self.plant and "p" not in self.plant:
            return replace(self, plant={**self.plant, "p": Value(1 / lead, "1/m", None, "given")})
        from .parts import Part

        own = self.lead or 1 / Part(self.plant_name).parameters["p"].default
        if not math.isclose(lead, own, rel_tol=1e-6):
            raise BadParameters(
                f"the lead is given as {lead:g} m, but {self.path or 'the nominal axis'} has "
                f"{own:g} m; expected the same, or a parameter file of this machine"
            )
        return self

    def checked(self) -> ParameterFile:
        """The file; raises `BadParameters` for values that its plant does not have."""
        from .parts import Part

        self.plant_values(Part(self.plant_name).parameters)
        return self

    def sliding(self) -> ParameterFile:
        """A rotating body described as a sliding one: rad for m, N*m for N, `m` for `J`.

        This fits records with a lead of 2 pi; `turning` is the inverse. Raises `BadParameters` for
        values that its plant does not have.
        """
        self.checked()
        plant = {"m" if n == "J" else n: replace(v, unit="") for n, v in self.plant.items()}
        tolerance = {"m" if n == "J" else n: share for n, share in self.tolerance.items()}
        command = COMMANDS[-1] if self.command == COMMANDS_OF[ROTARY][-1] else self.command
        told = replace(self, kind=DRIVE, plant=plant, tolerance=tolerance, command=command)
        return replace(told, turns=True)

    def turning(self) -> ParameterFile:
        """The rotating body, if this is a result of `sliding`; else unchanged."""
        if not self.turns:
            return self
        from ...solver.component import unit_in

        def turned(values: Values) -> dict[str, Value]:
            return {
                "J" if n == "m" else n: replace(v, unit=unit_in(v.unit, TURNING))
                for n, v in values.items()
            }

        command = COMMANDS_OF[ROTARY][-1] if self.command == COMMANDS[-1] else self.command
        told = replace(self, kind=ROTARY, turns=False, command=command)
        return replace(told, plant=turned(self.plant), found=turned(self.found))

    def plant_values(
        self, known: Known, others: Collection[str] = ()
    ) -> tuple[dict[str, float], list[str]]:
        """Values for a plant with `known` parameters, checked, and names that it does not use.

        If the file has Fc and not Fs, the break-away force is Fc. `others` are parameters of the
        plant that the file describes: one that is not known is ignored. Raises `BadParameters`.
        """
        use = {n: v for n, v in self.plant.items() if n in known or n not in others}
        found = {n: v for n, v in self.found.items() if n in known}
        values = check_values(use, known, f"{self.path}: [plant]")
        values |= check_values(found, known, f"{self.path}: [found]")
        for coulomb in [n for n in values if n in ("Fc", "Fc_pos", "Fc_neg")]:
            breakaway, speed = (coulomb.replace("Fc", other) for other in ("Fs", "Vs"))
            if breakaway in known:
                values.setdefault(breakaway, values[coulomb])
                if speed in known and values[breakaway] == values[coulomb]:  # it has no effect
                    values.setdefault(speed, known[speed].default)
        return values, [n for n in (*self.plant, *self.found) if n not in values]

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

    def controller_values(self, name: str, known: Known) -> dict[str, float]:
        """Values for the controller of this name, checked; raises `BadParameters`."""
        where = f"{self.path}: [controller.{name}]"
        return check_values(self.controllers.get(name, {}), known, where)

    def text(self) -> str:
        """The file's text, TOML."""
        import tomli_w

        data: dict[str, Any] = {"format": FORMAT, "kind": self.kind}
        data |= {"command": self.command} if self.command else {}
        data |= {"law": self.law} if self.law else {}
        data |= {"plant": _tables(self.plant)}
        data |= {"found": _tables(self.found)} if self.found else {}
        for key, groups in (("controller", self.controllers), ("rig", self.rig)):
            if any(groups.values()):
                data[key] = {name: _tables(values) for name, values in groups.items() if values}
        data |= {"tolerance": dict(self.tolerance)} if self.tolerance else {}
        reasons = {name: _written(reason) for name, reason in self.not_identified.items()}
        data |= {"not_identified": reasons} if reasons else {}
        if self.diagnosis:
            records = [_written(name) for name in self.diagnosis.records]
            data["diagnosis"] = {**asdict(self.diagnosis), "records": records}
        return tomli_w.dumps(data)

    def save(self, folder: Path | str) -> Path:
        """Write ``parameters.toml`` into `folder`; raises OSError if it cannot be written."""
        path = Path(folder) / FILE_NAME
        write_atomically(path, self.text().encode())
        return path


def _tables(values: Values) -> dict[str, dict[str, Any]]:
    tables = {}
    for name, v in values.items():
        table: dict[str, Any] = {"value": float(v.value)}
        table |= {"unit": v.unit} if v.unit else {}
        table |= {"interval": [float(end) for end in v.interval]} if v.interval else {}
        table |= {"source": _written(v.source)} if v.source else {}
        tables[name] = table
    return tables


def _written(text: str) -> str:
    """The text with file names in UTF-8, also if the locale does not have their characters."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def list_used(
    known: Known, values: Mapping[str, float], told: Values, source: str
) -> dict[str, Value]:
    """All parameters of a part with the values that they had, as a parameter file lists them.

    Initial states and the solver's tolerance are listed only if they are among the given `values`.
    Those of a file that are not changed keep their interval and source; others have `source`.
    """
    found = {}
    for name, p in known.items():
        if name in values:
            said = told.get(name)
            kept = said is not None and said.value == values[name]
            value = said if said is not None and kept else Value(values[name], source=source)
            found[name] = replace(value, unit=p.unit)
        elif not name.endswith(START) and name != TOLERANCE and math.isfinite(p.default):
            found[name] = Value(p.default, p.unit, None, p.source)
    return found


def check_values(values: Values, known: Known, where: str) -> dict[str, float]:
    """The plain numbers of values whose names, units and ranges fit; else `BadParameters`."""
    toml.check_names(where, values, known)
    for name, v in values.items():
        p = known[name]
        if v.unit and p.unit and not _same(v.unit, p.unit):
            raise BadParameters(f"{where} {name} has the unit {v.unit!r}, expected {p.unit!r}")
        if not p.minimum <= v.value <= p.maximum:
            raise BadParameters(
                f"{where} {name} is {v.value:g} {p.unit}, expected {p.minimum:g} to "
                f"{p.maximum:g} ({p.meaning})"
            )
    return {name: v.value for name, v in values.items()}


def _same(one: str, other: str) -> bool:
    """Whether two units are the same, in any spelling."""
    try:
        return one == other or base_exponents(one) == base_exponents(other)
    except ValueError:
        return False


def read_parameters(path: Path | str) -> ParameterFile:
    """Read a parameter file; the names of parameters are checked where they are used.

    Raises `BadParameters`, in one line: what cannot be used and why.
    """
    path = Path(path)
    try:
        return _read(path, toml.read_toml(path))
    except BadParameters as error:
        raise BadParameters(f"{path}: {error}") from error


def _read(path: Path, data: dict[str, Any]) -> ParameterFile:
    given = toml.as_record("", data, _READERS)
    form, kind = given.pop("format", FORMAT), given.setdefault("kind", BALL_SCREW)
    if form != FORMAT:
        raise BadParameters(f"format is {form!r}, expected {FORMAT!r}")
    if "command" in given:
        given["command"] = _command(kind, given["command"])
    return ParameterFile(path, controllers=given.pop("controller", {}), **given)


def _command(kind: str, given: Any) -> str:
    if kind not in COMMANDS_OF:
        raise BadParameters(
            f"has the key command, and a plant of the kind {kind!r} has its own; remove it, or set "
            f"kind to one of {', '.join(COMMANDS_OF)}"
        )
    command = toml.as_choice("command", given, COMMANDS_OF[kind])
    return "" if command == COMMANDS[0] else command


def _groups(where: str, given: Any) -> dict[str, Values]:
    groups = toml.as_table(f"[{where}]", given)
    return {name: _values(f"{where}.{name}", values) for name, values in groups.items()}


def _values(where: str, given: Any) -> dict[str, Value]:
    found = toml.as_table(f"[{where}]", given)
    return {name: _value(f"[{where}] {name}", value) for name, value in found.items()}


def _value(where: str, given: Any) -> Value:
    if not isinstance(given, dict):
        return Value(toml.as_finite(where, given))
    readers = {"value": toml.as_finite, "unit": toml.as_text, "interval": _pair}
    readers["source"] = toml.as_text
    value = Value(**toml.as_record(where, given, readers, "value"))
    low, high = value.interval or (value.value, value.value)
    if not low <= value.value <= high:
        form = f"[low, high] with the value {value.value:g} between them"
        raise BadParameters(f"{where}: the interval is not of the form {form}")
    return value


def _pair(where: str, given: Any) -> tuple[float, float]:
    """The ends of an interval, which may be infinite."""
    pair: list[Any] = given if isinstance(given, list) and len(given) == 2 else [None]
    if not all(isinstance(end, float) or toml.is_number(end) for end in pair):
        raise BadParameters(f"{where} is {given!r}, expected [low, high]")
    return float(pair[0]), float(pair[1])


def _diagnosed(where: str, given: Any) -> Diagnosed:
    def causes(where: str, given: Any) -> dict[str, dict[str, float]]:
        found = toml.as_table(where, given)
        return {n: toml.as_numbers(f"{where}.{n}", values) for n, values in found.items()}

    def one_of(names: Iterable[str]) -> toml.Reader:
        return partial(toml.as_choice, names=tuple(names))

    readers = {
        "records": toml.as_texts,
        "command": one_of(COMMANDS_OF[DRIVE]),
        "command_shift": toml.as_finite,
        "law": one_of(LAWS),
        "prior": toml.as_numbers,
        "adjusted": toml.as_numbers,
        "causes": causes,
    }
    return Diagnosed(**toml.as_record(f"[{where}]", given, readers, *readers))


def _reasons(where: str, given: Any) -> dict[str, str]:
    return {name: str(reason) for name, reason in toml.as_table(f"[{where}]", given).items()}


_READERS: dict[str, toml.Reader] = {
    "format": toml.as_text,
    "kind": partial(toml.as_choice, names=KINDS),
    "command": toml.as_text,
    "law": partial(toml.as_choice, names=LAWS),
    "plant": _values,
    "found": _values,
    "controller": _groups,
    "rig": _groups,
    "tolerance": lambda where, given: toml.as_numbers(f"[{where}]", given),
    "not_identified": _reasons,
    "diagnosis": _diagnosed,
}

"""Open an FMU of any origin: check it first, and unpack it into its own folder."""

from __future__ import annotations

import math
import re
import shutil
import zipfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree as ET

from ..solver.errors import FmuError
from .archive import check_lines, first_element, number, open_archive, unpack_archive
from .source_fmu import NotCompiled, compile_sources
from .units import BASE_UNITS, Unit

REAL = ("Real", "Float64", "Float32")
SIZED = tuple(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))
WHOLE = ("Integer", "Boolean", "Enumeration", *SIZED)

SETTABLE = ("parameter", "input")
_DESCRIPTION = "modelDescription.xml"
_READ = (_DESCRIPTION, "sources/buildDescription.xml")  # by fmpy


@dataclass(frozen=True)
class NumberVariable:
    """One scalar variable: a number, a Boolean or an item of an enumeration."""

    name: str
    type: str  # in its version of FMI
    reference: int
    causality: str
    unit: str  # its own or that of its declared type; empty if none
    nominal: float
    start: float | None
    direct: bool  # whether an output may have direct feedthrough; True if it is not declared
    sampled: bool  # whether it is a real number that is declared as discrete
    # inputs that it depends on in initialization; None if they are not declared
    initially_from: tuple[str, ...] | None = None
    items: dict[str, int] = field(default_factory=dict)  # of an enumeration, by name
    minimum: float = -math.inf
    maximum: float = math.inf
    relative: bool = False  # a difference, for which the offset of its unit does not count

    @property
    def is_real(self) -> bool:
        """Whether it is a real number."""
        return self.type in REAL


@dataclass(frozen=True)
class Description:
    """Data of a modelDescription.xml that the master needs."""

    fmi: int  # 2 or 3
    exchanges: bool  # for model exchange only, so that it needs our solver
    states: int  # continuous ones, from FMI 2.0
    indicators: int  # of events, from FMI 2.0
    guid: str
    identifier: str
    variables: tuple[NumberVariable, ...]
    units: dict[str, dict[str, str]]  # of those in base units, attributes of the BaseUnit
    # of the String ``message``, the reason of a failed step in our FMUs; earlier an output
    message_reference: int | None
    saves_state: bool
    once_per_process: bool
    step_size: float | None = None  # of its default experiment [s]
    steps_vary: bool = True  # whether its communication steps may vary in length
    strings: dict[str, int] = field(default_factory=dict)  # references of String parameters
    aliases: dict[str, str] = field(default_factory=dict)  # names by other names

    @cached_property
    def by_name(self) -> dict[str, NumberVariable]:
        return {v.name: v for v in self.variables}

    def names(self, causality: str) -> list[str]:
        """Names of the variables of a causality."""
        return [v.name for v in self.variables if v.causality == causality]

    def unit(self, name: str) -> Unit | None:
        """The unit of a variable; None if the FMU does not give one."""
        variable = self.by_name[name]
        if not (unit := variable.unit):
            return None
        base = self.units.get(unit)
        found = Unit.named(unit) if base is None else Unit.defined(unit, base)
        return replace(found, relative=variable.relative)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        return own | {"variables": [vars(v) for v in self.variables]}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Description:
        variables = tuple(NumberVariable(**v) for v in data["variables"])
        return cls(**{**data, "variables": variables})


@dataclass(frozen=True)
class UnpackedFmu:
    """An FMU's description and the folder it was unpacked to; `remove` deletes the folder."""

    path: Path
    description: Description
    folder: Path

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def unpack(path: Path | str) -> UnpackedFmu:
    """Check and unpack an FMU of FMI 2.0 or 3.0, for co-simulation or model exchange.

    Raises
    ------
    FmuError
        If the file is missing, is no FMU, contains a path outside its folder, or has no binary for
        this platform and no sources that compile to one.
    """
    path, folder = Path(path), None
    try:
        folder = unpack_archive(path)
        description, configurations = describe(path)
        _find_binary(folder, description, configurations)
    except BaseException as error:
        if folder:
            shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, FmuError):
            raise FmuError(f"{path}: {error}") from error
        raise
    return UnpackedFmu(path, description, folder)


def read_description(path: Path | str) -> Description:
    """What an FMU says about itself; it need not run here. Raises `FmuError`."""
    try:
        return describe(Path(path))[0]
    except FmuError as error:
        raise FmuError(f"{path}: {error}") from error


def describe(path: Path) -> tuple[Description, list[Any]]:
    """Description of a packed FMU, and fmpy's configurations for building it.

    Raises
    ------
    FmuError
        Without the file's name.
    """
    from fmpy import read_model_description

    with open_archive(path) as archive:
        if _DESCRIPTION not in archive.namelist():
            raise FmuError(f"contains no {_DESCRIPTION}, so it is not an FMU")
        try:
            roots = {name: _checked(archive, name) for name in _READ if name in archive.namelist()}
            version = roots[_DESCRIPTION].get("fmiVersion", "of no version")
            if not re.fullmatch(r"2\.0|3\.\d+", version):
                raise FmuError(f"is FMI {version}, expected FMI 2.0 or 3.0")
            read = read_model_description(str(path), validate=False)
            with archive.open(_DESCRIPTION) as text:
                description = _described(read, _attributes_of(text))
        except FmuError:
            raise
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise FmuError(f"{_DESCRIPTION} is incomplete ({error})") from error
        except Exception as error:  # the parser raises many kinds
            reason = str(error) or type(error).__name__
            raise FmuError(f"{_DESCRIPTION} cannot be read: {reason}") from error
    if not re.fullmatch(r"[A-Za-z_]\w*", description.identifier):
        raise FmuError(f"modelIdentifier is {description.identifier!r}, expected a name in C")
    return description, read.buildConfigurations


def _checked(archive: zipfile.ZipFile, name: str) -> dict[str, str]:
    with archive.open(name) as stream:
        return first_element(stream, archive.getinfo(name).file_size, name)


def _find_binary(folder: Path, description: Description, configurations: list[Any]) -> None:
    """Make sure that there is a library; if there is none, compile it from the sources."""
    from fmpy import platform, platform_tuple, sharedLibraryExtension

    here = platform if description.fmi == 2 else platform_tuple
    binary = f"binaries/{here}/{description.identifier}{sharedLibraryExtension}"
    if (folder / binary).is_file():
        return
    own = [c for c in configurations if c.modelIdentifier == description.identifier]
    if own:
        try:
            compile_sources(folder, own[0], binary)
        except NotCompiled as error:
            raise FmuError(f"has sources but no binary for this platform, and {error}") from error
    else:
        there = sorted(p.name for p in (folder / "binaries").glob("*") if p.is_dir())
        raise FmuError(
            f"has no binary for this platform, expected {binary}; it has binaries for "
            f"{', '.join(there) or 'none'}"
        )


def _described(read: Any, declared: Mapping[str, Mapping[str, str]]) -> Description:
    kind = read.coSimulation or read.modelExchange
    if kind is None:
        what = "scheduled execution only" if read.scheduledExecution else "neither"
        raise FmuError(f"is for {what}, expected co-simulation or model exchange")
    # outputs may also depend on states: this is not direct feedthrough
    now, initially = _inputs_of(read.outputs), _inputs_of(read.initialUnknowns)
    variables = []
    message, strings, aliases = None, {}, {}
    check_lines(v.name for v in read.modelVariables)
    for name, count in Counter(v.name for v in read.modelVariables).most_common(1):
        if count > 1:
            raise FmuError(f"{_DESCRIPTION} has two variables called {name!r}")
    for v in read.modelVariables:
        if v.type == "String" and v.name == "message" and v.causality in ("local", "output"):
            message = int(v.valueReference)
        if v.type == "String" and v.causality == "parameter" and not v.dimensions:
            strings[str(v.name)] = int(v.valueReference)
        is_signal = v.causality in ("input", "output")
        if v.type == "Clock" or (v.dimensions and is_signal):
            what = "a clock" if v.type == "Clock" else f"an array and an {v.causality}"
            raise FmuError(f"{v.name} is {what}, expected scalar signals without clocks")
        if v.type not in (*REAL, *WHOLE) or v.dimensions:
            continue
        if v.alias is not None:
            aliases[str(v.name)] = str(v.alias.name)
            continue
        low, high = (_bound(v, declared, key) for key in ("min", "max"))
        if low > high:
            raise FmuError(f"{v.name} has the min {low:g} above its max {high:g}")
        nominal = abs(float(v.nominal)) if v.nominal else 1.0
        variables.append(
            NumberVariable(
                v.name,
                v.type,
                int(v.valueReference),
                str(v.causality),
                str(_declared(v, declared, "unit") or ""),
                nominal if math.isfinite(nominal) and nominal > 0 else 1.0,
                _start(v),
                now.get(v.name) != (),
                v.type in REAL and v.variability == "discrete",
                () if v.initial == "exact" else initially.get(v.name),
                _items(v),
                low,
                high,
                _declared(v, declared, "relativeQuantity") in ("true", "1", True),
            )
        )
    return Description(
        int(read.fmiVersion[0]),
        read.coSimulation is None,
        int(read.numberOfContinuousStates),
        int(read.numberOfEventIndicators),
        str(read.guid),
        str(kind.modelIdentifier),
        tuple(variables),
        _defined_units(read),
        message,
        bool(kind.canGetAndSetFMUstate),
        bool(kind.canBeInstantiatedOnlyOncePerProcess),
        _step_size(read.defaultExperiment),
        read.coSimulation is None or bool(kind.canHandleVariableCommunicationStepSize),
        strings,
        aliases,
    )


def _inputs_of(unknowns: Any) -> dict[str, tuple[str, ...]]:
    """Inputs that each unknown depends on; without those that do not declare what they are."""
    return {
        u.variable.name: tuple(d.name for d in u.dependencies if d.causality == "input")
        for u in unknowns or ()
        if u.dependencies is not None
    }


def _attributes_of(stream: IO[bytes]) -> dict[str, Mapping[str, str]]:
    """Attributes of each variable of a modelDescription.xml; fmpy leaves out some of them."""
    variables = ET.parse(stream).getroot().find("ModelVariables")
    return {
        v.get("name", ""): next((c for c in v if c.tag in (*REAL, *WHOLE)), v).attrib
        for v in (variables if variables is not None else ())
    }


def _declared(variable: Any, declared: Mapping[str, Mapping[str, str]], key: str) -> Any:
    """An attribute of a variable, or of its declared type; None if there is none."""
    return declared[variable.name].get(key, getattr(variable.declaredType, key, None))


def _bound(variable: Any, declared: Mapping[str, Mapping[str, str]], key: str) -> float:
    text = _declared(variable, declared, key) if variable.causality in SETTABLE else None
    if text is None:
        return math.inf if key == "max" else -math.inf
    value = float(text)
    if math.isnan(value):
        raise ValueError(f"the {key} of {variable.name!r} is {text!r}, expected a number")
    return value


def _items(variable: Any) -> dict[str, int]:
    declared = variable.declaredType if variable.type == "Enumeration" else None
    return {str(i.name): int(i.value) for i in (declared.items if declared else None) or ()}


def _start(variable: Any) -> float | None:
    if variable.start is None:
        return None
    if variable.type == "Boolean":
        return float(variable.start in ("true", "1"))
    if variable.causality not in SETTABLE:
        return float(variable.start)
    return number(variable.start, f"the start value of {variable.name!r}")


def _step_size(experiment: Any) -> float | None:
    text = experiment.stepSize if experiment is not None else None
    size = float(text) if text else 0.0
    return size if math.isfinite(size) and size > 0 else None


def _defined_units(read: Any) -> dict[str, dict[str, str]]:
    """`Description.units` of a model description read by fmpy; rejects invalid ones."""
    units = {}
    for unit in (u for u in read.unitDefinitions or () if u.baseUnit is not None):
        given = ((key, getattr(unit.baseUnit, key)) for key in (*BASE_UNITS, "factor", "offset"))
        units[unit.name] = {key: str(value) for key, value in given if value is not None}
        Unit.defined(unit.name, units[unit.name])
    return units

"""Open an FMU of any origin: check it first, and unpack it into its own folder."""

from __future__ import annotations

import math
import re
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree as ET

from .archive import BadArchive, unpack_archive
from .model_xml import BadXml, check_file, check_lines
from .source_fmu import NotCompiled, compile_sources
from .system_xml import BASE_UNITS, Unit, number
from .units import BadUnit, base_exponents

REAL = ("Real", "Float64", "Float32")
WHOLE = (
    "Integer",
    "Boolean",
    "Enumeration",
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
)

SETTABLE = ("parameter", "input")


class FmuError(ValueError):
    """The file is not an FMU that can run here; the message says what is wrong with it."""


@dataclass(frozen=True)
class NumberVariable:
    """One scalar variable: a number, a Boolean or an item of an enumeration.

    Attributes
    ----------
    type : str
        Name of the type in its version of FMI.
    unit : str
        Its own or that of its declared type; empty if none.
    direct : bool
        Whether this output may have direct feedthrough from inputs; True if it is not declared.
    sampled : bool
        Whether it is a real number that is declared as discrete.
    initially_from : tuple of str, optional
        Inputs that this output depends on in initialization; None if they are not declared.
    items : dict of str to int
        Of an enumeration: the values by name.
    minimum, maximum : float
    relative : bool
        Whether it is a difference, for which the offset of its unit does not count.
    """

    name: str
    type: str
    reference: int
    causality: str
    unit: str
    nominal: float
    start: float | None
    direct: bool
    sampled: bool
    initially_from: tuple[str, ...] | None = None
    items: dict[str, int] = field(default_factory=dict)
    minimum: float = -math.inf
    maximum: float = math.inf
    relative: bool = False

    @property
    def is_real(self) -> bool:
        """Whether it is a real number."""
        return self.type in REAL


@dataclass(frozen=True)
class Description:
    """Data of a modelDescription.xml that the master needs.

    Attributes
    ----------
    fmi : int
        Version of FMI: 2 or 3.
    exchanges : bool
        Whether it is for model exchange only, and needs our solver.
    states, indicators : int
        Numbers of continuous states and event indicators, from FMI 2.0.
    units : dict of str to dict of str to str
        For each unit that is defined in base units, the attributes of its BaseUnit
        as written: exponents, factor, offset.
    message_reference : int, optional
        Value reference of the String ``message``, the reason of a failed step in our FMUs; in
        earlier versions an output.
    step_size : float, optional
        Of its default experiment [s].
    steps_vary : bool
        Whether its communication steps may vary in length.
    strings : dict of str to int
        Value references of the parameters that are Strings.
    aliases : dict of str to str
        Names of variables by their other names.
    """

    fmi: int
    exchanges: bool
    states: int
    indicators: int
    guid: str
    identifier: str
    variables: tuple[NumberVariable, ...]
    units: dict[str, dict[str, str]]
    message_reference: int | None
    saves_state: bool
    once_per_process: bool
    step_size: float | None = None
    steps_vary: bool = True
    strings: dict[str, int] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)

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
        defined = unit in self.units
        found = Unit.defined(unit, self.units[unit]) if defined else _undefined(unit)
        return replace(found, relative=variable.relative)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        told = {f.name: getattr(self, f.name) for f in fields(self)}
        return told | {"variables": [vars(v) for v in self.variables]}

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


def unpack(path: Path | str, *, runs_here: bool = True) -> UnpackedFmu:
    """Check and unpack an FMU of FMI 2.0 or 3.0, for co-simulation or model exchange.

    Parameters
    ----------
    path : path-like
    runs_here : bool
        Whether it must have a binary for this platform, or sources that compile to one.

    Raises
    ------
    FmuError
        If the file is missing, is no FMU, contains a path outside its folder, or cannot run here.
    """
    path = Path(path)
    try:
        folder = unpack_archive(path)
    except BadArchive as error:
        raise FmuError(f"{path}: {error}") from error
    try:
        description, read = _read(path, folder)
        if runs_here:
            _find_binary(path, folder, description, read.buildConfigurations)
        return UnpackedFmu(path, description, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _read(path: Path, folder: Path) -> tuple[Description, Any]:
    from fmpy import read_model_description

    if not (folder / "modelDescription.xml").is_file():
        raise FmuError(f"{path}: contains no modelDescription.xml, so it is not an FMU")
    try:
        root = check_file(folder / "modelDescription.xml")
        version = root.get("fmiVersion", "of no version")
        if not re.fullmatch(r"2\.0|3\.\d+", version):
            raise FmuError(f"{path}: is FMI {version}, expected FMI 2.0 or 3.0")
        if (build := folder / "sources" / "buildDescription.xml").is_file():
            check_file(build)
        read = read_model_description(str(folder), validate=False)
        with (folder / "modelDescription.xml").open("rb") as stream:
            description = _described(path, read, attributes_of(stream))
    except FmuError:
        raise
    except BadXml as error:
        raise FmuError(f"{path}: {error}") from error
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        raise FmuError(f"{path}: modelDescription.xml is incomplete ({error})") from error
    except Exception as error:  # the parser raises many kinds
        reason = str(error) or type(error).__name__
        raise FmuError(f"{path}: modelDescription.xml cannot be read: {reason}") from error
    if not re.fullmatch(r"[A-Za-z_]\w*", description.identifier):
        raise FmuError(
            f"{path}: modelIdentifier is {description.identifier!r}, expected a name in C"
        )
    return description, read


def _find_binary(
    path: Path, folder: Path, description: Description, configurations: list[Any]
) -> None:
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
            raise FmuError(
                f"{path}: has sources but no binary for this platform, and {error}"
            ) from error
    else:
        there = sorted(p.name for p in (folder / "binaries").glob("*") if p.is_dir())
        raise FmuError(
            f"{path}: has no binary for this platform, expected {binary}; it has binaries for "
            f"{', '.join(there) or 'none'}"
        )


def _described(path: Path, read: Any, told: Mapping[str, Mapping[str, str]]) -> Description:
    kind = read.coSimulation or read.modelExchange
    if kind is None:
        what = "scheduled execution only" if read.scheduledExecution else "neither"
        raise FmuError(f"{path}: is for {what}, expected co-simulation or model exchange")
    # outputs may also depend on states: this is not direct feedthrough
    followers = {
        u.variable.name
        for u in read.outputs or ()
        if any(d.causality == "input" for d in u.dependencies or ())
    }
    silent = {u.variable.name for u in read.outputs or () if u.dependencies is None}
    listed = {u.variable.name for u in read.outputs or ()}
    initially = {
        u.variable.name: tuple(d.name for d in u.dependencies if d.causality == "input")
        for u in read.initialUnknowns or ()
        if u.dependencies is not None
    }
    variables = []
    message, strings, aliases = None, {}, {}
    check_lines(v.name for v in read.modelVariables)
    for name, count in Counter(v.name for v in read.modelVariables).most_common(1):
        if count > 1:
            raise FmuError(f"{path}: modelDescription.xml has two variables called {name!r}")
    for v in read.modelVariables:
        if v.type == "String" and v.name == "message" and v.causality in ("local", "output"):
            message = int(v.valueReference)
        if v.type == "String" and v.causality == "parameter" and not v.dimensions:
            strings[str(v.name)] = int(v.valueReference)
        is_signal = v.causality in ("input", "output")
        if v.type == "Clock" or (v.dimensions and is_signal):
            what = "a clock" if v.type == "Clock" else f"an array and an {v.causality}"
            raise FmuError(f"{path}: {v.name} is {what}, expected scalar signals without clocks")
        if v.type not in (*REAL, *WHOLE) or v.dimensions:
            continue
        if v.alias is not None:
            aliases[str(v.name)] = str(v.alias.name)
            continue
        low, high = (_bound(v, told, key) for key in ("min", "max"))
        if low > high:
            raise FmuError(f"{path}: {v.name} has the min {low:g} above its max {high:g}")
        nominal = abs(float(v.nominal)) if v.nominal else 1.0
        variables.append(
            NumberVariable(
                v.name,
                v.type,
                int(v.valueReference),
                str(v.causality),
                unit_name(v),
                nominal if math.isfinite(nominal) and nominal > 0 else 1.0,
                _start(v),
                v.name in followers or v.name in silent or v.name not in listed,
                v.type in REAL and v.variability == "discrete",
                () if v.initial == "exact" else initially.get(v.name),
                _items(v),
                low,
                high,
                is_relative(v, told),
            )
        )
    units = defined_units(read)
    for name, base in units.items():
        Unit.defined(name, base)  # rejects an invalid unit
    return Description(
        int(read.fmiVersion[0]),
        read.coSimulation is None,
        int(read.numberOfContinuousStates),
        int(read.numberOfEventIndicators),
        str(read.guid),
        str(kind.modelIdentifier),
        tuple(variables),
        units,
        message,
        bool(kind.canGetAndSetFMUstate),
        bool(kind.canBeInstantiatedOnlyOncePerProcess),
        _step_size(read.defaultExperiment),
        read.coSimulation is None or bool(kind.canHandleVariableCommunicationStepSize),
        strings,
        aliases,
    )


def attributes_of(stream: IO[bytes]) -> dict[str, Mapping[str, str]]:
    """Attributes of each variable of a modelDescription.xml; fmpy leaves out some of them."""
    variables = ET.parse(stream).getroot().find("ModelVariables")
    return {
        v.get("name", ""): next((c for c in v if c.tag in (*REAL, *WHOLE)), v).attrib
        for v in (variables if variables is not None else ())
    }


def _told(variable: Any, told: Mapping[str, Mapping[str, str]], key: str) -> Any:
    """An attribute of a variable, or of its declared type; None if there is none."""
    name = (variable.alias or variable).name
    return told[name].get(key, getattr(variable.declaredType, key, None))


def is_relative(variable: Any, told: Mapping[str, Mapping[str, str]]) -> bool:
    """Whether a variable read by fmpy is a difference; `told` has the attributes of all."""
    return _told(variable, told, "relativeQuantity") in ("true", "1", True)


def _bound(variable: Any, told: Mapping[str, Mapping[str, str]], key: str) -> float:
    text = _told(variable, told, key) if variable.causality in SETTABLE else None
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
    if variable.type == "Boolean" and variable.start is not None:
        return float(variable.start in ("true", "1"))
    if variable.start is None:
        return None
    if variable.causality not in SETTABLE:
        return float(variable.start)
    return number(variable.start, f"the start value of {variable.name!r}")


def _step_size(experiment: Any) -> float | None:
    text = experiment.stepSize if experiment is not None else None
    size = float(text) if text else 0.0
    return size if math.isfinite(size) and size > 0 else None


def unit_name(variable: Any) -> str:
    """The unit of a variable read by fmpy, or of its declared type; empty if none."""
    declared = variable.declaredType
    return str(variable.unit or (declared.unit if declared is not None else None) or "")


def _undefined(name: str) -> Unit:
    """A unit that the FMU does not define in base units, by its name, also in Modelica spelling."""
    powers = re.sub(r"(?<=[A-Za-z])(-?\d)", r"^\1", name).replace(".", "*")
    try:
        exponents = base_exponents(powers)
    except BadUnit:
        return Unit(name, None)
    return Unit(name, tuple(exponents.get(base, 0) for base in BASE_UNITS))


def defined_units(read: Any) -> dict[str, dict[str, str]]:
    """`Description.units` of a model description read by fmpy."""
    return {
        unit.name: {
            key: str(value)
            for key in (*BASE_UNITS, "factor", "offset")
            if (value := getattr(unit.baseUnit, key)) is not None
        }
        for unit in read.unitDefinitions or ()
        if unit.baseUnit is not None
    }

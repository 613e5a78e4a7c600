"""A plant or a controller: its ports, parameters and capabilities."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ...controllers import ALONE, CONTROLLERS
from ...fmus.interface import START
from ...fmus.reading import SETTABLE, Description, NumberVariable, read_description
from ...fmus.system_export import SAMPLE_TIME
from ...plant import PLANTS
from ...plant.instruments import FEED_FORWARD, INSTRUMENTS, SAMPLED, PartName
from ...solver import component_file
from ...solver.errors import BadParameter, ContractError, did_you_mean, nearest
from ...solver.files import readable
from ...solver.kernel import Kernel
from ...solver.signals import Parameter
from ..fmu.limits import as_number
from . import catalogue

if TYPE_CHECKING:
    from ...solver.component import Component

Value: TypeAlias = float | str
SUFFIX = ".fmu"
_ANY = -math.inf, math.inf


@dataclass(frozen=True)
class Part:
    """One side of a loop: equations, from which an FMU can be made, or an FMU of any origin.

    Parts with the same name are equal. Data of a Python file are those at the time when it was
    resolved, also in other processes.
    """

    name: str  # of the catalogue, a file's function (``mine.py:pi``), or the path of an FMU

    def __str__(self) -> str:
        return self.name

    @property
    def named(self) -> PartName:
        """The pieces of its name."""
        return PartName.of(self.name)

    @property
    def bare(self) -> str:
        """Its name without feed-forward, sampling, instruments and units."""
        return self.named.bare

    @property
    def has_equations(self) -> bool:
        """Whether its equations are known; if not, it is a file of an FMU."""
        return self.bare in catalogue.NAMES | ALONE or component_file.names_file(self.bare)

    @property
    def is_none(self) -> bool:
        """Whether it is the controller ``none``, for a plant that runs alone."""
        return self.name in ALONE

    @property
    def own_name(self) -> str:
        """Its name on the command line."""
        return catalogue.name_of(self.name) if self.has_equations else Path(self.name).stem

    @property
    def label(self) -> str:
        """Its name in tables, pictures, options and parameter files."""
        return readable(self.own_name)

    def fmu(self) -> Path:
        """Its FMU; if it has equations, in the user's cache."""
        return catalogue.fmu(self.name) if self.has_equations else Path(self.name)

    @cached_property
    def kernel(self) -> Kernel:
        """Its compiled equations, with the ports of the feedback law."""
        return catalogue.fmu_kernel(self.name)

    @cached_property
    def partials(self) -> Kernel:
        """The partial derivatives of its equations, see `catalogue.partials_kernel`."""
        return catalogue.partials_kernel(self.name)

    @cached_property
    def description(self) -> Description:
        """The description of an FMU; raises `FmuError` if it is of no kind that can run here."""
        return read_description(self.name)  # its sources are compiled when it runs

    @property
    def inputs(self) -> tuple[str, ...]:
        if self.has_equations:
            return tuple(i.name for i in self.kernel.inputs if i.role != "internal")
        return tuple(self.description.names("input"))

    @property
    def outputs(self) -> tuple[str, ...]:
        if self.has_equations:
            return tuple(o.name for o in self.kernel.outputs)
        return tuple(self.description.names("output"))

    def unit_of(self, port: str) -> str:
        """Unit of an output or an input; empty if it has none."""
        ports: Any = (*self.kernel.outputs, *self.kernel.inputs) if self.has_equations else ()
        return next((p.unit for p in ports or self.description.variables if p.name == port), "")

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters and initial states (``x_start``); the default is NaN if an FMU gives none."""
        if self.has_equations:
            found = {p.name: p for p in self.kernel.parameters}
            for s in (*self.kernel.states, *self.kernel.discrete):
                about = s.start, s.unit, f"initial {s.meaning}", "start value"
                found[s.name + START] = Parameter(s.name + START, *about, *_ANY)
            return found
        file, found = Path(self.name).name, {}
        for v in (v for v in self.description.variables if v.causality == "parameter"):
            start = math.nan if v.start is None else v.start
            said = v.unit, f"parameter of {file}", f"start value of {file}", v.minimum, v.maximum
            found[v.name] = Parameter(v.name, start, *said)
        return found

    def settable(self, values: Mapping[str, float]) -> dict[str, Parameter]:
        """Its parameters, and its inputs that are given a value."""
        given = (name for name in self.inputs if name in values)
        inputs = {name: Parameter(name, math.nan, "", "input", "", *_ANY) for name in given}
        return {**self.parameters, **inputs}

    def check_values(self, side: str, values: Mapping[str, float]) -> None:
        """Raise `BadParameter` unless it has these parameters, in their range."""
        if not self.has_equations:  # free inputs are only known after the wiring
            taken(side, self.description, values)
            return
        known = self.settable(values)
        check_names(side, values, known)
        for name, value in values.items():
            check_range(side, name, value, known[name])

    def __getstate__(self) -> dict[str, Any]:
        # another process may lack the file of a component, or find it edited
        base = self.bare
        made = component_file.load_component(base) if component_file.names_file(base) else None
        return {"name": self.name, "made": made}

    def __setstate__(self, state: dict[str, Any]) -> None:
        object.__setattr__(self, "name", state["name"])
        if state["made"] is not None:
            component_file.remember_component(self.bare, state["made"])


PartLike: TypeAlias = "str | Path | Component | Part"
_KNOWN = {"controller": CONTROLLERS | ALONE, "plant": PLANTS}


def resolve(
    role: str, given: PartLike, known: Collection[str] | None = None, fmus: bool = True
) -> Part:
    """The part with this name, one of `known`, or a file; `role` begins the message of an error."""
    known = _KNOWN.get(role, ()) if known is None else known
    if isinstance(given, Part):
        return given
    if not isinstance(given, str | Path):
        from ...solver.component import Component

        if not isinstance(given, Component):
            raise BadParameter(f"{role} is {given!r}, expected a name, a path or a Component")
        return Part(component_file.name_in_memory(given))
    name = str(given)
    base = PartName.of(name).bare
    if component_file.names_file(base):
        try:
            component_file.read_component(base)
        except ContractError as error:
            raise ContractError(f"{role}: {error}") from error
        return Part(name)
    if base in known or (fmus and (Path(name).suffix == SUFFIX or os.path.exists(name))):
        return Part(name)
    first, *rest = name.split("+")
    if rest and first in known:
        wrong = next((part for part in rest if part not in INSTRUMENTS), "")
        said = f"no instrument {wrong!r}; there are {', '.join(INSTRUMENTS)}, and before them "
        raise BadParameter(f"{role} {name!r}: {said}{FEED_FORWARD}, then {SAMPLED}, once")
    files = "FILE.py:FUNCTION nor the path of an FMU" if fmus else "FILE.py:FUNCTION"
    hint = did_you_mean(name, known)
    raise BadParameter(f"{role} {name!r} is neither one of {', '.join(known)} nor {files}{hint}")


def check_names(side: str, names: Collection[str], known: Collection[str]) -> None:
    """Make sure that every value has a variable; raises `BadParameter`, naming the nearest."""
    for name in names:
        if name not in known:
            hint = nearest(name, known) or f"; it has {', '.join(known)}"
            raise BadParameter(f"{side} has no parameter {name!r}{hint}")


def settable_of(described: Description) -> list[str]:
    """Names of an FMU's parameters and inputs."""
    numbers = (v.name for v in described.variables if v.causality in SETTABLE)
    return [*numbers, *described.strings, *described.aliases]


def taken(side: str, described: Description, given: Mapping[str, Value]) -> dict[str, Value]:
    """As `as_taken`, for parameters and inputs only."""
    check_names(side, given, settable_of(described))
    return as_taken(side, described, given)


def as_taken(side: str, described: Description, given: Mapping[str, Value]) -> dict[str, Value]:
    """Values as an FMU's variables take them: numbers in their range, text for Strings."""
    names = {described.aliases.get(name, name): value for name, value in given.items()}
    return {name: _as_taken(side, described, name, value) for name, value in names.items()}


def _as_taken(side: str, described: Description, name: str, value: Value) -> Value:
    if name in described.strings:
        if not isinstance(value, str):
            raise BadParameter(f"{side}.{name} is {value!r}, expected text: it is a String")
        return value
    variable = described.by_name[name]
    items = variable.items
    try:
        number = float(items[value]) if value in items else as_number(f"{side}.{name}", value)
    except BadParameter as error:
        one_of = f", or one of {', '.join(items)}{nearest(str(value), items)}" if items else ""
        raise BadParameter(f"{error}{one_of}") from None
    if items and number not in items.values():
        allowed = ", ".join(f"{n} ({v})" for n, v in items.items())
        raise BadParameter(f"{side}.{name} is {number:g}, expected one of {allowed}")
    check_range(side, name, number, variable)
    return number


def check_range(side: str, name: str, value: float, known: Parameter | NumberVariable) -> None:
    """Raise `BadParameter` if a value is out of its range."""
    low, high = known.minimum, known.maximum
    if not low <= value <= high:
        shown = f"{value:g}" if known.unit in ("", "1") else f"{value:g} {known.unit}"
        raise BadParameter(
            f"{side}: parameter {name} = {shown} is out of its range [{low:g}, {high:g}]"
        )


def in_practice(
    controller: Part, sampled: float | None, noise: bool
) -> tuple[Part, dict[str, float], tuple[str, ...]]:
    """A controller with sampling at a period [s] and with all instruments that fit.

    Returns the part, its sampling period by the parameter's name, and notes. An FMU is not changed:
    the run steps it at its samples, see `Loop.sampled`. Raises `ContractError` for an FMU with
    `noise` or a controller for which this is not possible, `UnknownName`.
    """
    if not controller.has_equations and noise:
        said = "is an FMU without equations; it cannot get instruments here"
        raise ContractError(f"{controller} {said}; expected a name or FILE.py:FUNCTION")
    if (sampled is None and not noise) or not controller.has_equations:
        return controller, {}, ()
    named = controller.named
    base = str(replace(named, instruments=(), units=()))
    if noise and named.instruments:
        raise ContractError(f"{controller} already has instruments; expected {base} alone")
    law = catalogue.component(base)
    instruments, ideal = named.instruments, tuple[str, ...]()
    if noise:
        from ...plant.instruments.measured_through import instruments_for

        instruments, ideal = instruments_for(law, map(catalogue.component, INSTRUMENTS))
    own = law.sample_time
    period = {} if sampled is None else {own.name if own else SAMPLE_TIME: sampled}
    is_sampled = named.sampled or (sampled is not None and not own)
    notes = (f"no instrument measures {', '.join(ideal)}: the true value is used",) * bool(ideal)
    return Part(str(replace(named, sampled=is_sampled, instruments=instruments))), period, notes

"""A closed loop to run: two parts and a set-point, or the elements of an .ssp; resolved once.

`run`, `swap`, `lyapunov`, maps and the checks of studies are all done with a `Loop`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar, cast

from ...controllers import CONTROLLERS, in_units_of
from ...fmus.interface import SOLVER_TOLERANCE, START
from ...plant import DESCRIBED
from ...plant.instruments import PartName
from ...solver.errors import BadParameter
from ...solver.files import readable
from ...solver.kernel import CONTROLLER, PLANT
from ...solver.signals import START_VALUE
from ..fmu import limits
from ..master.couplings import WITHOUT_FMUS, Coupling
from ..master.reference_signal import Reference
from .parameter_file import FMU, Known, ParameterFile, Value, check_values
from .parameter_file import Values as FileValues
from .parts import Part, PartLike, in_practice, resolve
from .reference_motions import ReferenceLike, as_reference

STOP = 20.0  # [s]

Values: TypeAlias = "Mapping[str, float]"
SystemValues: TypeAlias = "Mapping[str, float | str]"
Ports: TypeAlias = "Mapping[str, str]"
Given = TypeVar("Given")
Found = TypeVar("Found")


class Resolved(Generic[Given, Found]):
    """A field of a dataclass that takes what is given, and holds what it is resolved to."""

    def __init__(self, resolve: Callable[[str, Given], Found], *default: Given) -> None:
        self._resolve, self._default = resolve, default  # by the field's name, for messages

    def __set_name__(self, _: type, name: str) -> None:
        self._name = name

    def __get__(self, owner: object, _: type) -> Found:
        if owner is None and not self._default:
            raise AttributeError(self._name)  # so it has no default
        return cast("Found", self._default[0] if owner is None else vars(owner)[self._name])

    def __set__(self, owner: object, given: Given) -> None:
        vars(owner)[self._name] = self._resolve(self._name, given)


def _optional(resolve: Callable[[str, Any], Found]) -> Callable[[str, Any], Found | None]:
    return lambda what, given: None if given is None else resolve(what, given)


def _numbers(what: str, given: SystemValues | None, texts: bool = False) -> dict[str, Any]:
    """Values by name as numbers; some may be `texts`."""
    if not isinstance(given or {}, Mapping):
        raise BadParameter(f"{what} is {given!r}, expected a mapping of names to numbers")
    return {
        n: v if texts and isinstance(v, str) else limits.as_number(f"{what}[{n!r}]", v)
        for n, v in (given or {}).items()
    }


_numbers_or_texts = partial(_numbers, texts=True)


def _set_point(_: str, given: ReferenceLike) -> Reference:
    return as_reference(given)


@dataclass(frozen=True, kw_only=True)
class HowCoupled:
    """How the FMUs of a loop are coupled; see `Loop`."""

    step: float | None = None
    coupling: Resolved[str | Coupling | None, Coupling | None] = Resolved(
        _optional(lambda _, given: Coupling(given)), None
    )
    corrections: Resolved[int | None, int | None] = Resolved(limits.check_corrections, None)
    isolate: bool | None = None
    time_limit: Resolved[float, float] = Resolved(limits.check_length, limits.TIME_LIMIT)
    fmus: bool = True

    def _set(self, **resolved: Any) -> None:
        for name, value in resolved.items():
            object.__setattr__(self, name, value)

    def _check_step(self, stop: float | None) -> None:
        """Check the step of a motion of this length [s]; None: not known yet."""
        if self.step is not None:
            self._set(step=limits.check_step("step", self.step, stop))


@dataclass(frozen=True)
class Loop(HowCoupled):
    """A plant and its controller around a set-point, and how they are coupled.

    The attributes have the names of the parameters; `controller` and `plant` are of the class
    `Part`, `reference` is a `Reference`.

    Parameters
    ----------
    controller, plant : str, path-like, Component or Part
        A name of the catalogue, a file's function (``mine.py:pi``), the path of an FMU, or a
        component. The controller ``none`` is for a plant without inputs.
    reference : float, str, path-like or Reference
        Set-point [m], or set-point over time: a motion such as
        ``"move:distance=0.02,speed=0.1"``, the path of a table, or a `Reference`.
    stop : float
        Length of the motion [s].
    plant_values, controller_values : mapping of str to float, optional
        Parameters and initial states with other than nominal values, in SI units.
    mapping : mapping of str to str, optional
        Names of a third-party FMU's ports, ``theirs -> ours``.
    file : ParameterFile, optional
        Source of values; the written parameter file keeps their intervals and sources.
    notes : tuple of str
        Notes from before the run, added to those of the run.
    sampled : float, optional
        Sampling period of the controller [s]: it reads at its samples and holds its commands. A
        controller with equations becomes ``pid+sampled``; an FMU is stepped only at its samples.
    step : float, optional
        Communication step [s]; default: halved until the run is trusted.
    coupling : str or Coupling, optional
        Default: the interface-Jacobian coupling if the parts have its ports, else the
        best supported one.
    corrections : int, optional
        Corrections of each step by rollback, 0 or 1.
    isolate : bool, optional
        Whether each FMU runs in its own process. Default: FMUs not written by this program.
    time_limit : float
        Time limit of one call of an FMU in its own process [s].
    fmus : bool
        Whether FMUs are run; if not, both parts are one system of equations in one solver.

    Raises
    ------
    BadParameter, ContractError
        If a part, a number or the set-point is invalid; the message says why.

    Examples
    --------
    >>> from ballscrew import Loop
    >>> loop = Loop("iol", reference=0.02, controller_values={"sigma0_hat": 6.5e4})
    >>> loop.label, loop.controller.outputs[0]
    ('iol', 'u')
    """

    controller: Resolved[PartLike, Part] = Resolved(resolve)
    plant: Resolved[PartLike, Part] = Resolved(resolve, "plant")
    reference: Resolved[ReferenceLike, Reference] = Resolved(_set_point, START_VALUE)
    stop: Resolved[float, float] = Resolved(limits.check_length, STOP)
    plant_values: Resolved[Values | None, Values] = Resolved(_numbers, None)
    controller_values: Resolved[Values | None, Values] = Resolved(_numbers, None)
    mapping: Resolved[Ports | None, Ports] = Resolved(lambda _, given: dict(given or {}), None)
    file: ParameterFile | None = None
    notes: tuple[str, ...] = ()
    sampled: Resolved[float | None, float | None] = Resolved(_optional(limits.check_length), None)

    def __post_init__(self) -> None:
        own, plant = self.controller, self.plant
        if self.reference.measure:
            theirs = {ours: n for n, ours in self.mapping.items()}.get("x", "x")
            self.reference.check_measure(plant.unit_of(theirs.removeprefix("plant.")))
        still = (n for n in self.reference.notes(self.stop) if n not in self.notes)
        self._set(controller=Part(in_units_of(own.name, plant.name)), notes=(*self.notes, *still))
        self._check_step(self.stop)
        if self.sampled is not None:
            self._set_sampled(self.sampled)

    def _set_sampled(self, period: float) -> None:
        if period > self.stop:
            raise BadParameter(f"sampled is {period:g} s, expected at most stop, {self.stop:g} s")
        if self.controller.is_none:
            raise BadParameter("sampled is for a loop with a controller, and there is none")
        if self.controller.has_equations:
            part, own, notes = in_practice(self.controller, period, noise=False)
            values = {**self.controller_values, **own}
            notes = *self.notes, *notes
            self._set(controller=part, controller_values=values, notes=notes, sampled=None)

    @property
    def label(self) -> str:
        """Its name: that of its controller, or of the plant that runs alone."""
        return (self.plant if self.controller.is_none else self.controller).label

    @property
    def title(self) -> str:
        """Both parts by name."""
        alone = self.controller.is_none
        return self.label if alone else f"{self.label} on {self.plant.label}"

    @property
    def values(self) -> dict[str, float]:
        """The values of both parts, by their names in the whole loop in one solver."""
        values = {PLANT + name: value for name, value in self.plant_values.items()}
        return values | {CONTROLLER + n: value for n, value in self.controller_values.items()}

    @property
    def set_point(self) -> float:
        """The constant set-point [m]; raises `BadParameter` if it is not constant."""
        if len(self.reference.values) > 1:
            raise BadParameter("the set-point is not constant; expected a constant one")
        return float(self.reference.values[0])

    def check_values(self) -> None:
        """Raise `BadParameter` or `FmuError` if a part does not have a parameter, or its range."""
        self.plant.check_values("plant", self.plant_values)
        self.controller.check_values("controller", self.controller_values)

    def with_values(self, values: SystemValues) -> Loop:
        """The loop with other values of both parts, by the names in `values`."""
        plant, own = (of_side(side, values) for side in (PLANT, CONTROLLER))
        return replace(self, plant_values=plant, controller_values=own)

    def parameters(self) -> ParameterFile:
        """All parameters used, as a file that the next command can read; see `list_used`."""
        file, plant, controller = self.file or ParameterFile(), self.plant, self.controller
        known = plant.settable(self.plant_values)
        found = list_used(known, self.plant_values, {**file.plant, **file.found})
        theirs = file.controllers.get(table_of(file, controller), {})
        settable = controller.settable(self.controller_values)
        of_controller = list_used(settable, self.controller_values, theirs)
        (kind, law), command, own = (FMU, ""), file.command, {*known}
        if plant.named.plain in DESCRIBED:
            (kind, law), command = DESCRIBED[plant.named.plain], "+".join(plant.named.units)
        elif self.file is not None and set(file.plant) <= own:
            kind, law, own = file.kind, file.law, {*file.plant}
            own |= set() if kind == FMU else {*Part(file.plant_name).parameters}
        of_plant = {n: found.pop(n) for n in [*found] if n in own}
        controllers = {**file.controllers, controller.label: of_controller}
        made = ParameterFile(None, kind, law, of_plant, found, controllers, file.rig)
        return replace(made, command=command, turns=file.turns)


@dataclass(frozen=True)
class SystemLoop(HowCoupled):
    """The closed loop that an .ssp describes.

    Parameters
    ----------
    system : path-like
        An .ssp file.
    reference : float, str, path-like or Reference, optional
        For the system's set-point. Default: its start value, held.
    stop : float, optional
        [s] Default: the file's own, else 20 s.
    values : mapping of str to float
        Parameters and start values as ``element.variable``; they replace those of the file. Text is
        a String, the name of an Enumeration's item, or a number.
    step, coupling, corrections, isolate, time_limit
        As in `Loop`. With ``jacobi`` and ``gauss-seidel`` connected feedback-law ports
        are ordinary signals, as in other masters.
    """

    system: Path | str
    reference: Resolved[ReferenceLike | None, Reference | None] = Resolved(
        _optional(_set_point), None
    )
    stop: Resolved[float | None, float | None] = Resolved(_optional(limits.check_length), None)
    values: Resolved[SystemValues | None, SystemValues] = Resolved(_numbers_or_texts, None)

    def __post_init__(self) -> None:
        self._check_step(self.stop)
        if not self.fmus:
            asked = f"fmus=False (--coupling {WITHOUT_FMUS})"
            raise BadParameter(f"{asked} needs equations; an .ssp does not give them")

    @property
    def label(self) -> str:
        """Its name in tables and pictures."""
        return readable(Path(self.system).stem)

    def with_values(self, values: SystemValues) -> SystemLoop:
        """The loop with other values of its elements."""
        return replace(self, values=values)


def of_side(side: str, named: Mapping[str, Any]) -> dict[str, Any]:
    """Those of a loop's values or parameters that belong to one part, by its own names."""
    return {n.removeprefix(side): v for n, v in named.items() if n.startswith(side)}


def table_of(file: ParameterFile, controller: Part) -> str:
    """A controller's table in a file: its own, else that of the controller without instruments."""
    own = controller.label
    return own if own in file.controllers else Part(controller.bare).label


def list_used(
    known: Known, values: Mapping[str, float], file: FileValues, source: str = "given to this run"
) -> dict[str, Value]:
    """All parameters of a part; a value that a file has keeps its interval and source."""
    found = {}
    for name, p in known.items():
        if name in values:
            said = file.get(name, Value(math.nan))
            said = said if said.value == values[name] else Value(values[name], source=source)
            found[name] = replace(said, unit=p.unit)
        elif not name.endswith(START) and name != SOLVER_TOLERANCE and math.isfinite(p.default):
            found[name] = Value(p.default, p.unit, None, p.source)
    return found


def file_values(
    file: ParameterFile | None,
    plant: str | None,
    controllers: Sequence[str],
    given: Collection[str] = (),
) -> tuple[str, dict[str, float], dict[str, dict[str, float]], list[str]]:
    """The plant of a file or the requested one, values for it and each controller, and notes."""
    plant = plant_of(file, plant)
    if file is None:
        return plant, {}, {name: {} for name in controllers}, []
    values = for_plant(file, plant, given)
    values_of = {n: for_controller(file, in_units_of(n, plant)) for n in controllers}
    parts = [Part(c) for c in controllers]
    known = {*CONTROLLERS, *(p.label for p in parts), *(table_of(file, p) for p in parts)}
    unused = "no controller of this name runs here; left aside"
    notes = [f"{file.path}: [controller.{n}]: {unused}" for n in file.controllers if n not in known]
    return plant, values, values_of, [*aside(file, values, plant), *notes]


def plant_of(file: ParameterFile | None, plant: str | None) -> str:
    """The requested plant, else the one that the file describes, else the nominal one."""
    return plant or (file.plant_name if file else "plant")


def with_file(loop: Loop, file: ParameterFile, chosen: bool) -> Loop:
    """The loop with the values of a file where it has none; its plant stays if it was `chosen`."""
    own, name = loop.plant_values, loop.controller.name
    asked = loop.plant.name if chosen else None
    plant, values, values_of, notes = file_values(file, asked, [name], own)
    of_controller = {**values_of[name], **loop.controller_values}
    loop = replace(loop, controller_values=of_controller, notes=(*loop.notes, *notes))
    return replace(loop, plant=Part(plant), plant_values={**values, **own}, file=file)


def for_plant(file: ParameterFile, plant: str, given: Collection[str] = ()) -> dict[str, float]:
    """The file's values for a plant; with `given` there is no gap, see `check_complete`."""
    known = Part(plant).parameters
    if file.kind == FMU:
        return file.plant_values(known)
    own = Part(file.plant_name).parameters
    # a file of another law has values that this plant does not use
    values = file.plant_values(known, own if file.law and file.plant_name != plant else ())
    needed = known if PartName.of(plant).plain in DESCRIBED else known.keys() & own.keys()
    file.check_complete({n: known[n] for n in needed}, {*values, *given})
    return values


def for_controller(file: ParameterFile, name: str) -> dict[str, float]:
    """The file's values for a controller."""
    part = Part(name)
    table = table_of(file, part)
    where = f"{file.path}: [controller.{table}]"
    return check_values(file.controllers.get(table, {}), part.parameters, where)


def aside(file: ParameterFile, values: Collection[str], plant: str) -> list[str]:
    """A note on the file's values that a plant does not use, if there are any."""
    names = [n for n in (*file.plant, *file.found) if n not in values]
    said = f"{file.path}: {', '.join(names)}: {plant} has no such parameter; left aside"
    return [said] if names else []

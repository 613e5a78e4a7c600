"""A closed loop to run: two parts and a set-point, or the elements of an .ssp; resolved once.

`run`, `swap`, `lyapunov`, maps and the checks of studies are all done with a `Loop`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, Unpack

from ...controllers import CONTROLLERS
from ...fmus.interface import START, TOLERANCE
from ...plant import DESCRIBED
from ...plant.instruments import PartName
from ...solver.errors import BadParameter
from ...solver.kernel import CONTROLLER, PLANT
from ...solver.signals import START_VALUE
from ..fmu import limits
from ..master.couplings import WITHOUT_FMUS, Coupling
from ..master.reference_signal import Reference
from .catalogue import in_units_of
from .parameter_file import FMU, Known, ParameterFile, Value, check_values
from .parameter_file import Values as FileValues
from .parts import Part, PartLike, in_practice, readable, resolve_controller, resolve_plant
from .reference_motions import read_set_point

STOP = 20.0  # [s]

ReferenceLike: TypeAlias = "float | str | Path | Reference"
Values: TypeAlias = "Mapping[str, float]"
SystemValues: TypeAlias = "Mapping[str, float | str]"


class _How(TypedDict, total=False):
    """The arguments of `HowCoupled`, before they are resolved."""

    step: float | None
    coupling: str | Coupling | None
    corrections: int | None
    isolate: bool | None
    time_limit: float
    fmus: bool


@dataclass(frozen=True, kw_only=True)
class HowCoupled:
    """How the FMUs of a loop are coupled; see `Loop`."""

    step: float | None = None
    coupling: Coupling | None = None
    corrections: int | None = None
    isolate: bool | None = None
    time_limit: float = limits.TIME_LIMIT
    fmus: bool = True

    def _set(self, **resolved: Any) -> None:
        for name, value in resolved.items():
            object.__setattr__(self, name, value)

    def _set_coupling(self, stop: float | None, how: Mapping[str, Any]) -> None:
        """Check how it is coupled over a motion of this length [s]; None: not known yet."""
        self._set(**vars(HowCoupled(**how)))
        coupling: Any = self.coupling
        self._set(
            coupling=None if coupling is None else Coupling(coupling),
            corrections=limits.check_corrections("corrections", self.corrections),
            time_limit=limits.check_length("time_limit", self.time_limit),
        )
        if self.step is not None:
            self._set(step=limits.check_step("step", self.step, stop))


@dataclass(frozen=True, init=False)
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
    told : ParameterFile, optional
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

    controller: Part
    plant: Part
    reference: Reference
    stop: float
    plant_values: Values
    controller_values: Values
    mapping: Mapping[str, str]
    told: ParameterFile | None
    notes: tuple[str, ...]
    sampled: float | None

    def __init__(  # noqa: PLR0913
        self,
        controller: PartLike,
        plant: PartLike = "plant",
        reference: ReferenceLike = START_VALUE,
        stop: float = STOP,
        plant_values: Values | None = None,
        controller_values: Values | None = None,
        mapping: Mapping[str, str] | None = None,
        told: ParameterFile | None = None,
        notes: tuple[str, ...] = (),
        sampled: float | None = None,
        **how: Unpack[_How],
    ) -> None:
        moved, own = resolve_plant(plant), resolve_controller(controller)
        self._set(
            controller=Part(in_units_of(own.name, moved.name)),
            plant=moved,
            reference=as_reference(reference),
            stop=limits.check_length("stop", stop),
            plant_values=_numbers("plant_values", plant_values),
            controller_values=_numbers("controller_values", controller_values),
            mapping=dict(mapping or {}),
            told=told,
            sampled=sampled,
        )
        if self.reference.measure:
            theirs = {ours: n for n, ours in self.mapping.items()}.get("x", "x")
            self.reference.check_measure(moved.unit_of(theirs.removeprefix("plant.")))
        still = (n for n in self.reference.notes(self.stop) if n not in notes)
        self._set(notes=(*notes, *still))
        self._set_coupling(self.stop, how)
        if sampled is not None:
            self._set_sampled(limits.check_length("sampled", sampled))

    def _set_sampled(self, period: float) -> None:
        if period > self.stop:
            raise BadParameter(f"sampled is {period:g} s, expected at most stop, {self.stop:g} s")
        self._set(sampled=period)
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

    def with_kept(self, kept: Mapping[str, Values]) -> Loop:
        """The loop with the values that its FMUs, by their names, have in place of the given."""
        plant, own = ({**kept.get(n, {})} for n in ("plant", "controller"))
        return replace(
            self,
            plant_values={**self.plant_values, **plant},
            controller_values={**self.controller_values, **own},
        )

    def parameters(self) -> ParameterFile:
        """All parameters used, as a parameter file that the next command can read.

        Values that are unchanged from `told` keep their interval and source.
        """
        told, source = self.told or ParameterFile(), "given to this run"
        plant, controller = self.plant, self.controller
        known = plant.settable(self.plant_values)
        found = list_used(known, self.plant_values, {**told.plant, **told.found}, source)
        of_controller = list_used(
            controller.settable(self.controller_values),
            self.controller_values,
            told.controllers.get(table_of(told, controller), {}),
            source,
        )
        (kind, law), command, own = (FMU, ""), told.command, set(known)
        if plant.named.plain in DESCRIBED:
            (kind, law), command = DESCRIBED[plant.named.plain], "+".join(plant.named.units)
        elif self.told is not None and set(told.plant) <= own:
            kind, law, own = told.kind, told.law, set(told.plant)
            if kind != FMU:
                own |= set(Part(told.plant_name).parameters)
        return ParameterFile(
            kind=kind,
            command=command,
            law=law,
            plant={n: v for n, v in found.items() if n in own},
            found={n: v for n, v in found.items() if n not in own},
            controllers={**told.controllers, controller.label: of_controller},
            rig=told.rig,
            turns=told.turns,
        )


@dataclass(frozen=True, init=False)
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
    reference: Reference | None
    stop: float | None
    values: SystemValues

    def __init__(
        self,
        system: Path | str,
        reference: ReferenceLike | None = None,
        stop: float | None = None,
        values: SystemValues | None = None,
        **how: Unpack[_How],
    ) -> None:
        texts = {n: v for n, v in (values or {}).items() if isinstance(v, str)}
        numbers = {n: v for n, v in (values or {}).items() if not isinstance(v, str)}
        self._set(
            system=system,
            reference=None if reference is None else as_reference(reference),
            stop=None if stop is None else limits.check_length("stop", stop),
            values=_numbers("values", numbers) | texts,
        )
        self._set_coupling(self.stop, how)
        if not self.fmus:
            asked = f"fmus=False (--coupling {WITHOUT_FMUS})"
            raise BadParameter(f"{asked} needs equations; an .ssp does not give them")

    @property
    def label(self) -> str:
        """Its name in tables and pictures."""
        return readable(Path(self.system).stem)

    def with_kept(self, kept: Mapping[str, Values]) -> SystemLoop:
        """The loop with the values that its FMUs, by their names, have in place of the given."""
        found = {f"{e}.{n}": v for e, values in kept.items() for n, v in values.items()}
        return replace(self, values={**self.values, **found})


def table_of(file: ParameterFile, controller: Part) -> str:
    """Name of a controller's table in a parameter file: its own, else that of the bare controller.

    So ``[controller.pid]`` is also used for ``pid+position_encoder`` if that has no table.
    """
    own = controller.label
    return own if own in file.controllers else Part(controller.bare).label


def as_reference(given: ReferenceLike) -> Reference:
    """A set-point over time; a number is a constant one, text a motion or a file."""
    if isinstance(given, Reference):
        return given
    if isinstance(given, str | Path):
        return read_set_point(str(given))
    return Reference.constant(limits.as_number("reference", given))


def _numbers(what: str, values: Values | None) -> dict[str, float]:
    if not isinstance(values or {}, Mapping):
        raise BadParameter(f"{what} is {values!r}, expected a mapping of names to numbers")
    return {n: limits.as_number(f"{what}[{n!r}]", v) for n, v in (values or {}).items()}


def list_used(
    known: Known, values: Mapping[str, float], told: FileValues, source: str
) -> dict[str, Value]:
    """All parameters of a part with the values that they had, as a parameter file lists them.

    Initial states and the solver's tolerance are listed only if they are among `values`. What a
    file has and is not changed keeps its interval and source; others have `source`.
    """
    found = {}
    for name, p in known.items():
        if name in values:
            said = told.get(name)
            if said is None or said.value != values[name]:
                said = Value(values[name], source=source)
            found[name] = replace(said, unit=p.unit)
        elif not name.endswith(START) and name != TOLERANCE and math.isfinite(p.default):
            found[name] = Value(p.default, p.unit, None, p.source)
    return found


def file_values(
    told: ParameterFile | None,
    plant: str | None,
    controllers: Sequence[str],
    given: Collection[str] = (),
) -> tuple[str, dict[str, float], dict[str, dict[str, float]], list[str]]:
    """The plant to run, the values of a file for it and each controller, and what is not used.

    The plant is the requested one, else that of the file; `given` are its values from elsewhere.
    """
    plant = plant_of(told, plant)
    if told is None:
        return plant, {}, {name: {} for name in controllers}, []
    values = for_plant(told, plant, given)
    values_of = {n: for_controller(told, in_units_of(n, plant)) for n in controllers}
    parts = [Part(c) for c in controllers]
    known = {*CONTROLLERS, *(p.label for p in parts), *(table_of(told, p) for p in parts)}
    unknown = [
        f"{told.path}: [controller.{name}]: no controller of this name runs here; left aside"
        for name in told.controllers
        if name not in known
    ]
    return plant, values, values_of, [*aside(told, values, plant), *unknown]


def plant_of(told: ParameterFile | None, plant: str | None) -> str:
    """The requested plant, else the one that the file describes, else the nominal one."""
    return plant or (told.plant_name if told else "plant")


def with_file(loop: Loop, told: ParameterFile, chosen: bool) -> Loop:
    """The loop with the values of a file where it has none; its plant stays if it was `chosen`."""
    own, name = loop.plant_values, loop.controller.name
    asked = loop.plant.name if chosen else None
    plant, values, values_of, notes = file_values(told, asked, [name], own)
    return replace(
        loop,
        plant=Part(plant),
        plant_values={**values, **own},
        controller_values={**values_of[name], **loop.controller_values},
        told=told,
        notes=(*loop.notes, *notes),
    )


def for_plant(told: ParameterFile, plant: str, given: Collection[str] = ()) -> dict[str, float]:
    """The file's values for a plant; with `given` there is no gap, see `check_complete`."""
    known = Part(plant).parameters
    if told.kind == FMU:
        return told.plant_values(known)
    own = Part(told.plant_name).parameters
    # a file of another law has values that this plant does not use
    values = told.plant_values(known, own if told.law and told.plant_name != plant else ())
    needed = known if PartName.of(plant).plain in DESCRIBED else known.keys() & own.keys()
    told.check_complete({n: known[n] for n in needed}, {*values, *given})
    return values


def for_controller(told: ParameterFile, name: str) -> dict[str, float]:
    """The file's values for a controller."""
    part = Part(name)
    table = table_of(told, part)
    where = f"{told.path}: [controller.{table}]"
    return check_values(told.controllers.get(table, {}), part.parameters, where)


def aside(told: ParameterFile, values: Collection[str], plant: str) -> list[str]:
    """A note on the file's values that a plant does not use, if there are any."""
    names = [n for n in (*told.plant, *told.found) if n not in values]
    said = f"{told.path}: {', '.join(names)}: {plant} has no such parameter; left aside"
    return [said] if names else []

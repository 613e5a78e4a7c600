"""The plant with what a diagnosis found in it, as a component like any other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import sympy as sp

from ..identification.fitted_law import LAWS
from ..instruments.amplifier import PARAMETERS as AMPLIFIER
from ..instruments.amplifier import with_amplifier
from ..orchestration.parameter_file import BALL_SCREW, DRIVE, ParameterFile, Value
from ..plant.ball_screw import bare_ball_screw
from ..plant.classical import with_sticking
from ..plant.direct_drive import bare_direct_drive, with_command_limit
from ..plant.law import law
from ..solver.component import Component, Parameter, symbol
from .causes import CAUSES
from .causes.presliding_hysteresis import bristled
from .drive_model import DriveModel, curve_of

NAME = "extended_plant"
PRIOR = "prior, adjusted to measured data"
FOUND = "found in measured data"

_Number = TypeVar("_Number")

_SLOWEST = sp.Float("1e-5")  # speed at which a sliding curve is taken instead of at rest [m/s]

# Forces come first, while the body is one and cannot stick; then what parts it; then, once it can
# stick, what lies between the command and the force.
_PARTING = ("compliance", "backlash")
_BEFORE_THE_FORCE = ("resistance_drift", "voltage_saturation", "input_delay")


class BadExtension(ValueError):
    """Causes that cannot be built into this plant; the message says which and why."""


@dataclass(frozen=True)
class WrittenPlant:
    """Where an extended plant was written.

    Attributes
    ----------
    fmu, parameters : Path
        ``extended_plant.fmu`` and ``parameters.toml``.
    """

    fmu: Path
    parameters: Path


def extended_plant(
    model: DriveModel, found: Sequence[tuple[str, Mapping[str, float]]]
) -> Component:
    """The plant of a model with the causes that were found in it.

    Parameters
    ----------
    model : DriveModel
    found : sequence of (cause, values)
        Names of `CAUSES` with their numbers, SI. Of a number that each record has for itself, such
        as ``friction_cos.1`` and ``friction_cos.2``, the last record's is taken.

    Returns
    -------
    Component
        Its parameters' defaults are the model's and the found values; their `source` says which.

    Raises
    ------
    BadExtension
        If a cause is unknown or not for this plant, or the plant has no parameter of a found name.
    OneBody
        If a spring or a gap is to go into a ball screw without a rotor.
    ContractError
        If a value is outside of its parameter's range.
    """
    names = [name for name, _ in found]
    unknown = [n for n in names if n not in CAUSES]
    if unknown:
        raise BadExtension(f"no cause {unknown[0]!r}; there are {', '.join(CAUSES)}")
    if "resistance_drift" in names and not model.has_motor:
        raise BadExtension(
            "resistance_drift: a drive has no resistance; its kind is not ball_screw"
        )
    own = {name: last_record(numbers) for name, numbers in found}
    values = {n: v for numbers in own.values() for n, v in numbers.items()}
    if "presliding_hysteresis" in names:
        model = bristled(model, values["sigma0"], values.pop("damping_ratio", 1.0))
        values["sigma1"] = model.values["sigma1"]
    make = bare_ball_screw if model.has_motor else bare_direct_drive
    plant = _with_defaults(make(law(model.law), NAME), model.values, PRIOR)
    v = symbol("v")
    curve = curve_of(model.law).xreplace({v: sp.Abs(v) + _SLOWEST})
    first = [n for n in names if n not in (*_PARTING, *_BEFORE_THE_FORCE)]
    for name in (*first, *(n for n in _PARTING if n in names)):
        plant = CAUSES[name].extend(plant, curve, own[name])
    if model.law == "classical":
        plant = _able_to_stick(plant)
    plant = with_amplifier(plant) if model.has_motor else with_command_limit(plant)
    for name in (n for n in _BEFORE_THE_FORCE if n in names):
        plant = CAUSES[name].extend(plant, curve, own[name])
    known = {p.name for p in plant.all_parameters}
    missing = [n for n in values if n not in known]
    if missing:
        raise BadExtension(
            f"the plant with {', '.join(names)} has no parameter {missing[0]!r}; it has "
            f"{', '.join(sorted(known))}"
        )
    return _with_defaults(plant, values, FOUND)


def write_extended_plant(
    component: Component, folder: Path | str, values: ParameterFile | None = None
) -> WrittenPlant:
    """Write an extended plant as an FMU and its values as a parameter file.

    Parameters
    ----------
    component : Component
        Made by `extended_plant`.
    folder : path-like
        Made if it is not there; each file is replaced as a whole or not at all.
    values : ParameterFile, optional
        With intervals and sources. Default: that of `parameter_file`.

    Returns
    -------
    WrittenPlant

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    from ..fmus.export import export

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    fmu = export(component, folder / f"{NAME}.fmu")
    return WrittenPlant(fmu, (values or parameter_file(component)).save(folder))


def parameter_file(component: Component) -> ParameterFile:
    """The values of an extended plant, those of forces that were found apart."""
    kind, law_name = _described(component)
    make = bare_ball_screw if kind == BALL_SCREW else bare_direct_drive
    own = {p.name for p in make(law(law_name)).all_parameters}
    own |= {p.name for p in AMPLIFIER}
    values = {p.name: Value(p.default, p.unit, None, p.source) for p in component.all_parameters}
    found = {p.name for p in component.all_parameters if p.source == FOUND and p.name not in own}
    return ParameterFile(
        kind=kind,
        law=law_name,
        plant={n: v for n, v in values.items() if n in own},
        found={n: v for n, v in values.items() if n in found},
    )


def _described(component: Component) -> tuple[str, str]:
    """Kind and law of an extended plant, by the parameters that it has."""
    kind = BALL_SCREW if "kt" in {p.name for p in component.all_parameters} else DRIVE
    (friction,) = (t for t in component.terms if t.name == "friction")
    names = [p.name for p in friction.parameters]
    return kind, next(n for n in LAWS if [p.name for p in law(n)(symbol("v")).parameters] == names)


def last_record(values: Mapping[str, _Number]) -> dict[str, _Number]:
    """The values without their records' numbers, of the last record where each has its own."""

    def number(key: str) -> int:
        return int(key.partition(".")[2] or 0)

    return {key.partition(".")[0]: values[key] for key in sorted(values, key=number)}


def _with_defaults(plant: Component, values: Mapping[str, float], source: str) -> Component:
    def changed(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(
            replace(p, default=float(values[p.name]), source=source) if p.name in values else p
            for p in parameters
        )

    return replace(
        plant,
        parameters=changed(plant.parameters),
        balances=tuple(
            replace(b, terms=tuple(replace(t, parameters=changed(t.parameters)) for t in b.terms))
            for b in plant.balances
        ),
    )


def _able_to_stick(plant: Component) -> Component:
    """The plant with the modes of the classical law, its other forces by direction as well.

    A cause that is a share of friction has a sign of the velocity in it, too: sliding, it is that
    of the mode, and a body breaks away where it would be accelerated.
    """
    moving = "vb" if "vb" in [s.name for s in plant.states] else "v"
    place = {"v": "x", "vb": "xb"}[moving]
    plant = with_sticking(plant, moving, place)
    inertia = next(b.inertia for b in plant.balances if b.state == moving)
    v = symbol(moving)
    friction = plant.output("friction").value
    stuck, *sliding = plant.modes
    ways = []
    away = {}
    for mode, direction in zip(sliding, (1, -1), strict=True):
        table = {sp.sign(v): sp.Integer(direction), sp.Abs(v): direction * v}
        rate = plant.derivative(moving).xreplace(table)
        outputs = {**mode.outputs, "friction": friction.xreplace(table)}
        ways.append(replace(mode, derivatives={**mode.derivatives, moving: rate}, outputs=outputs))
        away[mode.name] = inertia * rate.xreplace({v: sp.Integer(0)})
    events = tuple(
        replace(e, indicator=away[str(e.next_mode)]) if e.name.startswith("breaks away") else e
        for e in stuck.events
    )
    return replace(plant, modes=(replace(stuck, events=events), *ways))

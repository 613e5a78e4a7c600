"""Plan of a study: read from a TOML file, and checked before anything is run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_type_hints

import numpy as np

from ...controllers import tunable
from ...solver.arrays import Vector
from ...solver.errors import BadParameters, UserError
from ..loop import parameter_file as toml
from ..loop.loop import Loop, for_plant
from ..loop.machine import Machine, gain_ranges, model_values, own_ranges
from ..loop.parts import Part
from ..loop.reference_motions import as_reference
from .run import NAMES, STEP, Motion

VERSION = 1
MOST, MOST_SEED = 100_000, 2**63 - 1  # of a number of plants, candidates, tunings or points
MOST_RUNS, MOST_SAMPLES = 10_000_000, 10_000_000  # of a study, of a run
Ranges = Mapping[str, tuple[float, float]]

UNIFORM, NORMAL, LOGNORMAL, TEMPERATURE = "uniform", "normal", "lognormal", "temperature"
DISTRIBUTIONS = {
    UNIFORM: "[least, largest]",
    NORMAL: "[mean, standard deviation above 0]",
    LOGNORMAL: "[median, standard deviation of the logarithm], both above 0",
    TEMPERATURE: "[least, largest]",
}  # meaning of the two numbers of each
OUTERMOST = 2.0**-53  # share of all draws: the smallest that doubles distinguish from zero


def _numbers(where: str, given: Any) -> tuple[float, ...]:
    return tuple(toml.as_finite(where, v) for v in toml.as_list(where, given))


_LIMITS = partial(toml.as_record, readers=dict.fromkeys(NAMES, toml.as_finite))
# a value of a study file, and what reads it
Text: TypeAlias = Annotated[str, toml.as_text]
Texts: TypeAlias = Annotated[tuple[str, ...], toml.as_texts]
Numbers: TypeAlias = Annotated[Mapping[str, float], toml.as_numbers]
Limits: TypeAlias = Annotated[Mapping[str, float], _LIMITS]
Count: TypeAlias = Annotated[int, toml.within(0, MOST, True)]
CountFrom1: TypeAlias = Annotated[int, toml.within(1, MOST, True)]


def _readers(kind: type) -> dict[str, toml.Reader]:
    """The readers of the fields of a class, by their names in a study file."""
    hints = get_type_hints(kind, include_extras=True).items()
    return {name: hint.__metadata__[0] for name, hint in hints if hasattr(hint, "__metadata__")}


@dataclass(frozen=True)
class Variation:
    """A draw for each plant: a factor on nominal values of parameters, or a temperature."""

    parameters: Texts  # of the plant; a drawn factor is that of all of them
    numbers: tuple[float, float]  # see `DISTRIBUTIONS`: of factors, or kelvins above nominal
    distribution: str = UNIFORM
    # for a temperature: change of each parameter, relative to its nominal value, per kelvin
    coefficients: Numbers = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of its column in tables."""
        kind = TEMPERATURE if self.distribution == TEMPERATURE else "factor"
        return "_".join((kind, *self.parameters))

    @property
    def nominal(self) -> float:
        """The draw of the nominal plant."""
        return 0.0 if self.distribution == TEMPERATURE else 1.0

    def quantiles(self, shares: Vector) -> Vector:
        """The draws below which these shares of all draws are."""
        from scipy import stats

        first, second = self.numbers
        law = stats.uniform(first, second - first)
        if self.distribution == NORMAL:
            law = stats.norm(first, second)
        elif self.distribution == LOGNORMAL:
            law = stats.lognorm(second, scale=first)
        return np.asarray(law.ppf(np.clip(shares, OUTERMOST, 1 - OUTERMOST)))

    def factors(self, draw: float) -> dict[str, float]:
        """Factors of the parameters."""
        if self.distribution == TEMPERATURE:
            return {n: 1 + per_kelvin * draw for n, per_kelvin in self.coefficients.items()}
        return dict.fromkeys(self.parameters, float(draw))


@dataclass(frozen=True)
class Duty:
    """A motion to follow."""

    name: Text
    reference: Text  # a motion, see `as_reference`, or the path of a table
    stop: Annotated[float, toml.within(1e-9)]  # [s]
    # whether controllers are tuned on it; they are judged on the others
    tune: Annotated[bool, toml.as_flag] = False
    # parameters of the plant with other values than default at this duty, such as a load
    plant: Numbers = field(default_factory=dict)

    @property
    def motion(self) -> Motion:
        """Its set-point and length; raises `BadParameter`."""
        return _reference(self.reference), self.stop


_reference = cache(as_reference)  # a process uses it many times, and reads a file once


@dataclass(frozen=True)
class Entrant:
    """A controller that takes part."""

    name: str  # name in tables
    component: Text  # a name of the catalogue, ``file.py:function``, or the path of an FMU
    # with other values than default: fixed parameters, and the start of tuned ones
    values: Numbers = field(default_factory=dict)
    # of the parameters that are tuned
    tune: Annotated[Ranges, toml.as_ranges] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuning:
    """How all controllers are tuned."""

    budget: CountFrom1 = 100  # candidates; twice as many are tried to find what that would gain
    plants: Count = 2  # drawn plants on which each candidate runs, in addition to the nominal one
    seeds: CountFrom1 = 3  # repeated tunings of each, so that the scatter of a tuning is known
    limits: Limits = field(default_factory=dict)  # largest values of `Figures`


@dataclass(frozen=True)
class Plan:
    """A whole study."""

    plant: Text
    entrants: tuple[Entrant, ...]
    duties: tuple[Duty, ...]
    variations: tuple[Variation, ...] = ()
    tuning: Tuning = field(default_factory=Tuning)
    # drawn plants on which the tuned controllers are judged
    plants: Annotated[int, toml.within(2, MOST, True)] = 20
    # of the sampling of all controllers [s]; 0: continuous ones
    period: Annotated[float, toml.within(0.0)] = 1e-3
    delay: Count = 0  # samples until a computed command is put out
    instruments: Texts = ()  # see `measured_through`
    # in the command's unit; None: see `limit_of` of `machine`
    command_limit: Annotated[float | None, toml.within(1e-9)] = None
    # of the position sensor, for figures in counts [m]
    count: Annotated[float, toml.within(1e-15)] = 1 / 512_000
    tolerance: Annotated[float, toml.within(1e-12)] = 1e-6  # relative, of the solver
    seed: Annotated[int, toml.within(0, MOST_SEED, True)] = 1

    @property
    def command_unit(self) -> str:
        """Unit of the plant's command, such as ``V``."""
        return Part(self.plant).unit_of("u")

    @property
    def tuning_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if d.tune)

    @property
    def judged_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if not d.tune)

    @property
    def nominal(self) -> Vector:
        """The draws of the nominal plant."""
        return np.array([v.nominal for v in self.variations])

    def draws(self, purpose: str) -> Vector:
        """The drawn plants to "tune" on or to "judge" on, one row each, one column per variation.

        The two purposes have different plants. The first plant for tuning is the nominal one.
        """
        count = self.tuning.plants if purpose == "tune" else self.plants
        random = np.random.default_rng([self.seed, ("tune", "judge").index(purpose)])
        drawn = random.random((count, len(self.variations)))
        for k, variation in enumerate(self.variations):
            drawn[:, k] = variation.quantiles(drawn[:, k])
        return np.vstack([self.nominal, drawn]) if purpose == "tune" else drawn


def read_plan(path: Path | str) -> Plan:
    """Read a study file; raises `UserError`."""
    path = Path(path)
    try:
        plan = _plan(toml.read_toml(path), path.parent)
        for fault in _faults(plan):
            raise UserError(fault)
    except UserError as error:
        raise UserError(f"{path}: {str(error).strip()}") from None
    return plan


def _plan(table: dict[str, Any], folder: Path) -> Plan:
    if (version := table.pop("version", None)) != VERSION:
        raise UserError(f"version is {version!r}, expected {VERSION}")
    read = toml.as_record("", table, {**_readers(Plan), **_TABLES}, "controllers", "duty")
    machine: dict[str, float] = {}
    plant = read.pop("plant", "plant")
    if "params" in read:
        file = toml.read_parameters(folder / read.pop("params"))
        plant = table.get("plant", file.plant_name)
        machine = for_plant(file, plant)
    how = plant, machine, read.get("command_limit")
    entrants = tuple(_entrant(n, c, *how) for n, c in read.pop("controllers").items())
    duties = tuple(replace(d, plant={**machine, **d.plant}) for d in read.pop("duty"))
    return Plan(plant, entrants, duties, read.pop("vary", ()), **read)


def _entrant(
    name: str, given: Any, plant: str, machine: Mapping[str, float], limit: float | None
) -> Entrant:
    """A controller of the plan; for a `machine`, with the values that follow from it."""
    where = f"[controllers.{name}]"
    read = {"component": name, "values": {}} | toml.as_record(where, given, _readers(Entrant))
    component, values = read["component"], read["values"]
    known: dict[str, float] = {}
    if machine and tunable(component):  # else a user's file gives all of this itself
        loop = Loop(component, plant)
        driven = Machine.of(loop.plant, machine, limit)
        own, start = gain_ranges(loop.controller, driven)
        known = {**model_values(loop.controller, driven), **start}
    else:
        own = own_ranges(component)
    tune = read.get("tune", {n: r for n, r in own.items() if n not in values})
    return Entrant(name, component, {**known, **values}, tune)


def _variation(where: str, given: Any) -> Variation:
    readers = _readers(Variation) | dict.fromkeys(DISTRIBUTIONS, _numbers)
    read = toml.as_record(where, given, readers)
    kinds = [kind for kind in DISTRIBUTIONS if kind in read]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "no distribution"
        raise BadParameters(f"{where} has {found}, expected one of {', '.join(DISTRIBUTIONS)}")
    kind, numbers = kinds[0], read[kinds[0]]
    key = "coefficients" if kind == TEMPERATURE else "parameters"
    names = read.get(key, ())
    if set(read) != {kind, key} or not names or len(set(names)) < len(names):
        example = "{Fc = -0.01}, per kelvin" if kind == TEMPERATURE else '["Fc", "Fs"]'
        raise BadParameters(f"{where} has {kind}, expected {key} with it, such as {example}")
    positive = numbers[1:] if kind == NORMAL else numbers
    rising = kind in (UNIFORM, TEMPERATURE)
    fits = len(numbers) == 2 and (numbers[0] < numbers[1] if rising else min(positive) > 0)
    if not fits:
        expected = DISTRIBUTIONS[kind]
        raise BadParameters(f"{where} {kind} is {[*numbers]!r}, expected {expected}")
    return Variation(tuple(names), numbers, kind, names if kind == TEMPERATURE else {})


def _table_of(kind: type, place: str, *required: str) -> toml.Reader:
    """The reader of a table with the fields of a class; `place` is how messages name it."""
    readers = _readers(kind)
    return lambda where, v: kind(**toml.as_record(place.format(where), v, readers, *required))


def _each(reader: toml.Reader) -> toml.Reader:
    """The reader of a list of tables, each by its number in messages."""

    def read(where: str, given: Any) -> tuple[Any, ...]:
        found = enumerate(toml.as_list(where, given), start=1)
        return tuple(reader(f"[[{where}]] {number}", one) for number, one in found)

    return read


_TABLES: dict[str, toml.Reader] = {
    "controllers": toml.as_table,
    "duty": _each(_table_of(Duty, "{}", "name", "reference", "stop")),
    "vary": _each(_variation),
    "tuning": _table_of(Tuning, "[{}]"),
    "params": toml.as_text,
}


def _faults(plan: Plan) -> Iterator[str]:
    """What cannot be done of a plan, beside values of parameters."""
    tuned, judged, entrants = plan.tuning_duties, plan.judged_duties, plan.entrants
    if not (entrants and tuned and judged):
        yield (
            f"has {len(entrants)} controllers, {len(tuned)} duties to tune on and {len(judged)} to "
            "judge by, expected one or more of each; set `tune = true` for some of the duties"
        )
    for duty in plan.duties:
        reference, stop = duty.motion
        if duty.tune and not reference.values.any():
            yield f"duty {duty.name} has no motion and cannot be used for tuning"
        if not duty.tune and duty.reference in {d.reference for d in tuned}:
            yield f"duty {duty.name} has the motion of a tuning duty; use another motion"
        if (samples := stop / (plan.period or STEP)) > MOST_SAMPLES:
            yield (
                f"duty {duty.name} has {samples:.3g} samples, expected at most {MOST_SAMPLES:g}; "
                "use a shorter stop or a longer period"
            )
    if not plan.period and (plan.instruments or plan.delay):
        yield "instruments and a delay need a sampling period, but period is 0"
    of_tuning = len(tuned) * 2 * plan.tuning.budget * (plan.tuning.plants + 1)
    runs = len(entrants) * plan.tuning.seeds * (len(judged) * plan.plants + of_tuning)
    if runs > MOST_RUNS:
        yield f"needs {runs:.3g} runs, expected at most {MOST_RUNS:g}; use smaller numbers"
    for kind, things in (("[[duty]]", plan.duties), ("[[vary]]", plan.variations)):
        if len({t.name for t in things}) < len(things):
            yield f"two {kind} have the same name or parameters; change or remove one"

"""Plan of a study: read from a TOML file, and checked before anything is run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...controllers import tunable
from ...solver.errors import BadParameter, BadParameters, ContractError, UserError
from ..loop import parameter_file as toml
from ..loop.catalogue import in_units_of
from ..loop.loop import for_plant
from ..loop.machine import Machine, gain_ranges, model_values, own_ranges
from ..loop.parameter_file import read_parameters
from ..loop.parts import Part
from ..loop.reference_motions import read_motion
from ..master.reference_signal import Reference
from .figures import NAMES
from .loop import STEP

VERSION = 1
MOST, MOST_SEED = 100_000, 2**63 - 1  # of a number of plants, candidates, tunings or points
MOST_RUNS, MOST_SAMPLES = 10_000_000, 10_000_000  # of a study, of a run
Vector = npt.NDArray[np.float64]
Own = Callable[[str], tuple[dict[str, float], dict[str, tuple[float, float]]]]


UNIFORM, NORMAL, LOGNORMAL, TEMPERATURE = "uniform", "normal", "lognormal", "temperature"
DISTRIBUTIONS = {
    UNIFORM: "[least, largest]",
    NORMAL: "[mean, standard deviation]",
    LOGNORMAL: "[median, standard deviation of the logarithm]",
    TEMPERATURE: "[least, largest]",
}
"""Meaning of the two numbers of each."""
OUTERMOST = 2.0**-53  # share of all draws: the smallest that doubles distinguish from zero


@dataclass(frozen=True)
class Variation:
    """A draw for each plant: a factor on nominal values of parameters, or a temperature."""

    # of the plant. All get the same factor, or the factors that follow from the temperature
    parameters: tuple[str, ...]
    # of the distribution, see `DISTRIBUTIONS`: factors, or kelvins above nominal
    numbers: tuple[float, float]
    distribution: str = UNIFORM  # a temperature is uniform
    # for a temperature: change of each parameter, relative to its nominal value, per kelvin
    coefficients: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of its column in tables."""
        kind = TEMPERATURE if self.distribution == TEMPERATURE else "factor"
        return "_".join((kind, *self.parameters))

    @property
    def nominal(self) -> float:
        """The draw of the nominal plant."""
        return 0.0 if self.distribution == TEMPERATURE else 1.0

    @property
    def ends(self) -> tuple[float, ...]:
        """The smallest and the largest draw; empty if the distribution has no ends."""
        return self.numbers if self.distribution in (UNIFORM, TEMPERATURE) else ()

    def quantiles(self, shares: Vector) -> Vector:
        """The draws below which these shares of all draws are."""
        from scipy import stats

        first, second = self.numbers
        if self.distribution == NORMAL:
            law = stats.norm(first, second)
        elif self.distribution == LOGNORMAL:
            law = stats.lognorm(second, scale=first)
        else:
            law = stats.uniform(first, second - first)
        return np.asarray(law.ppf(np.clip(shares, OUTERMOST, 1 - OUTERMOST)))

    def factors(self, draw: float) -> dict[str, float]:
        """Factors of the parameters."""
        if self.distribution == TEMPERATURE:
            return {n: 1 + per_kelvin * draw for n, per_kelvin in self.coefficients.items()}
        return dict.fromkeys(self.parameters, float(draw))


@dataclass(frozen=True)
class Duty:
    """A motion to follow."""

    name: str
    reference: str  # a motion, see `read_motion`, or the path of a table
    stop: float  # [s]
    tune: bool = False  # whether controllers are tuned on it; they are judged on the others
    # parameters of the plant that differ from their defaults at this duty: those of the study's
    # parameter file, replaced by its own, such as those of a load
    plant: Mapping[str, float] = field(default_factory=dict)

    def table(self) -> bytes:
        """Content of the file that it names, which is part of the study; empty for a motion."""
        return b"" if read_motion(self.reference) else Path(self.reference).read_bytes()

    def signal(self) -> Reference:
        """The set-point over time; raises `BadParameter`."""
        return _signal(self.reference)


@dataclass(frozen=True)
class Entrant:
    """A controller that takes part."""

    name: str  # name in tables
    # a name of the catalogue or ``file.py:function``, either with ``+feed_forward``, or the path of
    # an FMU
    component: str
    # fixed parameters that differ from their defaults, and start values of tuned parameters
    values: Mapping[str, float] = field(default_factory=dict)
    # parameters that are tuned, and their ranges; if a plan gives none, those of `own_ranges` that
    # are not in `values`
    tune: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuning:
    """How all controllers are tuned."""

    # candidates for each controller; twice as many are tried to find what that would gain
    budget: int = 100
    plants: int = 2  # drawn plants on which each candidate runs, in addition to the nominal one
    seeds: int = 3  # number of repeated tunings of each, so that the scatter of a tuning is known
    # largest values of figures, see `Figures`, that a tuned controller should not exceed
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """A whole study."""

    plant: str
    entrants: tuple[Entrant, ...]
    duties: tuple[Duty, ...]
    variations: tuple[Variation, ...] = ()
    tuning: Tuning = field(default_factory=Tuning)
    plants: int = 20  # drawn plants on which the tuned controllers are judged
    # sampling period of all controllers [s]; 0 for continuous ones, without instruments
    period: float = 1e-3
    delay: int = 0  # samples until a computed command is put out
    # through which the controllers measure, one after the other, see `measured_through`
    instruments: tuple[str, ...] = ()
    # largest magnitude of the command, in the unit of the plant's command: volts of an amplifier,
    # newtons if the command is a force. None: see `limit_of` of `machine`
    command_limit: float | None = None
    count: float = 1 / 512_000  # of the position sensor, for figures in counts [m]
    tolerance: float = 1e-6  # relative, of the solver
    seed: int = 1

    @property
    def tuning_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if d.tune)

    @property
    def judged_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if not d.tune)

    def draws(self, purpose: str) -> npt.NDArray[np.float64]:
        """The drawn plants to "tune" on or to "judge" on, one row each, one column per variation.

        The two purposes have different plants. The first plant for tuning is the nominal one.
        """
        count = self.tuning.plants if purpose == "tune" else self.plants
        random = np.random.default_rng([self.seed, ("tune", "judge").index(purpose)])
        drawn = self.drawn(random.random((count, len(self.variations))))
        return np.vstack([self.nominal, drawn]) if purpose == "tune" else drawn

    @property
    def nominal(self) -> npt.NDArray[np.float64]:
        """The draws of the nominal plant."""
        return np.array([v.nominal for v in self.variations])

    def drawn(self, shares: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Draws, one column per variation, from shares between 0 and 1."""
        columns = [v.quantiles(shares[:, k]) for k, v in enumerate(self.variations)]
        return np.column_stack(columns) if columns else shares

    def rows_to_check(self) -> npt.NDArray[np.float64]:
        """All drawn plants of the study, and those with one variation at an end of its range."""
        rows = []
        for k, variation in enumerate(self.variations):
            for end in variation.ends:
                rows.append(self.nominal)
                rows[-1][k] = end
        return np.vstack([*rows, self.draws("tune"), self.draws("judge")])

    def to_json(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)


@cache
def _signal(text: str) -> Reference:
    """The set-point of a duty; a process uses it many times, and reads a file once."""
    return read_motion(text) or Reference.read(text)


def read_plan(path: Path | str) -> Plan:
    """Read a study file; raises `UserError`."""
    path = Path(path)
    try:
        table = toml.read_toml(path)
        return _plan(table, _machine(table, path.parent))
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _machine(table: dict[str, Any], folder: Path) -> dict[str, float]:
    """Values of the plant in the parameter file that a study names; its plant goes into `table`."""
    if "params" not in table:
        return {}
    try:
        told = read_parameters(folder / str(table.pop("params")))
        plant = str(table.setdefault("plant", told.plant_name))
        return for_plant(told, plant)
    except BadParameters as error:
        raise UserError(f"params: {error}") from error


def _plan(table: dict[str, Any], machine: Mapping[str, float]) -> Plan:
    version = table.pop("version", None)
    if version != VERSION:
        raise UserError(f"version is {version!r}, expected {VERSION}")
    controllers = _part(table, "controllers", dict)
    duties = _part(table, "duty", list)
    given = toml.as_record("", table, _READERS)
    own = cache(partial(_own, given.get("plant", "plant"), given.get("command_limit"), machine))
    plan = Plan(
        entrants=tuple(_entrant(n, c, own if machine else None) for n, c in controllers.items()),
        duties=tuple(_duty(k, duty, machine) for k, duty in enumerate(duties)),
        variations=given.pop("vary", ()),
        **{"plant": "plant", **given},
    )
    for fault in _faults(plan):
        raise UserError(fault)
    return plan


def _part(table: dict[str, Any], name: str, kind: type) -> Any:
    found = table.pop(name, None)
    if not isinstance(found, kind) or not found:
        form = "[controllers.NAME]" if kind is dict else f"[[{name}]]"
        raise UserError(f"has no {form}, expected one or more")
    return found


def _own(
    plant: str, limit: float | None, values: Mapping[str, float], component: str
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """A controller's model of a machine with its start values, and the ranges of its gains."""
    if not tunable(component):  # from a user's file, which gives all of this itself
        return {}, own_ranges(component)
    try:
        machine = Machine.of(Part(plant), values, limit)
        controller = Part(in_units_of(component, machine.plant.name))
        ranges, start = gain_ranges(controller, machine)
        return {**model_values(controller, machine), **start}, ranges
    except (BadParameter, ContractError) as error:
        raise UserError(str(error).replace("--limit", "command_limit")) from error


def _entrant(name: str, given: Any, machine: Own | None = None) -> Entrant:
    """A controller of the plan; for a `machine`, with the values that follow from it."""
    where = f"[controllers.{name}]"
    readers = {"component": toml.as_text, "values": toml.as_numbers, "tune": toml.as_table}
    read = {"component": name, "values": {}} | toml.as_record(where, given, readers)
    component, values = read["component"], read["values"]
    known, own = machine(component) if machine else ({}, own_ranges(component))
    ranges = read.get("tune", {n: r for n, r in own.items() if n not in values})
    tune = {n: toml.as_range(where, n, r) for n, r in ranges.items()}
    return Entrant(name, component, {**known, **values}, tune)


def _duty(k: int, given: Any, machine: Mapping[str, float]) -> Duty:
    where = f"[[duty]] {k + 1}"
    readers = {"name": toml.as_text, "reference": toml.as_text, "stop": toml.as_finite}
    readers |= {"tune": toml.as_flag, "plant": toml.as_numbers}
    read = toml.as_record(where, given, readers, "name", "reference", "stop")
    where = f"duty {read['name']}"
    if not read["stop"] > 0:
        raise UserError(f"{where}: stop is {read['stop']:g} s, expected more than 0")
    duty = Duty(**{**read, "plant": {**machine, **read.get("plant", {})}})
    try:
        duty.signal()
    except BadParameter as error:
        raise UserError(f"{where}: {error}") from error
    return duty


def _faults(plan: Plan) -> Iterator[str]:
    """What cannot be done of a plan, beside values of parameters."""
    for kind, duties in (("tune on", plan.tuning_duties), ("judge by", plan.judged_duties)):
        if not duties:
            yield f"has no duty to {kind}; set `tune = true` for some of them and not for others"
    seen = {d.reference for d in plan.tuning_duties}
    for duty in plan.judged_duties:
        if duty.reference in seen:
            yield f"duty {duty.name} has the motion of a tuning duty; use another motion"
    if not plan.period and (plan.instruments or plan.delay):
        yield "instruments and a delay need a sampling period, but period is 0"
    for duty in plan.tuning_duties:
        if not duty.signal().values.any():
            yield f"duty {duty.name} has no motion and cannot be used for tuning"
    judged = plan.tuning.seeds * len(plan.judged_duties) * plan.plants
    tuned = plan.tuning.seeds * 2 * plan.tuning.budget * (plan.tuning.plants + 1)
    runs = len(plan.entrants) * (judged + len(plan.tuning_duties) * tuned)
    if runs > MOST_RUNS:
        yield f"needs {runs:.3g} runs, expected at most {MOST_RUNS:g}; use smaller numbers"
    for duty in plan.duties:
        samples = duty.stop / (plan.period or STEP)
        if samples > MOST_SAMPLES:
            yield (
                f"duty {duty.name} has {samples:.3g} samples, expected at most {MOST_SAMPLES:g}; "
                "use a shorter stop or a longer period"
            )
    if len({d.name for d in plan.duties}) < len(plan.duties):
        yield "two duties have the same name"
    if len({v.name for v in plan.variations}) < len(plan.variations):
        yield "two [[vary]] vary the same parameters; remove one"
    least = {"period": 0.0, "command_limit": 1e-9, "count": 1e-15, "tolerance": 1e-12}
    for name, low in least.items():
        value = getattr(plan, name)
        if value is not None and value < low:
            yield f"{name} is {value:g}, expected {low:g} or more"


def _variation(given: Any) -> Variation:
    """A ``[[vary]]`` of a study file."""
    given = toml.as_table("vary", given)
    toml.check_names("[[vary]]", given, ("parameters", "coefficients", *DISTRIBUTIONS))
    kinds = [kind for kind in DISTRIBUTIONS if kind in given]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "no distribution"
        raise BadParameters(f"vary: has {found}, expected one of {', '.join(DISTRIBUTIONS)}")
    kind = kinds[0]
    names = "coefficients" if kind == TEMPERATURE else "parameters"
    for other in {"coefficients", "parameters"} - {names}:
        if other in given:
            raise BadParameters(f"vary: {kind} has {other}, expected {names} alone")
    if names == "coefficients":
        numbers = toml.as_numbers("vary.coefficients", given.get(names, {}))
        if not numbers:
            raise BadParameters(
                "vary: a temperature has no coefficients, such as {Fc = -0.01} per kelvin"
            )
        return Variation(tuple(numbers), toml.as_range("vary", kind, given[kind]), kind, numbers)
    parameters = tuple(map(str, toml.as_list("vary: parameters", given.get(names, []))))
    if not parameters or len(set(parameters)) < len(parameters):
        raise BadParameters(f"vary: parameters is {list(parameters)!r}, expected a list of names")
    return Variation(parameters, _numbers(kind, ", ".join(parameters), given[kind]), kind)


def _numbers(kind: str, of: str, given: Any) -> tuple[float, float]:
    """The two numbers of a distribution of factors."""
    if kind == UNIFORM:
        return toml.as_range("vary", of, given)
    pair = toml.as_list(f"vary: {kind} of {of}", given)
    found = [float(v) for v in pair if toml.is_number(v)]
    positive = found if kind == LOGNORMAL else found[1:]
    if len(pair) != 2 or len(found) != 2 or not min(positive) > 0:
        more = "both" if kind == LOGNORMAL else "the second"
        raise BadParameters(
            f"vary: {kind} of {of} is {given!r}, expected {DISTRIBUTIONS[kind]}, finite numbers, "
            f"{more} more than 0"
        )
    return found[0], found[1]


def _limits(where: str, given: Any) -> dict[str, float]:
    return toml.as_record(where, given, dict.fromkeys(NAMES, toml.as_finite))


def _tuning(where: str, given: Any) -> Tuning:
    readers: dict[str, toml.Reader] = {
        "budget": toml.as_whole(1, MOST),
        "plants": toml.as_whole(0, MOST),
        "seeds": toml.as_whole(1, MOST),
        "limits": _limits,
    }
    return Tuning(**toml.as_record(f"[{where}]", given, readers))


_READERS: dict[str, toml.Reader] = {
    "plant": toml.as_text,
    "vary": lambda where, given: tuple(map(_variation, toml.as_list(where, given))),
    "tuning": _tuning,
    "instruments": toml.as_texts,
    **dict.fromkeys(("period", "command_limit", "count", "tolerance"), toml.as_finite),
    "plants": toml.as_whole(2, MOST),
    "seed": toml.as_whole(0, MOST_SEED),
    "delay": toml.as_whole(0, MOST),
}

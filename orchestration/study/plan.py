"""What a study is asked: read from a TOML file, and checked before anything is run."""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...controllers import tunable
from ...instruments.supply import NOMINAL_VOLTAGE
from ..reference_motions import read_motion
from ..reference_signal import BadReference, Reference
from .figures import NAMES

VERSION = 1


class BadPlan(ValueError):
    """A study file that makes no sense; the message says what was got and what was expected."""


@dataclass(frozen=True)
class Duty:
    """A motion to follow.

    Attributes
    ----------
    name : str
    reference : str
        A motion, see `read_motion`, or the path of a table.
    stop : float
        [s]
    tune : bool
        Whether controllers are tuned on it; they are judged on the others.
    plant : dict of str to float
        Parameters of the plant that are not default at this duty, such as those of a load.
    """

    name: str
    reference: str
    stop: float
    tune: bool = False
    plant: Mapping[str, float] = field(default_factory=dict)

    def signal(self) -> Reference:
        """The set-point over time.

        Raises
        ------
        BadReference
        """
        return _signal(self.reference)


@dataclass(frozen=True)
class Variation:
    """How plants differ: factors on nominal values of parameters.

    Attributes
    ----------
    parameters : tuple of str
        Of the plant; all of them get the same factor.
    uniform : tuple of two floats
        Least and largest factor.
    """

    parameters: tuple[str, ...]
    uniform: tuple[float, float]


@dataclass(frozen=True)
class Entrant:
    """A controller that takes part.

    Attributes
    ----------
    name : str
        In tables.
    component : str
        A name of the catalogue, or ``file.py:function``.
    values : dict of str to float
        Parameters that are not default and stay.
    tune : dict of str to (float, float)
        Parameters that are tuned, and their ranges.
    """

    name: str
    component: str
    values: Mapping[str, float] = field(default_factory=dict)
    tune: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuning:
    """How all are tuned.

    Attributes
    ----------
    budget : int
        Candidates that each may try; twice as many are tried to see what that would gain.
    plants : int
        Drawn plants on which each candidate runs, beside the nominal one.
    seeds : int
        Times that each is tuned anew, so that the luck of a tuning is known.
    limits : dict of str to float
        Largest values of figures, see `Figures`, which a tuned controller is to keep.
    """

    budget: int = 100
    plants: int = 2
    seeds: int = 3
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """A whole study.

    Attributes
    ----------
    plant : str
    entrants : tuple of Entrant
    duties : tuple of Duty
    variations : tuple of Variation
    tuning : Tuning
    plants : int
        Drawn plants on which the tuned controllers are judged.
    period : float
        Sampling period of all controllers [s]; 0 for continuous ones, without instruments.
    delay : int
        Samples until a computed command is put out.
    instruments : tuple of str
        Through which the controllers measure, one behind the other, see `measured_through`.
    voltage_limit : float
        The amplifier's [V].
    count : float
        Of the position sensor, for figures in counts [m].
    tolerance : float
        Relative, of the solver.
    seed : int
    """

    plant: str
    entrants: tuple[Entrant, ...]
    duties: tuple[Duty, ...]
    variations: tuple[Variation, ...] = ()
    tuning: Tuning = field(default_factory=Tuning)
    plants: int = 20
    period: float = 1e-3
    delay: int = 0
    instruments: tuple[str, ...] = ()
    voltage_limit: float = NOMINAL_VOLTAGE
    count: float = 1 / 512_000
    tolerance: float = 1e-6
    seed: int = 1

    @property
    def tuning_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if d.tune)

    @property
    def judged_duties(self) -> tuple[Duty, ...]:
        return tuple(d for d in self.duties if not d.tune)

    def factors(self, purpose: str) -> npt.NDArray[np.float64]:
        """Factors of the drawn plants, one row each, one column per variation.

        Parameters
        ----------
        purpose : {"tune", "judge"}
            Those of one are never those of the other. The first of those to tune on is nominal.
        """
        count = self.tuning.plants if purpose == "tune" else self.plants
        random = np.random.default_rng([self.seed, ("tune", "judge").index(purpose)])
        low, high = (np.array([v.uniform[k] for v in self.variations]) for k in (0, 1))
        drawn = low + (high - low) * random.random((count, len(self.variations)))
        return np.vstack([np.ones((1, drawn.shape[1])), drawn]) if purpose == "tune" else drawn

    def rows_to_check(self) -> npt.NDArray[np.float64]:
        """Factors of all plants of the study, and of those at the ends of the ranges."""
        count = len(self.variations)
        ends = np.array([v.uniform for v in self.variations]).reshape(count, 2)
        return np.vstack([ends.T, self.factors("tune"), self.factors("judge")])

    def to_json(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)


@cache
def _signal(text: str) -> Reference:
    """A process follows each motion many times, and reads a file once."""
    return read_motion(text) or Reference.read(text)


def read_plan(path: Path | str) -> Plan:
    """Read a study file.

    Raises
    ------
    BadPlan
    """
    try:
        table = tomllib.loads(Path(path).read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadPlan(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise BadPlan(f"{path}: is no TOML: {error}") from error
    try:
        return _plan(table)
    except BadPlan as error:
        raise BadPlan(f"{path}: {error}") from None


def _plan(table: dict[str, Any]) -> Plan:
    version = table.pop("version", None)
    if version != VERSION:
        raise BadPlan(f"version is {version!r}, expected {VERSION}")
    controllers = _part(table, "controllers", dict)
    duties = _part(table, "duty", list)
    variations = _list("vary", table.pop("vary", []))
    tuning = _table("tuning", table.pop("tuning", {}))
    limits = _table("tuning.limits", tuning.pop("limits", {}))
    known = {f.name for f in fields(Plan)} - {"entrants", "duties", "variations", "tuning"}
    _check_names("the study", table, known)
    plan = Plan(
        plant=str(table.pop("plant", "plant")),
        entrants=tuple(_entrant(name, given) for name, given in controllers.items()),
        duties=tuple(_duty(k, given) for k, given in enumerate(duties)),
        variations=tuple(_variation(given) for given in variations),
        tuning=_tuning(tuning, limits),
        instruments=tuple(map(str, _list("instruments", table.pop("instruments", [])))),
        **_numbers("the study", table, {"plants": 2, "seed": 0, "delay": 0}),
    )
    _check(plan)
    return plan


def _part(table: dict[str, Any], name: str, kind: type) -> Any:
    found = table.pop(name, None)
    if not isinstance(found, kind) or not found:
        form = "[controllers.NAME]" if kind is dict else f"[[{name}]]"
        raise BadPlan(f"has no {form}, expected one or more")
    return found


def _table(where: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise BadPlan(f"{where} is {given!r}, expected a table")
    return dict(given)


def _list(where: str, given: Any) -> list[Any]:
    if not isinstance(given, list):
        raise BadPlan(f"{where} is {given!r}, expected a list")
    return given


def _entrant(name: str, given: Any) -> Entrant:
    where = f"controllers.{name}"
    given = _table(where, given)
    _check_names(where, given, ("component", "values", "tune"))
    component = str(given.get("component", name))
    values = _numbers(f"{where}.values", _table(f"{where}.values", given.get("values", {})), {})
    ranges = _table(f"{where}.tune", given.get("tune", tunable(component)))
    return Entrant(name, component, values, {n: _range(where, n, r) for n, r in ranges.items()})


def _range(where: str, name: str, given: Any) -> tuple[float, float]:
    pair = list(given) if isinstance(given, list | tuple) else []
    numbers = [float(v) for v in pair if isinstance(v, int | float) and math.isfinite(v)]
    if len(pair) != 2 or len(numbers) != 2:
        raise BadPlan(f"{where}: {name} is {given!r}, expected two finite numbers")
    if not numbers[0] < numbers[1]:
        raise BadPlan(f"{where}: {name} is {given!r}, an empty range; the lower bound goes first")
    return numbers[0], numbers[1]


def _duty(k: int, given: Any) -> Duty:
    given = _table(f"duty {k + 1}", given)
    _check_names(f"duty {k + 1}", given, ("name", "reference", "stop", "tune", "plant"))
    for name in ("name", "reference", "stop"):
        if name not in given:
            raise BadPlan(f"duty {k + 1} has no {name}")
    stop = _numbers(f"duty {given['name']}", {"stop": given["stop"]}, {})["stop"]
    if not stop > 0:
        raise BadPlan(f"duty {given['name']}: stop is {stop:g} s, expected more than 0")
    where = f"duty {given['name']}: plant"
    plant = _numbers(where, _table(where, given.get("plant", {})), {})
    tune = bool(given.get("tune", False))
    duty = Duty(str(given["name"]), str(given["reference"]), stop, tune, plant)
    try:
        duty.signal()
    except BadReference as error:
        raise BadPlan(f"duty {duty.name}: {error}") from error
    return duty


def _variation(given: Any) -> Variation:
    given = _table("vary", given)
    _check_names("vary", given, ("parameters", "uniform"))
    names = given.get("parameters", [])
    if not isinstance(names, list) or not names:
        raise BadPlan(f"vary: parameters is {names!r}, expected a list of names")
    return Variation(
        tuple(map(str, names)), _range("vary", ", ".join(map(str, names)), given.get("uniform"))
    )


def _tuning(given: dict[str, Any], limits: Mapping[str, Any]) -> Tuning:
    _check_names("tuning", given, ("budget", "plants", "seeds"))
    _check_names("tuning.limits", limits, NAMES)
    numbers = _numbers("tuning", given, {"budget": 1, "plants": 0, "seeds": 1})
    return Tuning(**numbers, limits=_numbers("tuning.limits", dict(limits), {}))


def _numbers(where: str, given: Mapping[str, Any], whole: Mapping[str, int]) -> dict[str, Any]:
    """Finite numbers; those of `whole` are whole numbers, at least so large."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not plain or not math.isfinite(value):
            raise BadPlan(f"{where}: {name} is {value!r}, expected a finite number")
        if name in whole and (value != int(value) or value < whole[name]):
            raise BadPlan(f"{where}: {name} is {value!r}, expected a whole number >= {whole[name]}")
        found[name] = int(value) if name in whole else float(value)
    return found


def _check_names(where: str, given: Mapping[str, Any], known: Sequence[str] | set[str]) -> None:
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
            hint = f"; nearest: {near[0]}" if near else ""
            raise BadPlan(f"{where} has no {name!r}{hint}; it has {', '.join(sorted(known))}")


def _check(plan: Plan) -> None:
    for kind, duties in (("tune on", plan.tuning_duties), ("judge by", plan.judged_duties)):
        if not duties:
            raise BadPlan(f"has no duty to {kind}; say `tune = true` in some and not in others")
    seen = {d.reference for d in plan.tuning_duties}
    for duty in plan.judged_duties:
        if duty.reference in seen:
            raise BadPlan(f"duty {duty.name} is judged by a motion that is tuned on")
    if not plan.period and (plan.instruments or plan.delay):
        raise BadPlan("instruments and a delay need a sampling period, and period is 0")
    for duty in plan.tuning_duties:
        if not duty.signal().values.any():
            raise BadPlan(f"duty {duty.name} does not move, and gives nothing to tune on")
    names = [d.name for d in plan.duties]
    if len(set(names)) < len(names):
        raise BadPlan("two duties have one name")
    for name, value, least in (
        ("period", plan.period, 0.0),
        ("voltage_limit", plan.voltage_limit, 1e-9),
        ("count", plan.count, 1e-15),
        ("tolerance", plan.tolerance, 1e-12),
    ):
        if value < least:
            raise BadPlan(f"{name} is {value:g}, expected {least:g} or more")

"""The machine on the rig: values and units, and sizes of trials, regulators, instruments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import sympy as sp

from ...orchestration.loop.parameter_file import BALL_SCREW, COMMANDS, ROTARY
from ...plant import NOMINAL, TURNING
from ...plant.instruments import UNITS, UNLIMITED
from ...plant.instruments.acquisition import SAMPLE_TIME
from ...plant.law import claims
from ...solver.component import Parameter, in_units, symbol, unit_in
from ...solver.errors import BadParameter, BadParameters
from .compiled_rig import plant_kernel
from .noise import Noise
from .parameters import TRIAL, check, given_values
from .regulators import Gains, static_force_gains, velocity_gains
from .rig_trials import (
    BREAK_AWAY,
    FASTEST,
    PRESLIDING,
    VELOCITY,
    VOLTAGE,
    Sizes,
    Trial,
    trials_of,
)
from .rig_wiring import PLANT

if TYPE_CHECKING:
    from ...orchestration.loop.parameter_file import ParameterFile

Vector = npt.NDArray[np.float64]

SIZES = (
    Parameter("speed", FASTEST, "m/s", "largest velocity of trials", "Section 2.4.1", minimum=1e-9),
    Parameter("force", BREAK_AWAY, "N", "break-away force, for trials", "Table 3.1", minimum=1e-9),
    Parameter(
        "travel",
        0.131,
        "m",
        "distance from the start of trials to either end",
        "Table 2.1: half of the screw's thread",
        minimum=1e-9,
    ),
)
SIZED = "scaled to the machine, measurement/rig/machine.py"
_RESOLUTION, _CAPACITY = 0.089, 44.5  # load cell of the thesis [N], Table 2.1
_ENCODERS = {True: (1 / (2 * math.pi), 2.0**20), False: (1000.0, 1000.0)}  # 20 bits a turn, or 1 um
_SPARE = 0.8  # friction at the largest velocity over the force at the command's limit, at most
_OVER_TRAVEL = 1.0  # least time over the travel at the largest velocity, and of a trial [s]
_SLOWEST_LAG = 10.0  # lag of a machine without damping [s]
_HIGH = 1e3  # velocity at which every law's curve has fallen [m/s]
_LEAST_COUNTS = 4.0  # least presliding distance in counts of the encoder


@dataclass(frozen=True)
class Machine:
    """The machine on the rig.

    Attributes
    ----------
    kind, command, law : str
        As in a parameter file.
    values : mapping of str to float
        Parameters of the plant.
    given : mapping of str to float
        Given values of `SIZES`.
    """

    kind: str
    command: str
    law: str
    values: Mapping[str, float] = field(default_factory=dict)
    given: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_axis(self) -> bool:
        """Whether it is the axis of the thesis, with trials and instruments as printed."""
        return self.kind == BALL_SCREW

    @property
    def command_words(self) -> dict[str, str]:
        """Units changed by its command only; the plant's equations already have the others."""
        return UNITS.get(self.command or COMMANDS[0], {})

    @property
    def words(self) -> dict[str, str]:
        """Its units, see `unit_in`."""
        return {**(TURNING if self.kind == ROTARY else {}), **self.command_words}

    @property
    def known(self) -> dict[str, Any]:
        """Parameters of plant and trials, as ``part.name``, in its units."""
        plant = in_units(tuple(plant_kernel(self.law, self.kind).parameters), self.command_words)
        sizes = in_units(SIZES, self.words)
        return {f"{PLANT}.{p.name}": p for p in plant} | {f"{TRIAL}.{p.name}": p for p in sizes}

    def unit(self, unit: str) -> str:
        """Unit of this machine that corresponds to a unit of the thesis' axis."""
        return unit_in(unit, self.words)

    @property
    def limit(self) -> float:
        """Force of a drive at the limit of its command [N]."""
        largest = self.values["voltage_limit"]
        return abs(self.values["gain"]) * largest if largest < UNLIMITED else math.inf

    def friction(self, velocity: float) -> float:
        """Friction [N] in steady sliding at a velocity [m/s], the larger of both directions."""
        curve = claims(self.law).steady_state
        return max(abs(self._number(curve, v)) for v in (velocity, -velocity))

    def _number(self, expression: sp.Expr | None, velocity: float = 1.0) -> float:
        names, number = _compiled(expression)
        return float(number(*({**self.values, "v": velocity}[n] for n in names)))

    @property
    def viscous(self) -> float:
        """Slope of the law's curve at high velocities [N*s/m]."""
        return (self.friction(2 * _HIGH) - self.friction(_HIGH)) / _HIGH

    @property
    def mass(self) -> float:
        """Total moving mass of a drive [kg]."""
        return self.values["J" if self.kind == ROTARY else "m"]

    @property
    def sizes(self) -> dict[str, float]:
        """Values of `SIZES`; an unknown velocity is nan."""
        if self.is_axis:
            return {p.name: p.default for p in SIZES} | dict(self.given)
        static = [v for n, v in self.values.items() if n.partition("_")[0] in ("Fs", "Fc")]
        force = max(static, default=self.friction(1e-9))
        own = {"speed": math.nan, "force": force, "travel": math.inf} | dict(self.given)
        viscous = self.viscous
        sliding = self.friction(_HIGH) - _HIGH * viscous
        spare = _SPARE * self.limit - abs(self.values["offset"]) - sliding
        if "speed" not in self.given and viscous > 1e-9 * sliding / _HIGH and spare > 0.0:
            own["speed"] = min(sliding / viscous, spare / viscous, own["travel"] / _OVER_TRAVEL)
        return own

    @cached_property
    def trials(self) -> dict[str, Trial]:
        """All trials by name, scaled to the machine."""
        own = self.sizes
        shares = own["speed"] / FASTEST, own["force"] / BREAK_AWAY
        sizes = Sizes(*shares, own["travel"], self.words, self.is_axis)
        if not self.is_axis:
            load = partial(_load, self.values["gain"], self.values["offset"])
            sizes = replace(sizes, loading=load)
        return trials_of(sizes)

    @property
    def noise(self) -> Noise:
        """Default noise of its instruments."""
        return Noise(load_cell=Noise.load_cell * self.sizes["force"] / BREAK_AWAY)

    @property
    def defaults(self) -> dict[str, float]:
        """Values of sizes, instruments and regulators that differ from the thesis."""
        if self.is_axis:
            return {}
        gain, damping = self.values["gain"], max(self.viscous, self.mass / _SLOWEST_LAG)
        share = self.sizes["force"] / BREAK_AWAY
        turns, counts = _ENCODERS[self.kind == ROTARY]
        return {
            **{f"{TRIAL}.{n}": v for n, v in self.sizes.items()},
            "encoder.p": turns,
            "encoder.counts": counts,
            "load_cell.resolution": share * _RESOLUTION,
            "load_cell.capacity": share * _CAPACITY,
            **self._regulator("velocity_pid", velocity_gains(self.mass, gain, damping)),
            **self._regulator("force_pid", static_force_gains(gain)),
        }

    def _regulator(self, name: str, gains: Gains) -> dict[str, float]:
        return {
            f"{name}.Kp": gains.proportional,
            f"{name}.Ki": gains.integral,
            f"{name}.Kd": gains.derivative,
            f"{name}.limit": self.values["voltage_limit"],
        }

    def check_trial(self, trial: Trial, values: Mapping[str, float]) -> None:
        """Reject a trial that does not apply to a drive.

        Parameters
        ----------
        trial : Trial
        values : mapping of str to float
            All parameters of the rig, as ``part.name``.

        Raises
        ------
        BadParameter
        """
        if self.is_axis:
            return
        force = self.unit("N")
        if trial.control == VELOCITY and math.isnan(self.sizes["speed"]):
            if self.limit < math.inf and self.viscous > 0:
                raise BadParameter(
                    f"{trial.name}: the drive gives {self.limit:.3g} {force} at the limit of its "
                    f"command, and its friction is {self.sizes['force']:.3g} {force}: too small "
                    "for sliding; use a larger plant.voltage_limit"
                )
            raise BadParameter(
                f"{trial.name} needs a velocity, and without viscous friction this "
                f"drive has no default; give trial.speed, in {self.unit('m/s')}, as --set "
                "trial.speed=0.1"
            )
        reference = trial.reference()
        needed = float(np.abs(reference).max())
        if trial.control == VELOCITY:
            rate = float(np.abs(np.diff(reference)).max()) / SAMPLE_TIME
            needed = max(self.friction(needed), self.sizes["force"]) + self.mass * rate
        if trial.control == VOLTAGE:
            needed *= abs(self.values["gain"])
        else:
            needed += abs(self.values["offset"])
        if needed > self.limit:
            raise BadParameter(
                f"{trial.name} ({trial.asked}) takes {needed:.3g} {force}, but the drive gives "
                f"{self.limit:.3g} {force} at the limit of its command; use a larger "
                "plant.voltage_limit, or smaller trial.speed or trial.force"
            )
        if trial.duration < _OVER_TRAVEL * (1 - 1e-9):
            raise BadParameter(
                f"{trial.name} ({trial.asked}) ends after {trial.duration:.2g} s on the travel of "
                f"{self.sizes['travel']:.3g} {self.unit('m')}; use a larger trial.travel "
                "or a smaller trial.speed"
            )
        if trial.table in PRESLIDING:
            self._check_presliding(trial, values)

    def _check_presliding(self, trial: Trial, values: Mapping[str, float]) -> None:
        stiffness = claims(self.law).stiffness
        if stiffness is None:
            raise BadParameter(
                f"{trial.name} is for presliding, which the law {self.law} does not have; "
                "use another law, such as --law lugre"
            )
        way = abs(trial.level) / self._number(stiffness)
        counts = way * values["encoder.counts"] * values["encoder.p"]
        if counts < _LEAST_COUNTS:
            least = math.ceil(values["encoder.counts"] * _LEAST_COUNTS / counts)
            raise BadParameter(
                f"{trial.name} covers {way:.2g} {self.unit('m')}, {counts:.2g} counts of "
                f"the encoder: too small to be measured; use encoder.counts of {least} or more"
            )


@cache
def _compiled(expression: sp.Expr) -> tuple[tuple[str, ...], Callable[..., Any]]:
    free = tuple(sorted(s.name for s in sp.sympify(expression).free_symbols))
    return free, sp.lambdify([symbol(n) for n in free], expression, "math")


def machine_of(
    law: str, parameters: Mapping[str, float] | None = None, told: ParameterFile | None = None
) -> Machine:
    """The machine with a friction law, and the values given by a file and a user.

    Raises
    ------
    UnknownName, BadParameter, BadParameters
    """
    kind, command = (told.kind, told.command) if told else (BALL_SCREW, "")
    if kind not in NOMINAL:
        raise BadParameters(
            f"{told.path if told else ''}: kind is {kind!r}, expected one of {', '.join(NOMINAL)}: "
            "the rig"
        )
    machine = Machine(kind, command, law)
    known = machine.known
    given = given_values(known, law, parameters, told)
    for name in given.keys() & known.keys():
        check(name, given[name], known, law)
    if given.get(f"{PLANT}.gain") == 0.0:
        raise BadParameter("plant.gain is 0, so that no command moves this drive; expected another")
    values: dict[str, dict[str, float]] = {PLANT: {}, TRIAL: {}}
    for name, p in known.items():
        part, _, own = name.partition(".")
        if part == PLANT or name in given:
            values[part][own] = given.get(name, p.default)
    return replace(machine, values=values[PLANT], given=values[TRIAL])


def _load(gain: float, offset: float, rate: float, time: Vector) -> Vector:
    """Command that loads a drive at a rate [N/s] from t = 0."""
    return np.asarray((rate * time + offset) / gain)

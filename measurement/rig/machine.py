"""The machine on the rig: values and units, and sizes of trials, regulators, instruments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from ...orchestration.loop.parameter_file import BALL_SCREW, COMMANDS, ROTARY, check_values
from ...orchestration.loop.parts import Part
from ...plant import NOMINAL, TURNING
from ...plant.instruments import UNITS, UNLIMITED
from ...plant.instruments.acquisition import SAMPLE_TIME, load_cell
from ...plant.law import claims
from ...solver.arrays import Vector
from ...solver.component import Parameter, in_units, symbol, unit_in
from ...solver.errors import BadParameter, BadParameters, did_you_mean
from .program import DEVICES, PLANT, of_part, plant_kernel
from .regulators import FORCE_TIME, Gains, static_force_gains, velocity_gains
from .trials import (
    BREAK_AWAY,
    FASTEST,
    PRESLIDING,
    VELOCITY,
    VOLTAGE,
    Sizes,
    Trial,
    trials_named,
    trials_of,
)

if TYPE_CHECKING:
    from ...orchestration.loop.parameter_file import ParameterFile


TRIAL = "trial"
"""Prefix of the names of sizes of trials; names of parts have the part's name as prefix."""
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
_ENCODERS = {True: (1 / (2 * math.pi), 2.0**20), False: (1000.0, 1000.0)}  # 20 bits a turn, or 1 um
_SPARE = 0.8  # friction at the largest velocity over the force at the command's limit, at most
_OVER_TRAVEL = 1.0  # least time over the travel at the largest velocity, and of a trial [s]
_HIGH = 1e3  # velocity at which every law's curve has fallen [m/s]
_LEAST_COUNTS = 4.0  # least presliding distance in counts of the encoder


@dataclass(frozen=True)
class Machine:
    """The machine on the rig, with the values given by a user and a file.

    Raises
    ------
    UnknownName, BadParameter, BadParameters
        For an unknown law, and for values of the plant or of `SIZES` that cannot be used.
    """

    law: str  # friction law of the rig; it may differ from the file's
    parameters: Mapping[str, float] | None = None
    """The user's, as ``part.name``; a name without its part is the plant's."""
    file: ParameterFile | None = field(default=None, repr=False)  # default: the thesis' axis

    def __post_init__(self) -> None:
        if self.kind not in NOMINAL:
            raise BadParameters(
                f"{self.file.path if self.file else ''}: kind is {self.kind!r}, expected one of "
                f"{', '.join(NOMINAL)}: the rig"
            )
        if self.given(self.known).get(f"{PLANT}.gain") == 0.0:
            raise BadParameter(
                "plant.gain is 0, so that no command moves this drive; expected another"
            )

    @property
    def kind(self) -> str:
        """As in a parameter file."""
        return self.file.kind if self.file else BALL_SCREW

    @property
    def is_axis(self) -> bool:
        """Whether it is the axis of the thesis, with trials and instruments as printed."""
        return self.kind == BALL_SCREW

    # -- values and units --------------------------------------------------------------------------

    @property
    def words(self) -> dict[str, str]:
        """Its units, see `unit_in`."""
        return {**(TURNING if self.kind == ROTARY else {}), **self._command_words}

    @property
    def _command_words(self) -> dict[str, str]:
        """Units changed by its command only; the plant's equations already have the others."""
        return UNITS.get((self.file and self.file.command) or COMMANDS[0], {})

    def unit(self, unit: str) -> str:
        """Unit of this machine that corresponds to a unit of the thesis' axis."""
        return unit_in(unit, self.words)

    @cached_property
    def known(self) -> Mapping[str, Any]:
        """Parameters of plant and trials, as ``part.name``, in its units."""
        plant = in_units(tuple(plant_kernel(self.law, self.kind).parameters), self._command_words)
        sizes = in_units(SIZES, self.words)
        return {f"{PLANT}.{p.name}": p for p in plant} | {f"{TRIAL}.{p.name}": p for p in sizes}

    def given(self, known: Mapping[str, Any], complete: bool = False) -> dict[str, float]:
        """Values of the file, and of the user with priority, as ``part.name``.

        Only the `known` parameters are taken from the file. If `complete`, the user's have to be
        known, too. Raises BadParameter and BadParameters.
        """
        own = {
            name if "." in name else f"{PLANT}.{name}": float(value)
            for name, value in (self.parameters or {}).items()
        }
        found = self._from_file(self.file, known, own) if self.file else {}
        for name, value in own.items():
            if name in known:
                p = known[name]
                if not (math.isfinite(value) and p.minimum <= value <= p.maximum):
                    raise BadParameter(
                        f"{name} is {value:g} {p.unit}, expected a value within "
                        f"[{p.minimum:g}, {p.maximum:g}]"
                    )
            elif complete:
                owner = name.partition(".")[0]
                theirs = [k for k in known if k.startswith(f"{owner}.")]
                there = theirs or dict.fromkeys(f"{k.partition('.')[0]}.*" for k in known)
                raise BadParameter(
                    f"the rig with {self.law} has no {name!r}; it has {', '.join(there)}"
                    f"{did_you_mean(name, known)}"
                )
        return found | own

    def _from_file(
        self, file: ParameterFile, known: Mapping[str, Any], own: Mapping[str, float]
    ) -> dict[str, float]:
        plant = of_part(PLANT, known)
        others = Part(file.plant_name).parameters
        if (file.law or self.law) == self.law:  # only initial states are ignored: it begins at rest
            others = {n: p for n, p in others.items() if n.endswith("_start")}
        values = file.plant_values(plant, others)
        file.check_complete(plant, {*values, *of_part(PLANT, own)})
        found = {f"{PLANT}.{n}": v for n, v in values.items()}
        for part, given in file.rig.items():
            if part not in (TRIAL, *DEVICES):
                raise BadParameters(
                    f"{file.path}: [rig.{part}]: the rig has no such part; it has "
                    f"{', '.join(sorted((TRIAL, *DEVICES)))}"
                )
            if theirs := of_part(part, known):
                numbers = check_values(given, theirs, f"{file.path}: [rig.{part}]")
                found |= {f"{part}.{n}": v for n, v in numbers.items()}
        return found

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Parameters of the plant."""
        given = self.given(self.known)
        return of_part(PLANT, {n: given.get(n, p.default) for n, p in self.known.items()})

    @cached_property
    def sizes(self) -> Mapping[str, float]:
        """Values of `SIZES`; an unknown velocity is nan."""
        given = of_part(TRIAL, self.given(self.known))
        if self.is_axis:
            return {p.name: p.default for p in SIZES} | given
        static = [v for n, v in self.values.items() if n.partition("_")[0] in ("Fs", "Fc")]
        force = max(static, default=self.friction(1e-9))
        own = {"speed": math.nan, "force": force, "travel": math.inf} | given
        viscous = self.viscous
        sliding = self.friction(_HIGH) - _HIGH * viscous
        spare = _SPARE * self.limit - abs(self.values["offset"]) - sliding
        if "speed" not in given and viscous > 1e-9 * sliding / _HIGH and spare > 0.0:
            own["speed"] = min(sliding / viscous, spare / viscous, own["travel"] / _OVER_TRAVEL)
        return own

    # -- what follows from them --------------------------------------------------------------------

    @property
    def limit(self) -> float:
        """Force of a drive at the limit of its command [N]."""
        largest = self.values["voltage_limit"]
        return abs(self.values["gain"]) * largest if largest < UNLIMITED else math.inf

    @property
    def mass(self) -> float:
        """Total moving mass of a drive [kg]."""
        return self.values["J" if self.kind == ROTARY else "m"]

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
    def force_share(self) -> float:
        """Forces of its trials, relative to the thesis."""
        return self.sizes["force"] / BREAK_AWAY

    @cached_property
    def trials(self) -> dict[str, Trial]:
        """All trials by name, scaled to the machine."""
        speed, travel = self.sizes["speed"] / FASTEST, self.sizes["travel"]
        sizes = Sizes(speed, self.force_share, travel, self.words, self.is_axis)
        if not self.is_axis:
            load = partial(_load, self.values["gain"], self.values["offset"])
            sizes = replace(sizes, loading=load)
        return trials_of(sizes)

    def trial(self, trial: Trial | str) -> Trial:
        """The single trial of this name. Raises BadParameter, for a table too."""
        if isinstance(trial, Trial):
            return trial
        found = trials_named(trial, self.trials)
        if len(found) > 1:
            raise BadParameter(f"{trial!r} is a table of {len(found)} trials; run them one by one")
        return found[0]

    @property
    def defaults(self) -> dict[str, float]:
        """Values of sizes, instruments and regulators that differ from the thesis."""
        if self.is_axis:
            return {}
        # the rule gives the same gains for all slower lags, also without damping
        gain, damping = self.values["gain"], max(self.viscous, self.mass / FORCE_TIME)
        turns, counts = _ENCODERS[self.kind == ROTARY]
        return {
            **{f"{TRIAL}.{n}": v for n, v in self.sizes.items()},
            "encoder.p": turns,
            "encoder.counts": counts,
            **{f"load_cell.{p.name}": self.force_share * p.default for p in load_cell().parameters},
            **self._regulator("velocity_pid", velocity_gains(self.mass, gain, damping)),
            **self._regulator("force_pid", static_force_gains(gain)),
        }

    def _regulator(self, name: str, gains: Gains) -> dict[str, float]:
        values = (*gains, self.values["voltage_limit"])
        return dict(zip((f"{name}.{n}" for n in ("Kp", "Ki", "Kd", "limit")), values, strict=True))

    # -- trials that do not apply to it ------------------------------------------------------------

    def check_trial(self, trial: Trial, values: Mapping[str, float]) -> None:
        """Raise BadParameter for a trial that does not apply to a drive.

        `values` are all parameters of the rig, as ``part.name``.
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
        needed = self._force_for(trial)
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

    def _force_for(self, trial: Trial) -> float:
        """Force that a drive needs for a trial [N]."""
        reference = trial.reference()
        needed = float(np.abs(reference).max())
        if trial.control == VOLTAGE:
            return needed * abs(self.values["gain"])
        if trial.control == VELOCITY:
            rate = float(np.abs(np.diff(reference)).max()) / SAMPLE_TIME
            needed = max(self.friction(needed), self.sizes["force"]) + self.mass * rate
        return needed + abs(self.values["offset"])

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


def _load(gain: float, offset: float, rate: float, time: Vector) -> Vector:
    """Command that loads a drive at a rate [N/s] from t = 0."""
    return np.asarray((rate * time + offset) / gain)

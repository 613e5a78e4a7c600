"""An axis: its values in the compiled simulator, by name, and the data sheet they come from."""

from __future__ import annotations

import getpass
import hashlib
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

try:
    import numba
except ModuleNotFoundError:  # the same results, some hundred times slower

    def compiled(function):
        return function
else:
    # numba reuses compiled code until the function's own file changes, and does not notice changes
    # in functions that it calls: the folder of the code changes with any file of the worlds
    _content = hashlib.sha256(f"{numba.__version__} {os.environ.get('NUMBA_OPT')}".encode())
    for _file in sorted(Path(__file__).parent.glob("*.py")):
        _content.update(_file.read_bytes())
    FOLDER = Path(tempfile.gettempdir()) / f"worlds-{getpass.getuser()}-{_content.hexdigest()[:16]}"
    numba.config.CACHE_DIR = str(FOLDER)
    compiled = numba.njit(cache=True, error_model="numpy")


def record_type(*names):
    """Type of a record of numbers, whose names are its attributes."""
    return np.dtype((np.record, [(name, float) for name in names]))


# zero always means "not present"
AXIS = record_type(
    # bodies, kg (the rotor, reflected through the screw, belongs to the motor), and the spring
    # between them, N/m and N*s/m (without it they are one), with a gap, m
    "motor_mass", "block_mass", "spring", "spring_damping", "gap",
    "friction_at_motor",  # 1: all friction acts before the spring
    # the motor; 1: its force is gain*u, N/V, without an electrical part
    "is_drive", "gain", "kt", "ke", "R", "L",
    # share of R, its course (`progress`, or 3: heated by its own current), s, and the current, A,
    # that warms the winding by that share
    "r_drift", "r_form", "r_time", "r_current",
    # the amplifier: pure delay, lag (1: it acts twice) and moving mean, s
    "delay", "lag", "lag_twice", "window",
    # its limit, V (0 hard, 1 tanh, 2 sags with the current, ohm), and ripple of the mains, V and Hz
    "limit", "limit_form", "sag", "mains", "mains_frequency",
    "ramped",  # 1: the command is linear between its values, else it is held
    # friction: one of the laws and of the courses below, with the values of the parameter file
    "law", "fall", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs", "Kv",
    "least_speed",  # m/s, of the double: slower motion is rest for its set-valued law
    # shares of the dry and of the viscous part: half the difference of the two directions
    "asymmetry", "asymmetry_viscous",
    # swings with the position: m, rad, and the second harmonic's share of the first
    "periodic", "periodic_viscous", "period", "period_phase", "period_second",
    # changes along the travel (`along_travel`) and in time (`progress`), s
    "trend", "trend_viscous", "trend_form", "drift", "drift_viscous", "drift_form", "drift_time",
    # forces of the speed, N over (m/s)^2, ^3 and ^0.5; viscous force over 1 + thinning*|v|
    "quadratic", "cubic", "root", "thinning",
    "noise_growth",  # s/m, of the friction noise with the speed
    "texture_start",  # m, where the table of friction fixed to the position begins
    # forces against +x, N and N/m; cogging, N, ripple as a share of the motor's force or of the dry
    # friction, m, rad, and the second harmonic's share
    "load", "load_slope", "ripple", "ripple_of_current", "ripple_friction", "ripple_period",
    "ripple_phase", "ripple_second",
    # a position that holds the block, N and m
    "detent", "detent_place", "detent_width",
    # shares of the dry part after a reversal, and for each e-fold of rest, and their distances, m
    "memory", "memory_way", "ageing", "ageing_way",
    "bursts",  # N, pushes from outside at random times
    # a body on the block, kg, on a spring, N/m, with damping, N*s/m
    "resonator", "resonator_spring", "resonator_damping",
    # the encoder: counts, m (1: floor, else round), error within a signal period, and of the scale
    # at the end of the travel (0 quadratic along the travel, 1 one wave), all m
    "resolution", "floors", "interpolation", "signal_period", "scale_error", "scale_form",
    "travel", "duration",  # m, half; s
    # the controller: one of the loops below, gains of position and velocity, V, and a filter, s
    "loop", "position_gain", "gain_p", "gain_i", "gain_d", "most", "filter",
)  # fmt: skip
SET_VALUED, LUGRE, MODIFIED_LUGRE, ELASTO_PLASTIC, MAXWELL = range(5)
GAUSSIAN, EXPONENTIAL, LORENTZ, POLYNOMIAL = range(4)
OPEN, CASCADE, PID = range(3)

# the moving state; compiled code gets it from outside, since its records do not keep their memory
ELEMENTS = 4  # number of Maxwell's elements
STATE = np.dtype((np.record, [("z", float, (ELEMENTS,)), *((name, float) for name in (
    # friction: deflections; direction, farthest position in it, last reversal, time at rest, and
    # distance since then; present factors on the dry level and on the viscous force
    "direction", "extreme", "reversed_at", "rested", "slid", "dry", "viscous",
    # motor, block and the body on it; current and warmth of the winding; lags of the amplifier
    "x1", "v1", "x2", "v2", "xa", "va", "current", "warmth", "lag", "second_lag",
    # at the motor, V; ohm; decay of the current in half a substep
    "voltage", "resistance", "kept",
    "motor", "burst",  # N, the motor's force, and a push from outside
    "integral", "last_x", "last_v", "last_reference", "started",  # memory of the controller
))]))  # fmt: skip

# one row per logging period
LOG = record_type(
    "x", "current",  # m and A, at the period's start; all others are means of the period
    "command", "v", "a", "current_mean",  # V, m/s, m/s^2, A
    "dry", "friction",  # N, dry friction of the faultless law along this motion, and all of it
    # N, force of the command beyond that of the motion; the same from the current; and V, the
    # command beyond what the armature needs for that current
    "need", "need_force", "need_voltage",
)  # fmt: skip

Values = dict[str, float]
BALL_SCREW, DRIVE = "ball_screw", "drive"
# values that a data sheet may have wrong, by plant; kt and ke are one quantity and change together
UNCERTAIN = {
    BALL_SCREW: ("R", "kt", "m", "sigma2", "Fc", "Vs"),
    DRIVE: ("gain", "m", "sigma2", "Fc"),
}
TOLERANCE = 0.03


def blank():
    return np.zeros(1, AXIS)[0]


def changed(axis, changes):
    axis = axis.copy()
    for name, value in changes.items():
        axis[name] = value
    return axis


def mass_of(axis) -> float:
    """The mass of both bodies, kg."""
    return float(axis.motor_mass + axis.block_mass)


@dataclass(frozen=True)
class Axis:
    """A machine without any fault, by its data sheet."""

    plant: str
    law: str  # both as in a parameter file
    values: Values  # by the parameter file's names, SI
    formulation: int  # of friction in the simulator
    travel: float  # half of it, m
    most: float  # largest command, V
    fastest: float  # largest speed used, m/s

    @property
    def lead(self) -> float:
        """Travel per turn of the screw, or per pole pair of the drive, m."""
        return 1 / self.values["p"] if self.plant == BALL_SCREW else 0.024

    def command(self, speed: float) -> float:
        """What holds a speed, V."""
        v = self.values
        force = v["Fc"] + v["sigma2"] * speed
        if self.plant == DRIVE:
            return force / v["gain"]
        turn = 2 * math.pi * v["p"]
        return v["R"] * force / (v["kt"] * turn) + v["ke"] * turn * speed


def simulated(plant: str, values: Values):
    """A machine's values in the simulator; law and travel are not set."""
    par = changed(blank(), {n: v for n, v in values.items() if n in AXIS.names})
    par.block_mass, par.load, par.Kv = values["m"], values.get("offset", 0.0), 1e8
    if plant == BALL_SCREW:
        turn = 2 * math.pi * values["p"]
        par.motor_mass = values["Jm"] * turn**2
        par.kt, par.ke = values["kt"] * turn, values["ke"] * turn
    else:
        par.is_drive = 1.0
    return par


def double_of(axis: Axis, duration: float):
    """The axis with the law of its parameter file."""
    par = simulated(axis.plant, axis.values)
    par.law = SET_VALUED if axis.law == "classical" else LUGRE
    par.travel, par.duration = axis.travel, duration
    return par


def scaled(values: Values, name: str, factor: float) -> Values:
    """The values with one changed, and those that must change with it."""
    together = {"kt": ("kt", "ke"), "Fc": ("Fc", "Fs")}.get(name, (name,))
    return {n: v * factor if n in together else v for n, v in values.items()}


def misjudged(rng: np.random.Generator, axis: Axis, exact: float) -> tuple[Values, Values]:
    """Values of the data sheet, and factors by which two to four of them, or none, are wrong."""
    values, factors = dict(axis.values), {}
    if rng.uniform() >= exact:
        names = UNCERTAIN[axis.plant]
        count = int(rng.integers(2, min(4, len(names)) + 1))
        for name in rng.permutation(names)[:count]:
            factors[str(name)] = 1 + float(rng.uniform(-TOLERANCE, TOLERANCE))
            values = scaled(values, str(name), factors[str(name)])
    return values, factors

"""Section 2.4: which friction law shows which feature, Table 2.12.

The experiments are run with the true signals of the rig, because errors of instruments say nothing
on a law. The parameters are the nominal ones, which are the thesis' (Tables 2.3, 2.5, 2.7, 2.9).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np

from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.regulators import loading_voltage
from ballscrew.measurement.rig.trials import VOLTAGE, Trial, trials_named
from ballscrew.solver.arrays import Vector
from thesis.rows import Row, near

MEASURED = {1: 2.2, -1: -2.4}  # break-away forces by direction, Section 2.4.2 [N]
VISCOUS = 173.0  # measured sigma2, the mean of both directions, Table 2.3 [N*s/m]
STIFFNESS = 66967.231  # measured force over displacement before sliding, Table 2.9 [N/m]
RATE, LOAD = 0.25, 12.0  # of the slow loading [N/s], [N]; the block then slides at 4 mm/s
FALL = 1e-3  # least relative fall of friction after a peak: more than the error of the solver
CYCLE, HARMONICS = 2.0 * math.pi / 3.0, 8  # period of Table 2.11 [s]; more is the encoder's jitter
HOLDS = (7.0, 12.0, 17.0)  # ends of the holds of the staircase [s]

LAWS: dict[str, tuple[str, ...]] = {
    "classical": ("yes", "yes", "no", "no", "no"),
    "dahl": ("no", "conditional", "no", "no", "conditional"),
    "bliman_sorine": ("yes", "conditional", "no", "no", "no"),
    "lugre": ("yes", "yes", "yes", "yes", "yes"),
}
"""Table 2.12: break-away, viscous friction, lag, varying break-away, presliding."""

Truth = dict[str, Vector]


def _step(t: Vector) -> Vector:
    """The motor's force follows its voltage within 0.1 ms: a step to 1.5 N, Fig. 2.19."""
    none, all_of_it = loading_voltage(1.0, np.array([0.0, 1.5]))
    return np.where(t > 0, all_of_it - none, 0.0)


def _truth(law: str, trial: Trial) -> Truth:
    """True signals of a trial; an instrument or the screw out of range is an error."""
    record = run_trial(trial, law)
    if record.notes:
        raise AssertionError(f"{law}, {trial.name}: {record.notes[0]}")
    return dict(record.truth)


def _of_voltage(name: str, course: Callable[[Vector], Vector], length: float) -> Trial:
    return Trial(f"{name}/1", name, 1, VOLTAGE, name, length, course)


def peak(friction: Vector) -> tuple[float, float]:
    """The largest friction before its first fall, and the smallest after; NaN if it never falls."""
    highest = np.maximum.accumulate(friction)
    fallen = np.flatnonzero(friction < (1.0 - FALL) * highest)
    if not len(fallen):
        return math.nan, float(friction[-1])
    return float(highest[fallen[0]]), float(friction[fallen[0] :].min())


@cache
def break_away(law: str, direction: int) -> tuple[float, float]:
    """Peak and sliding friction under slow loading, in the direction of the load [N]."""
    slow = _of_voltage("slow-loading", lambda t: direction * loading_voltage(RATE, t), LOAD / RATE)
    return peak(direction * _truth(law, slow)["friction"])


def cycle(law: str) -> Vector:
    """Velocity and friction over one cycle of Table 2.11, by the harmonics of all but the first."""
    truth = _truth(law, trials_named("2.11")[0])
    later = truth["time"] >= CYCLE

    def basis(t: Vector) -> Vector:
        phase = 2 * np.pi / CYCLE * np.outer(t, np.arange(HARMONICS + 1))
        return np.hstack([np.cos(phase), np.sin(phase[:, 1:])])

    both = np.column_stack([truth["v"][later], truth["friction"][later]])
    fitted = np.linalg.lstsq(basis(truth["time"][later]), both)[0]
    return np.asarray((basis(np.linspace(0.0, CYCLE, 401)) @ fitted).T)


@cache
def rates(law: str) -> Vector:
    """Loading rates [N/s] and break-away forces [N], shape (2, 20); NaN without a peak."""
    trials = trials_named("loading-rate")
    peaks = [peak(_truth(law, t)["friction"])[0] for t in trials]
    return np.array([[t.level for t in trials], peaks])


def _drop(law: str) -> float:
    """Peak over the sliding friction that follows, less 1; 0 without a peak."""
    both = [break_away(law, direction) for direction in MEASURED]
    return min(0.0 if math.isnan(high) else high / low - 1.0 for high, low in both)


def _off_measured(law: str) -> float:
    return max(abs(break_away(law, d)[0] / abs(force) - 1.0) for d, force in MEASURED.items())


def _off_viscous(law: str, added: float = 0.0) -> float:
    """Largest deviation of the slope of steady friction from the measured one."""
    found = []
    for trial in trials_named("viscous"):
        truth = _truth(law, trial)
        half = len(truth["v"]) // 2
        found.append((truth["v"][half:].mean(), truth["friction"][half:].mean()))
    speed, friction = np.array(found).T
    sides = [speed > 0.0, speed < 0.0]
    slopes = [np.polyfit(speed[side], friction[side], 1)[0] for side in sides]
    return float(max(abs((s + added) / VISCOUS - 1.0) for s in slopes))


def _lag(law: str) -> float:
    """Friction at rising less that at falling velocity, averaged over a cycle [N]."""
    v, friction = cycle(law)
    return float(np.trapezoid(friction, v) / np.ptp(v))


def _fall(law: str) -> float:
    """Fall of the break-away force from the slowest to the fastest loading; 0 without a peak."""
    peaks = rates(law)[1]
    return 0.0 if np.isnan(peaks).any() else float(1.0 - peaks[-1] / peaks[0])


@cache
def _holds(law: str) -> tuple[Vector, Vector]:
    """Displacement [m] and friction [N] at the three holds of the staircase."""
    truth = _truth(law, trials_named("presliding")[0])
    at = np.searchsorted(truth["time"], HOLDS) - 1
    return truth["x"][at], truth["friction"][at]


def _off_holds(law: str) -> Vector:
    x, friction = _holds(law)
    return np.asarray(np.abs(STIFFNESS * x / friction - 1.0))


def _off_equations() -> float:
    """Largest deviation of the displacements of LuGre from -Fs/sigma0 ln(1 - F/Fs)."""
    (x, friction), fs = _holds("lugre"), 2.35
    exact = -fs / STIFFNESS * np.log(1.0 - friction / fs)
    return float(np.max(np.abs(x / exact - 1.0)))


def _rise(law: str) -> float:
    """Time from 10 to 90 % of the displacement after a step of force [s]."""
    truth = _truth(law, _of_voltage("force-at-once", _step, 3.0))
    share = truth["x"] / truth["x"][-1]
    end = int(np.argmax(share >= share[-1])) + 1
    course = np.maximum.accumulate(share[:end]), truth["time"][:end]
    return float(np.interp(0.9, *course) - np.interp(0.1, *course))


def _at_least(threshold: float) -> dict[str, tuple[float, float]]:
    return {"yes": (threshold, math.inf), "no": (-math.inf, threshold)}


PRESLIDING = (
    "Table 2.9's stiffness is force over displacement (Eq. 2.14), which is the same at 0.5, 1 and "
    "1.5 N: a spring. The law yields as the force nears its largest, so a stiffness that is put in "
    "as that of the unloaded law moves too far (next rows)."
)


def _rows(law: str, told: tuple[str, ...]) -> list[Row]:
    """The five features of one law of Table 2.12."""
    first, viscous, lag, varying, presliding = told
    added, words = (0.0, "") if viscous == "yes" else (VISCOUS, ", with that many added")
    peaks = Row("2.4.2", f"{law}: peaks off the measured 2.2 and -2.4 N, as a share of at most 0.1",
                first, partial(_off_measured, law), (0.0, 0.1))  # fmt: skip
    return [
        Row("2.4.2", f"{law}: friction peaks above the sliding friction, by a share of at least "
            "0.05", first, partial(_drop, law), _at_least(0.05)[first]),
        *([peaks] if first == "yes" else []),
        Row("2.4.3", f"{law}: slope of steady friction off the measured 173 N*s/m{words}, as a "
            "share of at most 0.2", viscous, partial(_off_viscous, law, added), (0.0, 0.2)),
        Row("2.4.4", f"{law}: friction is higher while the velocity rises, by at least 0.01 [N]",
            lag, partial(_lag, law), _at_least(0.01)[lag]),
        Row("2.4.5", f"{law}: the break-away force falls with the loading rate, by a share of at "
            "least 0.02", varying, partial(_fall, law), _at_least(0.02)[varying]),
        Row("2.4.6", f"{law}: holds of three at which the displacement is within 20 % of the "
            "measured one", presliding, lambda: (_off_holds(law) <= 0.2).sum(),
            {"yes": (3, 3), "conditional": (1, 2), "no": (0, 0)}[presliding],
            PRESLIDING if law == "lugre" else ""),
    ]  # fmt: skip


LUGRE = (
    Row("2.4.6", "lugre: displacement at 1.5 N off the measured one, as a share", "",
        lambda: float(_off_holds("lugre")[-1])),
    Row("2.4.6", "lugre: displacements off -Fs/sigma0 ln(1 - F/Fs), as a share", "",
        _off_equations, (0.0, 0.02)),
    Row("2.4.6", "dahl: displacement at 1.5 N off the measured one, as a share", "",
        lambda: float(_off_holds("dahl")[-1])),
    near("2.4.2", "lugre: largest deviation of the break-away force, 'about 5 %'", 0.05, 0.025,
         lambda: _off_measured("lugre")),
    Row("2.4.2", "lugre and classical 'reproduce the identical break-away force': their ratio "
        "less 1", "0", lambda: break_away("lugre", 1)[0] / break_away("classical", 1)[0] - 1.0,
        (-1e-3, 1e-3)),
    Row("2.4.5", "lugre: the break-away force 'won't enter the interval (-Fc, Fc)': the least "
        "over Fc", "above 1", lambda: float(rates("lugre")[1].min()) / 1.284, (1.0, math.inf)),
    Row("2.4.6, Fig. 2.19", "dahl follows a step slowly: its rise time over that of lugre",
        "above 1", lambda: _rise("dahl") / _rise("lugre"), (1.0, math.inf),
        "On the same rig the motor's back-EMF damps both."),
)  # fmt: skip

SECTIONS = {"T": (*(row for law in LAWS for row in _rows(law, LAWS[law])), *LUGRE)}

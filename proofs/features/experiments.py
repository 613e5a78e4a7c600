"""The five experiments of Section 2.4 on every friction law, and the resulting table.

All decisions use the true signals of the trials, because errors of instruments give no information
on a law. Parameters are the given ones, identified from records, or the nominal ones of the laws,
which are from the thesis (Tables 2.3, 2.5, 2.7, 2.9). Laws that are not in the thesis use its
values as described in their files. The source of each value is in ``features.json``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.program import PLANT, plant_kernel, program_kernel
from ballscrew.measurement.rig.record import TrialRecord
from ballscrew.measurement.rig.regulators import loading_voltage
from ballscrew.measurement.rig.trials import FORCE, VELOCITY, VOLTAGE, Trial, trials_named

from .observations import ForceCurve, ForceStep, Observations, Peak

Vector = npt.NDArray[np.float64]
SLOW_RATE = 0.25
"""Loading rate for the break-away force: the slope in the staircase of Section 2.4.1 [N/s]."""


LOAD_TO = 12.0
"""Quasi-static force at its end [N]: the block then slides at 4 mm/s, beyond the Stribeck fall."""


STEP_FORCE, STEP_TIME = 1.5, 3.0
FALL = 1e-3
"""Least relative fall of friction after a maximum: more than the error of the solver."""


CYCLE = 2 * math.pi / 3.0
"""Period of Table 2.11 [s]."""


HARMONICS = 8
"""Harmonics of the cycle that are kept: the jitter from the encoder's steps is faster."""


def observe(law: str, parameters: Mapping[str, float] | None = None) -> Observations:
    """Run all experiments on one law.

    Parameters
    ----------
    law : str
        One of `plant.LAWS`.
    parameters : mapping of str to float, optional
        Values other than nominal, as in `bench.run_trial`.

    Returns
    -------
    Observations

    Raises
    ------
    UnknownName, BadParameter
        For invalid names and values.
    IntegrationError
        If a motion cannot be computed.
    """
    notes: list[str] = []
    # for about fifty trials, a fifth of a second is worth it
    for kernel in (plant_kernel(law), *map(program_kernel, (FORCE, VELOCITY, VOLTAGE))):
        kernel.compile()

    def run(trial: Trial) -> TrialRecord:
        record = run_trial(trial, law, parameters)
        notes.extend(f"{trial.name}: {note}" for note in record.notes)
        return record

    forwards, backwards = (_peak(run(_slow_loading(d)).truth["friction"], d) for d in (1, -1))
    steps = [_force_step(run(t)) for t in trials_named("2.10")]
    steady = [_steady(run(t)) for t in trials_named("viscous")]
    cycle = _cycle(run(trials_named("2.11")[0]).truth)
    loading = [run(t) for t in trials_named("loading-rate")]
    peaks = [_peak(r.truth["friction"], 1).force for r in loading]
    staircase = run(trials_named("presliding")[0])
    step = run(_force_at_once())
    return Observations(
        law,
        _law_parameters(law, step),
        forwards,
        backwards,
        steps,
        np.array([s[0] for s in steady]),
        np.array([s[1] for s in steady]),
        *cycle,
        np.array([r.trial.level for r in loading]),
        np.array([math.nan if p is None else p for p in peaks]),
        _course(staircase),
        np.searchsorted(staircase.truth["time"], (7.0, 12.0, 17.0)) - 1,
        _course(step),
        notes,
    )


def _slow_loading(direction: int) -> Trial:
    way = "forwards" if direction > 0 else "backwards"
    return Trial(
        f"slow-loading/{way}",
        "slow-loading",
        1 if direction > 0 else 2,
        VOLTAGE,
        f"voltage ramp that loads the block {way} at {SLOW_RATE:g} N/s",
        LOAD_TO / SLOW_RATE,
        partial(_ramp, direction),
        level=direction * SLOW_RATE,
    )


def _ramp(direction: int, t: Vector) -> Vector:
    return direction * loading_voltage(SLOW_RATE, t)


def _force_at_once() -> Trial:
    """Fig. 2.19's step: the motor's force follows its voltage within 0.1 ms."""
    return Trial(
        "force-at-once/1",
        "force-at-once",
        1,
        VOLTAGE,
        f"step of the motor's force to {STEP_FORCE:g} N",
        STEP_TIME,
        _step,
        level=STEP_FORCE,
    )


def _step(t: Vector) -> Vector:
    none, all_of_it = loading_voltage(1.0, np.array([0.0, STEP_FORCE]))
    return np.where(t > 0, all_of_it - none, 0.0)


def _peak(friction: Vector, direction: int) -> Peak:
    """The largest friction before its first fall, and the smallest after that."""
    along = direction * friction
    highest = np.maximum.accumulate(along)
    fallen = np.flatnonzero(along < (1 - FALL) * highest)
    if not len(fallen):
        return Peak(None, float(along[-1]))
    return Peak(float(highest[fallen[0]]), float(along[fallen[0] :].min()))


def _force_step(record: TrialRecord) -> ForceStep:
    x = record.truth["x"]
    return ForceStep(record.trial.level, float(x[-1] - x[-201]))


def _steady(record: TrialRecord) -> tuple[float, float]:
    half = len(record.truth["v"]) // 2
    return float(record.truth["v"][half:].mean()), float(record.truth["friction"][half:].mean())


def _cycle(truth: Mapping[str, Vector]) -> tuple[Vector, Vector]:
    """Velocity and friction over one cycle, from the harmonics of all cycles except the first."""
    time = truth["time"]
    later = time >= CYCLE

    def basis(t: Vector) -> Vector:
        phase = 2 * np.pi / CYCLE * np.outer(t, np.arange(HARMONICS + 1))
        return np.hstack([np.cos(phase), np.sin(phase[:, 1:])])

    grid = basis(np.linspace(0.0, CYCLE, 401))
    both = np.column_stack([truth["v"][later], truth["friction"][later]])
    fitted = grid @ np.linalg.lstsq(basis(time[later]), both)[0]
    return fitted[:, 0], fitted[:, 1]


def _course(record: TrialRecord) -> ForceCurve:
    truth = record.truth
    return ForceCurve(truth["time"], truth["friction"], truth["x"])


def _law_parameters(law: str, record: TrialRecord) -> dict[str, float]:
    """Parameters of the law only, which follow those of the drive."""
    from ballscrew.plant.ball_screw import PARAMETERS as DRIVE

    drive = {p.name for p in DRIVE} | {"voltage_limit", "current_limit"}
    names = [p.name for p in plant_kernel(law).parameters if p.name not in drive]
    return {name: record.parameters[f"{PLANT}.{name}"] for name in names}

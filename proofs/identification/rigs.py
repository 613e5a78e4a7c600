"""Random rigs of known truth, identified: for the proof and for tests."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.identification.fitted_law import LAWS
from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.intervals import Interval
from ballscrew.measurement.identification.layout import lay_out
from ballscrew.measurement.records.reading import FORCE_RECORD
from ballscrew.measurement.records.record import Record
from ballscrew.measurement.records.rig_trial import described
from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.trials import TRIALS
from ballscrew.plant.instruments.acquisition import SAMPLE_TIME
from ballscrew.plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from identification.records import Trial, constant_velocity, record_of, sine_velocity, slow_load

# Laws with prescribed motions; the others' records come from the rig: the force causes the motion.
PRESCRIBED = tuple(n for n in LAWS if n not in ("maxwell_slip", "classical"))
_SEEDED = [n for n in LAWS if n != "classical"]  # a law's index is part of its seed
_SEEDED.insert(7, "classical")  # also when there are more laws
MIXED = "mixed"
SUBSETS = (MIXED, "2.4", MIXED, "2.6", MIXED, "2.3.1", MIXED, "2.8")
_POOL = ("2.2", "2.3.1", "2.4", "2.6", "2.8", "2.10", "2.11", "presliding", "loading-rate")


@dataclass(frozen=True)
class Outcome:
    """One parameter of one rig: true value, result, and whether the interval contains the truth."""

    law: str
    seed: int
    trials: str
    parameter: str
    truth: float
    value: float
    low: float | None
    high: float | None
    identified: bool
    covered: bool
    seconds: float


def random_truth(law: str, random: np.random.Generator) -> dict[str, float]:
    """Parameters around those of the thesis, by a factor of up to about one and a half."""

    def near(value: float) -> float:
        return value * math.exp(float(np.clip(random.normal(0.0, 0.25), -0.6, 0.6)))

    def lugre() -> dict[str, float]:
        fc = near(1.284)
        bristles = {"sigma0": near(66967.0), "sigma1": near(344.56), "sigma2": near(173.0)}
        peak = fc * random.uniform(1.3, 2.2)
        return bristles | {"Fc": fc, "Fs": peak, "Vs": near(1.14e-3)}

    if law == "dahl":
        return {"sigma": near(87750.0), "Fc": near(2.0), "alpha": random.uniform(0.7, 1.8)}
    if law == "bliman_sorine":
        fc, f2 = near(2.06), near(7.0)
        return {"f1": fc + f2, "f2": f2, "eps_f": near(1.5e-4), "eta": random.uniform(0.5, 0.85)}
    if law == "directional_lugre":
        both = {side: lugre() for side in ("pos", "neg")}
        return {f"{n}_{side}": v for side, values in both.items() for n, v in values.items()}
    if law == "classical":
        return {n: v for n, v in lugre().items() if n not in ("sigma0", "sigma1")}
    if law == "maxwell_slip":
        static = lugre()
        elements = {p.name: near(p.default) for p in MAXWELL_SLIP if p.name not in static}
        whole = sum(v for n, v in elements.items() if n.startswith("alpha"))
        shares = {n: v / whole for n, v in elements.items() if n.startswith("alpha")}
        return elements | shares | {n: static[n] for n in ("sigma2", "Fc", "Fs", "Vs")}
    return lugre()


def random_trials(random: np.random.Generator) -> list[Trial]:
    """Sixteen trials similar to Tables 2.4, 2.6, 2.8 and to the Stribeck curve."""
    trials = []
    for sign in (1.0, -1.0):
        rise = random.uniform(0.02, 0.1)
        trials += [constant_velocity(sign * s, 2.0, rise) for s in (2e-3, 3.5e-3, 5.5e-3)]
        trials += [sine_velocity(sign * 1e-3, w, math.pi / w) for w in (1.0, 0.5, 0.25)]
        trials.append(slow_load(sign * random.uniform(5e-6, 2e-5)))
        trials.append(sine_velocity(sign * 2e-3, 1.0, 4 * math.pi))
    return trials


def identify_random_rig(law: str, seed: int) -> list[Outcome]:
    """Make a rig and its records from a seed, identify it, compare with the truth."""
    random = np.random.default_rng([seed, _SEEDED.index(law)])
    truth = random_truth(law, random)
    delay = 0.005 / math.sqrt(12) * random.standard_normal()
    noise = random.uniform(0.02, 0.05)
    records = [record_of(t, law, truth, random, delay, noise) for t in random_trials(random)]
    return _fitted(law, seed, "prescribed motion", truth, records)


def identify_accelerated_rig(law: str, seed: int) -> list[Outcome]:
    """The same with motions that accelerate, the mass unknown, and the force late in half of them.

    All results of `identify` are compared: the law, the mass and the delay.
    """
    random = np.random.default_rng([seed, _SEEDED.index(law), 2])
    truth = random_truth(law, random)
    mass = 3.0 * math.exp(float(random.normal(0.0, 0.4)))
    late = 0.005 * float(random.uniform(-4.0, 4.0)) * (seed % 2)
    delay = late + 0.005 / math.sqrt(12) * float(random.standard_normal())
    trials = []
    for _ in range(4):
        sizes, phases = random.uniform(2e-3, 8e-3, 3), random.uniform(0, 2 * math.pi, 3)
        omegas = 2 * math.pi * random.uniform([0.4, 1.0, 2.0], [0.8, 1.8, 3.0])
        trials.append(Trial("shaken", 6.0, partial(_shaken, sizes, phases, omegas)))
    noise = random.uniform(0.02, 0.05)
    records = [record_of(t, law, truth, random, delay, noise, mass) for t in trials]
    began = time.perf_counter()
    found = identify(records, law, mass=True)
    shift = {"time_shift": found.time_shift} if found.time_shift else {}
    truth |= {"m": mass, "time_shift": delay}
    return _outcomes(law, seed, "accelerated", truth, found.parameters | shift, began)


Vector = npt.NDArray[np.float64]


def _shaken(sizes: Vector, phases: Vector, omegas: Vector, t: Vector) -> Vector:
    """Sines that begin smoothly from rest [m]."""
    waves = sizes[:, None] * np.sin(omegas[:, None] * t + phases[:, None])
    return np.asarray((1 - np.exp(-t / 0.3)) ** 3 * waves.sum(axis=0))


def identify_closed_loop_rig(law: str, seed: int) -> list[Outcome]:
    """The same with records of the virtual rig, with its controllers, counts and filters.

    The trials are of one of the thesis' tables, or of all.
    """
    random = np.random.default_rng([seed, _SEEDED.index(law), 1])
    truth = random_truth(law, random)
    subset = SUBSETS[seed % len(SUBSETS)]
    names = [n for n, t in TRIALS.items() if t.table in (_POOL if subset == MIXED else (subset,))]
    count = min(int(random.integers(6, 13)), len(names))
    records = []
    for k in sorted(random.choice(len(names), count, replace=False)):
        made = run_trial(names[k], law, truth, seed=seed)
        signals = {n: v for n, v in made.record.items() if n in FORCE_RECORD.columns}
        record = described(Record(names[k], signals, SAMPLE_TIME), made.description())
        if np.ptp(record.position) > 0:  # others are rejected when they are read
            records.append(record)
    return _fitted(law, seed, subset, truth, records)


def _fitted(
    law: str, seed: int, trials: str, truth: dict[str, float], records: list[Record]
) -> list[Outcome]:
    began = time.perf_counter()
    intervals = fit_along(records, law, lay_out(records)).intervals
    return _outcomes(law, seed, trials, truth, intervals, began)


def _outcomes(
    law: str,
    seed: int,
    trials: str,
    truth: dict[str, float],
    intervals: dict[str, Interval],
    began: float,
) -> list[Outcome]:
    seconds, outcomes = time.perf_counter() - began, []
    for name, i in intervals.items():
        low = -math.inf if i.low is None else i.low
        high = math.inf if i.high is None else i.high
        known = (i.value, i.low, i.high, i.identified, low <= truth[name] <= high, seconds)
        outcomes.append(Outcome(law, seed, trials, name, truth[name], *known))
    return outcomes

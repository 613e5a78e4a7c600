"""The true parameters of random rigs are within the stated intervals.

By law and parameter, how many of the stated 95 % intervals contain the truth, with the binomial
interval of that share. "Closed loop" are records of the virtual rig with random parameters of the
law, identified from 6 to 12 random trials of the thesis' tables, in half of the rigs from a single
table. "Prescribed motion" are laws along given motions; load-cell noise, delay between force and
motion and the scale of the fine position are random for every rig. "Mass fitted" are laws along
motions that accelerate, with an unknown mass and, in half of them, a force that is up to four
samples late or early: all results of `identify` for law, mass and time are counted.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from itertools import groupby

import numpy as np
from runner import Row, lower, seeds, upper

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.intervals import Interval
from ballscrew.measurement.identification.layout import lay_out
from ballscrew.measurement.records.reading import FORCE_RECORD
from ballscrew.measurement.records.record import Record
from ballscrew.measurement.records.rig_trial import described
from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.trials import TRIALS
from ballscrew.plant import LAWS
from ballscrew.plant.instruments.acquisition import SAMPLE_TIME
from ballscrew.plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ballscrew.solver.arrays import Vector
from identification.records import Trial, constant_velocity, record_of, sine_velocity, slow_load

STATED = 0.95
RIGS = 30  # of each law and group
OF_A_MISS = ("seed", "parameter", "truth", "value", "low", "high")
# Laws with prescribed motions; the others' records come from the rig: the force causes the motion.
PRESCRIBED = tuple(n for n in LAWS if n != "maxwell_slip" and not n.endswith("classical"))
# A law's index is part of its seed; a new law is added at the end.
_SEEDED = [n for n in LAWS if not n.endswith("classical")] + ["classical", "directional_classical"]
MIXED = "mixed"
SUBSETS = (MIXED, "2.4", MIXED, "2.6", MIXED, "2.3.1", MIXED, "2.8")
_POOL = ("2.2", "2.3.1", "2.4", "2.6", "2.8", "2.10", "2.11", "presliding", "loading-rate")


Truth, Random, Intervals = dict[str, float], np.random.Generator, dict[str, Interval]


def random_truth(law: str, random: Random) -> Truth:
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
    if law.startswith("directional_"):
        both = {side: random_truth(law.split("_")[1], random) for side in ("pos", "neg")}
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


def random_trials(random: Random) -> list[Trial]:
    """Sixteen trials similar to Tables 2.4, 2.6, 2.8 and to the Stribeck curve."""
    trials = []
    for sign in (1.0, -1.0):
        rise = random.uniform(0.02, 0.1)
        trials += [constant_velocity(sign * s, 2.0, rise) for s in (2e-3, 3.5e-3, 5.5e-3)]
        trials += [sine_velocity(sign * 1e-3, w, math.pi / w) for w in (1.0, 0.5, 0.25)]
        trials.append(slow_load(sign * random.uniform(5e-6, 2e-5)))
        trials.append(sine_velocity(sign * 2e-3, 1.0, 4 * math.pi))
    return trials


def prescribed_motion(law: str, seed: int, truth: Truth, random: Random) -> Intervals:
    """What is identified from records along given motions."""
    delay = 0.005 / math.sqrt(12) * random.standard_normal()
    noise = random.uniform(0.02, 0.05)
    records = [record_of(t, law, truth, random, delay, noise) for t in random_trials(random)]
    return fit_along(records, law, lay_out(records)).intervals


def mass_fitted(law: str, seed: int, truth: Truth, random: Random) -> Intervals:
    """The same with motions that accelerate, the mass unknown, and the force late in half of them.

    All results of `identify` are compared: the law, the mass and the delay.
    """
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
    found = identify(records, law, mass=True)
    shift = {"time_shift": found.time_shift} if found.time_shift else {}
    truth |= {"m": mass, "time_shift": delay}
    return found.parameters | shift


def _shaken(sizes: Vector, phases: Vector, omegas: Vector, t: Vector) -> Vector:
    """Sines that begin smoothly from rest [m]."""
    waves = sizes[:, None] * np.sin(omegas[:, None] * t + phases[:, None])
    return np.asarray((1 - np.exp(-t / 0.3)) ** 3 * waves.sum(axis=0))


def closed_loop(law: str, seed: int, truth: Truth, random: Random) -> Intervals:
    """The same with records of the virtual rig, with its controllers, counts and filters.

    The trials are of one of the thesis' tables, or of all.
    """
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
    return fit_along(records, law, lay_out(records)).intervals


GROUPS = {  # with a number that is part of the seed
    "closed_loop": (closed_loop, 1),
    "prescribed_motion": (prescribed_motion, 0),
    "mass_fitted": (mass_fitted, 2),
}


def tasks(asked: Namespace) -> dict[str, tuple[str, str, int]]:
    pairs = [(g, law) for g in GROUPS for law in (LAWS if g == "closed_loop" else PRESCRIBED)]
    drawn = seeds(asked, RIGS, 0)
    return {f"{g}, {law}, {seed}": (g, law, seed) for g, law in pairs for seed in drawn}


def trial(group: str, law: str, seed: int) -> list[Row]:
    """Make a rig and its records, identify it, compare each parameter with the truth."""
    identified, own = GROUPS[group]
    random = np.random.default_rng([seed, _SEEDED.index(law), own])
    truth, rows = random_truth(law, random), []
    for name, i in identified(law, seed, truth, random).items():
        low = -math.inf if i.low is None else i.low
        high = math.inf if i.high is None else i.high
        row = {"group": group, "law": law, "seed": seed, "parameter": name, "truth": truth[name]}
        row |= {"value": i.value, "low": i.low, "high": i.high}
        rows.append(row | {"covered": bool(low <= truth[name] <= high)})
    return rows


def of_law(rows: Sequence[Row]) -> Row:
    parameters = {}
    for name in dict.fromkeys(r["parameter"] for r in rows):
        covered = [r["covered"] for r in rows if r["parameter"] == name]
        hits, count, tail = sum(covered), len(covered), (1 - STATED) / 2
        share = [round(bound(hits, count, 1 - tail), 4) for bound in (lower, upper)]
        parameters[name] = {"rigs": count, "covered": hits, "share_95": share}
    return {
        "not_held_by": [n for n, found in parameters.items() if found["share_95"][1] < STATED],
        "seeds": [min(r["seed"] for r in rows), max(r["seed"] for r in rows) + 1],
        "parameters": parameters,
        "misses": [{k: r[k] for k in OF_A_MISS} for r in rows if not r["covered"]],
    }


def report(found: Sequence[list[Row]]) -> Row:
    groups: Row = {"stated": STATED} | {group: {} for group in GROUPS}
    rows = [row for some in found for row in some]
    for (group, law), some in groupby(rows, key=lambda r: (r["group"], r["law"])):
        groups[group][law] = of_law([*some])
    return groups | {"holds": not any(law["not_held_by"] for law in laws_of(groups))}


def laws_of(report: Row) -> list[Row]:
    return [law for group in GROUPS for law in report[group].values()]


def says(report: Row) -> str:
    some = [p for law in laws_of(report) for p in law["parameters"].values()]
    covered, rigs = (sum(p[k] for p in some) for k in ("covered", "rigs"))
    less = ", ".join(name for law in laws_of(report) for name in law["not_held_by"])
    few = f"; fewer than stated for {less}" if less else ""
    return f"{covered} of {rigs} intervals contain the true value ({covered / rigs:.1%}){few}"

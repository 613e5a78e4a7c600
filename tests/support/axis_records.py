"""Records of the thesis' axis with a large, clearly visible effect.

The axis is simulated with `proofs/worlds`, which imports nothing of this program.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from diagnosed import NOMINAL
from scipy.signal import lfilter
from world_runs import PERIOD, TURN, nominal_axis, run
from worlds.axis import changed

from ballscrew.measurement.records.reading import check_record
from ballscrew.measurement.records.record import Record

COUNT = 1e-3 / 512  # step of the encoder [m]
NOISE_TIME = 0.01  # s
SUBSTEPS = 50
NOTCH = {"detent": 1.0, "detent_place": 0.002, "detent_width": 0.0005}  # no cause has this form


def gap(width: float) -> dict[str, float]:
    """A gap between screw and block [m], and the contact stiffness."""
    return {"gap": width, "spring": 2e7, "spring_damping": 4.5e3}


def friction_noise(seed: int, count: int) -> np.ndarray:
    """Noise whose correlation falls exponentially, 2 % of the Coulomb force rms [N]."""
    kept, rms = math.exp(-PERIOD / NOISE_TIME), 0.02 * NOMINAL["Fc"]
    white = rms * np.random.default_rng(seed).standard_normal(count)
    white[1:] *= math.sqrt(1 - kept**2)
    return lfilter([1.0], [1.0, -kept], white)


def to_and_fro(count: int) -> np.ndarray:
    """A voltage that moves the axis in both directions and at many speeds."""
    time = np.arange(count) * PERIOD
    return 3.0 * np.sin(2 * math.pi * 0.7 * time) + 1.5 * np.sin(2 * math.pi * 1.9 * time + 1)


def moved(changes: Mapping[str, float], u: np.ndarray, force: np.ndarray) -> np.ndarray:
    """The simulator's log, one row per sample, under a voltage [V] and a force against +x [N].

    `changes` are differences from the nominal axis, by the simulator's names.
    """
    double = nominal_axis()
    double.motor_mass, double.ke = NOMINAL["Jm"] * TURN**2, NOMINAL["ke"] * TURN
    double.duration = len(u) * PERIOD
    return run(changed(double, changes), u, double, SUBSTEPS, force)


def signals_of(log: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of a record: time, voltage, quantized position, current."""
    counted = np.floor(log["x"] / COUNT) * COUNT
    return {"time": np.arange(len(u)) * PERIOD, "u": u, "x": counted, "i": log["current"]}


def strong_record(
    changes: Mapping[str, float], *, with_current: bool = False, samples: int = 12_000
) -> Record:
    """Twelve seconds of motion in both directions with these values changed."""
    u = to_and_fro(samples)
    signals = signals_of(moved(changes, u, friction_noise(3, samples)), u)
    return check_record("made", {n: s for n, s in signals.items() if with_current or n != "i"})


def write_strong(changes: Mapping[str, float], folder: Path) -> tuple[Path, Path]:
    """Write ``record.csv``, and ``believed.toml`` with the axis without the effect."""
    folder.mkdir(parents=True, exist_ok=True)
    record, believed = folder / "record.csv", folder / "believed.toml"
    signals = strong_record(changes).signals
    table = np.stack(list(signals.values()), 1)
    np.savetxt(record, table, fmt="%.9g", delimiter=",", header=",".join(signals), comments="")
    lines = ['law = "modified_lugre"', "", "[plant]"]
    lines += [f"{name} = {value!r}" for name, value in NOMINAL.items()]
    believed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return record, believed

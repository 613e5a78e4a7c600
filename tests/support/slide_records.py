"""Records of a slide on a prescribed motion: the force is Newton's law, typed by hand.

No simulator takes part, and nothing of this program.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ballscrew.measurement.diagnosis.model import Drive
from ballscrew.measurement.records.reading import check_record
from ballscrew.measurement.records.record import Record

STEP, FINE = 1e-3, 10  # s between samples; parts of a step over which the force is averaged
MASS, COULOMB, VISCOUS = 40.0, 80.0, 200.0
VALUES = {"m": MASS, "gain": 1.0, "offset": 0.0, "Fc": COULOMB, "Fs": COULOMB, "Vs": 0.01}
VALUES |= {"sigma2": VISCOUS}
SWINGS = ((0.1, 2.0, 0.0), (0.02, 5.3, 1.0), (0.006, 13.0, 0.4))  # m, rad/s, rad
PERIOD = 0.02  # m, of what varies with position

Force = Callable[..., np.ndarray]

# N against motion in +x, of time, position, velocity and acceleration
EFFECTS: dict[str, Force] = {
    "unmodelled_inertia": lambda t, x, v, a: 10.0 * a,
    "torque_ripple": lambda t, x, v, a: 12.0 * np.cos(2 * np.pi * x / PERIOD),
    "direction_asymmetry": lambda t, x, v, a: 0.2 * np.abs(COULOMB * np.sign(v) + VISCOUS * v),
    "position_periodic_friction": lambda t, x, v, a: (
        0.2 * COULOMB * np.cos(2 * np.pi * x / PERIOD) * np.sign(v)
    ),
    "load_bias": lambda t, x, v, a: np.full(len(t), 8.0),
    "a bump": lambda t, x, v, a: 25.0 * np.exp(-(((x - 0.03) / 0.012) ** 2)),
}


def believed() -> Drive:
    """The slide without any effect, its values known to some per cent."""
    return Drive("drive", "classical", dict(VALUES), {"m": 0.03, "Fc": 0.05, "sigma2": 0.05})


def slide_record(*effects: str, seed: int = 1, noise: float = 1.0, count: float = 1e-6) -> Record:
    """Eight seconds to and fro, with a white noise of the force [N] and an encoder's count [m]."""
    time = STEP / FINE * (np.arange(8_000 * FINE) + 0.5)
    x, v, a = (sum(parts) for parts in zip(*(swing(time, *s) for s in SWINGS), strict=True))
    force = MASS * a + COULOMB * np.sign(v) + VISCOUS * v
    force = force + sum(EFFECTS[name](time, x, v, a) for name in effects)
    u = force.reshape(-1, FINE).mean(axis=1)
    u += noise * np.random.default_rng(seed).standard_normal(len(u))
    samples = STEP * np.arange(len(u))
    x = sum(swing(samples, *s)[0] for s in SWINGS)
    signals = {"time": samples, "u": u, "x": np.round(x / count) * count}
    return check_record("made", signals, "force")


def swing(time, size, rate, phase):
    """Position, velocity and acceleration of a sine."""
    angle = rate * time + phase
    return size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)


def write_slide(folder: Path, *effects: str) -> tuple[Path, Path]:
    """Write ``record.csv`` of the slide with these effects, and ``believed.toml`` without."""
    record, params = folder / "record.csv", folder / "believed.toml"
    signals = slide_record(*effects).signals
    table, names = np.column_stack(list(signals.values())), "time,u [N],x"
    np.savetxt(record, table, fmt="%.9g", delimiter=",", header=names, comments="")
    model = believed()
    lines = ['kind = "drive"', 'command = "force"', f'law = "{model.law}"', "[plant]"]
    lines += [f"{n} = {v!r}" for n, v in model.values.items()]
    lines += ["[tolerance]", *(f"{n} = {v!r}" for n, v in model.tolerance.items()), "gain = 0"]
    params.write_text("\n".join([*lines, ""]))
    return record, params

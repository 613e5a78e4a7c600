"""Records in which an effect is hidden that is too large to be overlooked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ballscrew.records.drive_record import DriveRecord, checked
from hidden import effects as hidden_effects
from hidden.effects import NOMINAL


def strong_record(
    hidden: Mapping[str, float], *, with_current: bool = False, samples: int = 12_000
) -> DriveRecord:
    """Twelve seconds to and fro of the axis with these numbers changed, see `effects`."""
    random = np.random.default_rng(3)
    time = np.arange(samples + 1) * hidden_effects.SAMPLE
    u = 3.0 * np.sin(2 * math.pi * 0.7 * time) + 1.5 * np.sin(2 * math.pi * 1.9 * time + 1)
    noise = hidden_effects.friction_noise(random, samples + 1)
    motion = hidden_effects.simulate(dict(hidden), u, noise)
    signals = {"time": time, "u": u, "x": motion.encoder}
    if with_current:
        signals["i"] = motion.current
    return checked("made", {n: s[:-1] for n, s in signals.items()})


def write_strong(hidden: Mapping[str, float], folder: Path) -> tuple[Path, Path]:
    """``record.csv`` and ``believed.toml``, the axis without the effect."""
    folder.mkdir(parents=True, exist_ok=True)
    record, believed = folder / "record.csv", folder / "believed.toml"
    made = strong_record(hidden)
    names = ("time", "u", "x")
    table = np.stack([made.signals[n] for n in names], 1)
    np.savetxt(record, table, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    lines = ['law = "modified_lugre"', "", "[plant]"]
    lines += [f"{name} = {value!r}" for name, value in NOMINAL.items()]
    believed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return record, believed

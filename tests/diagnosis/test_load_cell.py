"""A load cell's force beside a diagnosis that does not use it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from diagnosed import nominal
from hidden import effects as hidden_effects
from hidden.effects import NOMINAL

from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive_model import DriveModel
from ballscrew.records.drive_record import checked

STEP = 0.089  # N, of the rig's converter
NOISE = 0.03  # N rms


@cache
def found_with_cell(**hidden):
    return diagnose_records([record_of(hidden)], nominal())


def record_of(hidden, with_cell=True):
    """Eight seconds to and fro, and what a cell between screw and block reads of them."""
    random = np.random.default_rng(3)
    time = np.arange(8001) * 1e-3
    u = 3.0 * np.sin(2 * math.pi * 0.7 * time) + 1.5 * np.sin(2 * math.pi * 1.9 * time + 1)
    noise = hidden_effects.friction_noise(random, 8001)
    motion = hidden_effects.simulate(hidden, u, noise)
    felt = {n: v for n, v in hidden.items() if not n.startswith("ripple")}
    dragged = hidden_effects.force_along(felt, motion.position, motion.speed, motion.way)
    dragged = dragged + NOMINAL["m"] * np.diff(motion.speed) / 1e-3 + noise[:-1]
    read = np.round((dragged + NOISE * random.standard_normal(8000)) / STEP) * STEP
    signals = {"time": time[:-1], "u": u[:-1], "x": motion.encoder[:-1], "i": motion.current[:-1]}
    return checked("made", signals | ({"force": read} if with_cell else {}))


@pytest.mark.xdist_group("load_cell")
@pytest.mark.parametrize(
    "hidden",
    [{"load": -0.3}, {"ripple": 0.1, "ripple_n": 2.0}],
    ids=["on the block", "on the screw, which the cell does not feel"],
)
def test_the_corrected_model_foretells_what_the_cell_reads(hidden):
    found = found_with_cell(**hidden)
    (cause,) = found.causes
    floor = math.hypot(NOISE, STEP / math.sqrt(12), 0.02 * NOMINAL["Fc"])
    assert found.load_cell.corrected < 1.25 * floor
    if cause.name == "load_bias":
        assert found.load_cell.prior > 0.28
    assert found.to_dict()["load_cell"]["corrected_N"] == found.load_cell.corrected


@pytest.mark.xdist_group("load_cell")
def test_the_cell_takes_no_part():
    with_it = found_with_cell(load=-0.3)
    without = diagnose_records([record_of({"load": -0.3}, with_cell=False)], nominal())
    assert without.load_cell is None
    assert with_it.causes == without.causes
    assert with_it.final_residual == without.final_residual


def test_a_drive_whose_cell_sits_nobody_knows_where_says_so():
    time = np.arange(4000) * 1e-3
    x = 0.05 * np.sin(2 * math.pi * time)
    v, a = np.gradient(x, time), np.gradient(np.gradient(x, time), time)
    u = (10.0 * a + 20.0 * v + 5.0 * np.sign(v)) / 30.0
    values = {"m": 10.0, "gain": 30.0, "offset": 0.0, "Fc": 5.0, "Fs": 5.0, "Vs": 0.01}
    model = DriveModel("drive", "classical", values | {"sigma2": 20.0}, {"m": 0.03, "Fc": 0.03})
    random = np.random.default_rng(0)
    signals = {"time": time, "u": u, "x": x + 1e-6 * random.standard_normal(4000), "force": u}
    found = diagnose_records([checked("made", signals)], model)
    assert found.load_cell is None
    assert any("does not say where it sits" in note for note in found.notes)

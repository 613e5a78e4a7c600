"""A load cell's force beside a diagnosis that does not use it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from axis_records import NOMINAL, friction_noise, moved, signals_of, to_and_fro
from diagnosed import nominal
from worlds import layout as at

from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import Drive
from ballscrew.records.reading import check_record

STEP = 0.089  # N, of the rig's converter
NOISE = 0.03  # N rms


LOAD = {at.LOAD: -0.3}
RIPPLE = {at.RIPPLE: 0.1, at.RIPPLE_PERIOD: 0.5e-3}


@cache
def found_with_cell(cause):
    return diagnose_records([record_of({"load": LOAD, "ripple": RIPPLE}[cause])], nominal())


def record_of(hidden, with_cell=True):
    """Eight seconds to and fro, and what a cell between screw and block reads of them."""
    u, noise = to_and_fro(8000), friction_noise(3, 8000)
    log = moved(hidden, u, noise)
    dragged = log[:, at.FRICTION] + hidden.get(at.LOAD, 0.0) + NOMINAL["m"] * log[:, at.A] + noise
    dragged += NOISE * np.random.default_rng(4).standard_normal(8000)
    read = np.round(dragged / STEP) * STEP
    return check_record("made", signals_of(log, u) | ({"force": read} if with_cell else {}))


@pytest.mark.xdist_group("load_cell")
@pytest.mark.parametrize(
    "cause",
    ["load", "ripple"],
    ids=["on the block", "on the screw, which the cell does not feel"],
)
def test_the_corrected_model_foretells_what_the_cell_reads(cause):
    found = found_with_cell(cause)
    (cause,) = found.causes
    # each value is fitted within 3 %
    floor = math.hypot(NOISE, STEP / math.sqrt(12), 0.03 * NOMINAL["Fc"])
    assert found.load_cell.corrected < 1.25 * floor
    if cause.name == "load_bias":
        assert found.load_cell.prior > 0.28
    assert found.to_dict()["load_cell"]["corrected_N"] == found.load_cell.corrected


@pytest.mark.xdist_group("load_cell")
def test_the_cell_takes_no_part():
    with_it = found_with_cell("load")
    without = diagnose_records([record_of(LOAD, with_cell=False)], nominal())
    assert without.load_cell is None
    assert with_it.causes == without.causes
    assert with_it.final_residual == without.final_residual


def test_a_drive_whose_cell_sits_nobody_knows_where_says_so():
    time = np.arange(4000) * 1e-3
    x = 0.05 * np.sin(2 * math.pi * time)
    v, a = np.gradient(x, time), np.gradient(np.gradient(x, time), time)
    u = (10.0 * a + 20.0 * v + 5.0 * np.sign(v)) / 30.0
    values = {"m": 10.0, "gain": 30.0, "offset": 0.0, "Fc": 5.0, "Fs": 5.0, "Vs": 0.01}
    model = Drive("drive", "classical", values | {"sigma2": 20.0}, {"m": 0.03, "Fc": 0.03})
    random = np.random.default_rng(0)
    signals = {"time": time, "u": u, "x": x + 1e-6 * random.standard_normal(4000), "force": u}
    found = diagnose_records([check_record("made", signals)], model)
    assert found.load_cell is None
    assert any("does not say where it is mounted" in note for note in found.notes)

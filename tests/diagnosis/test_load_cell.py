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
from ballscrew.records.reading import check_record

pytestmark = pytest.mark.ci


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
    ["load", pytest.param("ripple", marks=pytest.mark.prove)],
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

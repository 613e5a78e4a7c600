"""A real record: the EMPS drive, where users get it, and what the published model gets wrong."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ballscrew.diagnosis.believed import read_believed
from ballscrew.diagnosis.diagnose import diagnose

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("BALLSCREW_EMPS", ROOT.parent / "shared" / "data" / "EMPS"))
COLUMNS = {"qm": "x", "vir": "u", "t": "time", "qg": "x_ref"}


def test_the_published_model_misses_what_data_held_out_confirm():
    file = DATA / "DATA_EMPS.mat"
    if not file.is_file():
        pytest.skip(
            "DATA_EMPS.mat is not here: get it from nonlinearbenchmark.org, "
            "and set BALLSCREW_EMPS to its folder"
        )
    found = diagnose([file], params=ROOT / "docs" / "emps.toml", mapping=COLUMNS)
    assert found.verdict in ("partly", "explained")
    # a ripple of 2.5 mm or half of it, which no model without it can have
    ripple = [c for c in found.causes if c.name == "torque_ripple"]
    assert ripple
    assert ripple[0].parameters["ripples_per_metre"] % 400 == pytest.approx(0, abs=2) or ripple[
        0
    ].parameters["ripples_per_metre"] % 400 == pytest.approx(400, abs=2)
    assert found.final_residual.position < found.adjusted_residual.position


def test_the_published_values_are_read():
    model = read_believed(ROOT / "docs" / "emps.toml")
    assert model.kind == "drive"
    assert model.values["m"] == 95.1089
    assert "offset" not in model.adjustable

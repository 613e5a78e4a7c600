"""Two real drives as their motor controller recorded them, where users get them."""

from __future__ import annotations

import numpy as np
import pytest
from identification import tro2021

from ballscrew.measurement.identification.fit import fit_along
from ballscrew.measurement.records.reading import read_drive_records

pytestmark = pytest.mark.ci


NAME = "worm_drive"
FOLDER, LEAD = tro2021.DRIVES[NAME]


@pytest.fixture(scope="module")
def data():
    folder = tro2021.DATA / FOLDER
    if not folder.is_dir():
        pytest.skip(
            "the recordings are not here: get them from the repository "
            "RViMLab/TRO2021-Dynamic-Modelling, and set BALLSCREW_TRO2021 to their folder"
        )
    return folder


def test_a_start_and_stop_is_a_record_for_diagnose_too(data):
    names = {**tro2021.COLUMNS, "Torque actual value averaged": "u"}
    units = {"v": tro2021.UNITS["v"], "u": tro2021.UNITS["force"]}
    (record,) = read_drive_records([data / "start_stop" / "200.csv"], names, units, LEAD)
    assert record.command == "force"
    assert record.step == pytest.approx(0.04)
    # five seconds at 200 rpm, and back again
    turns = record.x / LEAD
    assert np.ptp(turns) == pytest.approx(5 * 200 / 60, rel=0.02)
    assert abs(turns[-1]) < 0.5


def test_runs_that_were_not_fitted_lie_in_their_intervals_by_direction(data):
    records, _ = tro2021.read_folder(data / tro2021.STEADY, LEAD)
    out = set(sorted({abs(tro2021.speed_of(r.name)) for r in records})[2:-1:3])
    chosen = [r for r in records if abs(tro2021.speed_of(r.name)) not in out]
    new = [r for r in records if abs(tro2021.speed_of(r.name)) in out]
    fit = fit_along(chosen, tro2021.LAW, tied=False)
    assert fit.values["Fc_neg"] == pytest.approx(2.0 * fit.values["Fc_pos"], rel=0.05)
    seen = tro2021.steady_points(chosen)
    found = tro2021.forecasts(fit, seen, tro2021.steady_points(new))
    assert len(found) >= 12
    assert sum(f.holds for f in found) >= len(found) - 1
    # a tenth of what the torque differs by direction
    difference = fit.values["Fc_neg"] - fit.values["Fc_pos"]
    assert np.median([f.half_width for f in found]) < 0.1 * difference

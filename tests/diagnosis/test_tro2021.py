"""Two real drives as their motor controller recorded them, where users get them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import provenance
import pytest
import tro2021

from ballscrew.identification.fit import fit_along
from ballscrew.records.reading import read_drive_records

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


def test_the_files_are_read_as_the_controller_wrote_them(data):
    stored = provenance.stored("tro2021")[NAME]
    records, refused = tro2021.read_folder(data / tro2021.STEADY, LEAD)
    assert len(records) == stored["steady_runs"]
    assert refused == stored["refused"]
    for record in records:
        rpm = tro2021.speed_of(Path(record.name))
        # the file's name has the speed, turned round as both signs are
        assert record.signals["v"].mean() / LEAD * 60 == pytest.approx(rpm, abs=1.5)
        assert np.sign(record.force.mean()) == np.sign(rpm)
        assert any("x is the integral of v" in note for note in record.notes)


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
    speeds = sorted({abs(tro2021.speed_of(Path(r.name))) for r in records})
    out = set(speeds[2:-1:3])
    chosen = [r for r in records if abs(tro2021.speed_of(Path(r.name))) not in out]
    new = [r for r in records if abs(tro2021.speed_of(Path(r.name))) in out]
    fit = fit_along(chosen, tro2021.LAW, tied=False, follow=False)
    assert fit.values["Fc_neg"] == pytest.approx(2.0 * fit.values["Fc_pos"], rel=0.05)
    seen = tro2021.steady_points(chosen)
    found = tro2021.forecasts(fit, seen, tro2021.steady_points(new))
    assert len(found) >= 12
    assert sum(f.holds for f in found) >= len(found) - 1
    # a tenth of what the torque differs by direction
    difference = fit.values["Fc_neg"] - fit.values["Fc_pos"]
    assert np.median([f.half_width for f in found]) < 0.1 * difference


@pytest.mark.parametrize("drive", tro2021.DRIVES)
def test_the_worked_page_says_what_the_proof_found(drive):
    page = (provenance.ROOT / "docs" / "tro2021.md").read_text(encoding="utf-8")
    stored = provenance.stored("tro2021")[drive]
    for found in (*stored["speeds_left_out"].values(), stored["start_stop"]):
        assert f"{found['held']} of {found['runs']}" in page
        assert f"{found['rms_error_percent_of_nominal']:.2f} %" in page
    assert f"{100 * stored['share_of_it_with_the_turn']:.0f}" in page
    for side in ("forwards", "backwards"):
        fc = stored["by_direction"]["per_direction"][side]["Fc"]
        digits = 2 if drive == "lead_screw" else 3
        shown = [f"{fc[k]:.{digits}f}" for k in ("value", "low", "high")]
        assert "{} ({} to {})".format(*shown) in page
    offset = stored["with_an_offset"]["parameters"]["offset"]
    assert f"{offset['value']:.{digits}f} " in page

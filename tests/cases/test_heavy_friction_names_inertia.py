"""Records that are exactly their model's, with a white force of 60 N: noise is all of it."""

from __future__ import annotations

import pytest
from cases import case

from ballscrew.diagnosis.diagnose import diagnose_records
from ballscrew.diagnosis.drive import read_drive
from ballscrew.records.reading import check_record, read_drive_records


@pytest.mark.parametrize("rate", [50, 200])
def test_a_white_force_is_noise_in_newtons(tmp_path, rate):
    folder = case("heavy_friction_names_inertia", tmp_path)
    (record,) = read_drive_records([folder / f"f_m25_{rate}Hz.csv"])
    half = {n: s[: len(s) // 2] for n, s in record.signals.items()}  # twenty seconds are enough
    found = diagnose_records([check_record("half", half)], read_drive(folder / "p25.toml"))
    assert found.verdict == "none"
    assert found.causes == ()
    assert found.final_residual.force == pytest.approx(found.floor.force, rel=0.3)
    # means over windows have less than the 60 N of the samples
    assert 20.0 < found.final_residual.force < 60.0

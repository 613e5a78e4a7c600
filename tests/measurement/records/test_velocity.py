"""Records of the velocity alone: the position is its integral, and that is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.measurement.records.examine import check_identifiable
from ballscrew.measurement.records.reading import (
    check_record,
    read_drive_records,
    read_force_records,
)
from ballscrew.solver.errors import BadRecord

LEAD = 0.002
TIME = np.arange(0.0, 4.0, 1e-3)
WAY = 0.02 * (1 - np.cos(3 * TIME))
SPEED = 0.06 * np.sin(3 * TIME)
FORCE = 3 * np.sin(5 * TIME)
TRAPEZOID = 1e-6 / 12 * 4 * 0.18  # by a step of 1 ms of the trapezium rule, at most, and digits

# what a motor controller writes: lines of its own, a column without a name, a line of units
EXPORT = """Date:;2020-07-08 22:13:00
Firmware Version:;0x0120;0x6150;0x0000;0x0000
Trigger:;1;0.000000;"Parameter values";"Channel 1"
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%
"""
NAMES = {"1": "time", "Velocity actual value averaged": "v"}
TORQUE = "Torque actual value averaged"
NOMINAL = 9.84e-3  # N*m


def export(path):
    rpm = SPEED / LEAD * 60
    per_cent = 100 * FORCE * LEAD / (2 * math.pi) / NOMINAL
    rows = zip(1e3 * TIME, rpm, per_cent, strict=True)
    path.write_text(EXPORT + "\n".join(f"{t:.3f};{v:.6f};{p:.6f}" for t, v, p in rows))
    return path


@pytest.mark.parametrize("unit", ["9.84e-5*N*m", "0.0984 mNm"])
def test_a_drive_controllers_export_is_read_as_it_was_written(tmp_path, unit):
    path = export(tmp_path / "a.csv")
    (record,) = read_drive_records([path], {**NAMES, TORQUE: "u"}, {"u": unit}, LEAD)
    np.testing.assert_allclose(record.x, WAY, atol=TRAPEZOID)
    np.testing.assert_allclose(record.u, FORCE, atol=1e-5)
    assert record.command == "force"
    assert record.velocity_alone
    assert any("x is the integral of v" in note for note in check_identifiable([record]))


def test_a_velocity_beside_a_position_is_left_aside():
    record = check_record("mine", {"time": TIME, "u": FORCE, "x": WAY, "v": 7 * SPEED})
    np.testing.assert_array_equal(record.x, WAY)
    assert not record.velocity_alone
    assert record.notes == ()


def test_a_velocity_in_another_unit_than_was_said_is_refused(tmp_path):
    signals = {"time": TIME, "u": FORCE, "v": SPEED / LEAD * 60}
    with pytest.raises(BadRecord, match=r"v covers .* m, too much for m/s; .* unit v=rpm"):
        check_record("mine", signals)
    path = tmp_path / "a.csv"
    rows = zip(TIME, 1e3 * SPEED, FORCE, strict=True)
    path.write_text("time,v,force\n" + "\n".join(f"{t:.4f},{v:.6f},{f:.6f}" for t, v, f in rows))
    with pytest.raises(BadRecord, match=r"v covers .* m, too much for m/s; .* unit v=mm/s"):
        read_force_records([path])
    (record,) = read_force_records([path], units={"v": "mm/s"})
    assert np.ptp(record.position) == pytest.approx(0.04, rel=1e-3)

"""Reading a reference course, and refusing what is none."""

import numpy as np
import pytest

from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.solver.errors import BadParameter

pytestmark = pytest.mark.ci


def test_linear_between_points_held_outside_and_two_rows_at_one_time_are_a_jump(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("x_d, time\n0,0.5\n0.1,1\n0.3,1\n0.2,2\n")
    reference, at = Reference.read(path), np.array([1.0])
    assert reference.jumps((0,)).tolist() == [1.0]
    assert [*reference.on(at, 0, before=True), *reference.on(at, 0)] == [0.1, 0.3]
    found = reference.on(np.array([0.0, 0.75, 1.5, 9.0]), 0).tolist()
    assert found == pytest.approx([0.0, 0.05, 0.25, 0.2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; expected a header row of names"),
        ("time,y\n0,1\n", "has the columns time, y, expected"),
        ("time,x_d\n0,0\n1,1\n0.5,2\n", "time does not increase after 1 s"),
        ("time,x_d\n0,0\n1,1\n1,2\n1,3\n", "time does not increase after 1 s"),
    ],
)
def test_bad_files_are_refused_with_the_place(tmp_path, text, message):
    path = tmp_path / "r.csv"
    path.write_text(text)
    with pytest.raises(BadParameter, match=message):
        Reference.read(path)


def test_set_points_are_read_as_records_are(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text(
        "Machine 7\ntime [ms];x_d [mm];v_d [mm/s];remark\n0,0;0,5;10;start\n500;1;-10\n"
    )
    reference = Reference.read(path)
    assert reference.all_at(0.25, [0]) == pytest.approx(0.75e-3)
    np.testing.assert_allclose(reference.velocity, [0.01, -0.01])

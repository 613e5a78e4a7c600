"""A step that an FMU discards asks for shorter ones."""

from __future__ import annotations

import pytest
from cases import ballscrew, cart_position, case, last_row

RUN = "run --controller pd.fmu --plant cart_d.fmu --setpoint 0.1 --stop 0.5 --out out"


@pytest.mark.parametrize("where", ["--isolate", "--no-isolate"])
def test_shorter_steps_are_tried_until_none_is_discarded(tmp_path, where):
    folder = case("step_discarded", tmp_path)
    done = ballscrew(folder, f"{RUN} {where}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert last_row(folder / "out")["x"] == pytest.approx(cart_position(0.5), rel=1e-3)


def test_a_step_that_was_asked_for_is_told_in_words(tmp_path):
    folder = case("step_discarded", tmp_path)
    done = ballscrew(folder, f"{RUN} --step 1e-3")
    assert done.returncode == 1
    assert "rejects the step" in done.stdout + done.stderr
    assert "smaller --step" in done.stdout + done.stderr
    assert "FMI status" not in done.stdout + done.stderr

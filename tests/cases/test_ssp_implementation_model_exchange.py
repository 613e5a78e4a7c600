"""What an element of an .ssp says of its implementation is no reason to refuse it."""

import pytest
from cases import ballscrew, cart_position, case, last_row


def test_an_element_for_model_exchange_is_run(tmp_path):
    folder = case("ssp_implementation_model_exchange", tmp_path)
    done = ballscrew(folder, "run --system me.ssp --setpoint 0.1 --stop 0.5 --step 1e-3 --out out")
    assert done.returncode == 0, done.stdout + done.stderr
    assert last_row(folder / "out")["x"] == pytest.approx(cart_position(0.5), rel=1e-3)

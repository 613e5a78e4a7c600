"""What an output measures says nothing of divergence: counts, pascals and encoders are large."""

from __future__ import annotations

import pytest
from cases import ballscrew, cart_position, case, last_row, maker

from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.stability.attractor import Kind
from ballscrew.stability.signal_motion import signal_motion


def test_counts_of_a_micrometre_do_not_diverge(tmp_path):
    folder = case("runaway_counts", tmp_path)
    words = "--setpoint 0.1 --stop 0.5 --step 1e-3 --out out"
    done = ballscrew(folder, f"run --controller pd_cnt.fmu --plant cart_cnt.fmu {words}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert last_row(folder / "out")["x"] == pytest.approx(1e6 * cart_position(0.5), rel=2e-3)


@pytest.mark.parametrize(
    ("attributes", "scale", "bias"),
    [
        ("", 1.0, 8_388_608.0),  # an absolute encoder, far from 0 at rest
        ("", 1e9, 0.0),  # nanometres
        ('nominal="1"', 1e6, 0.0),  # what some tools write of every variable
        ('nominal="1e-6"', 1.0, 0.0),  # smaller than what is travelled
        ('nominal="10"', 1.0, 353_429.0),
    ],
)
def test_what_is_large_at_rest_does_not_diverge(tmp_path, attributes, scale, bias):
    mk = maker()
    mk.plant(str(tmp_path / "cart.fmu"), xa=attributes, scale=scale, bias=bias)
    mk.pd(str(tmp_path / "pd.fmu"), scale=1 / scale, bias=bias / scale)
    result = run_closed_loop(study(tmp_path))
    moved = (result.run.outputs["x"][-1] - bias) / scale
    assert result.trusted
    assert moved == pytest.approx(cart_position(0.5), rel=2e-3)


def study(folder, stop=0.5):
    names = str(folder / "pd.fmu"), str(folder / "cart.fmu")
    return Loop(*names, Reference.constant(0.1), stop=stop, step=1e-3, isolate=False)


def test_a_loop_that_runs_away_is_still_told_from_its_signals(tmp_path):
    mk = maker()
    mk.plant(str(tmp_path / "cart.fmu"))
    mk.pd(str(tmp_path / "pd.fmu"), out="$u$=400*($x$-$x_d$);")  # positive feedback
    run = run_closed_loop(study(tmp_path, stop=5.0)).run
    assert run.diverged
    assert "exceeds its bound" in run.stopped
    assert signal_motion(run, {"x": 1.0, "v": 1.0}).kind is Kind.DIVERGES

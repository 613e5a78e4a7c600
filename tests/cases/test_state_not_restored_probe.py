"""A saved state is tried before it is believed."""

from __future__ import annotations

import numpy as np
import pytest
from cases import case, maker
from pythonfmu.builder import FmuBuilder

from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop


def test_an_integral_that_is_not_registered(tmp_path):
    folder = case("state_not_restored_probe", tmp_path)
    FmuBuilder.build_FMU(
        folder / "piunreg.py", dest=folder / "PiUnreg.fmu", canGetAndSetFMUstate=True
    )
    study = Loop(
        str(folder / "PiUnreg.fmu"), reference=Reference.constant(0.02), stop=1.0, step=1e-3
    )
    result = run_closed_loop(study)
    assert not result.run.stopped
    assert result.run.outputs["x"][-1] == pytest.approx(0.02266, abs=2e-4)
    (note,) = (n for n in result.notes if "does not restore it correctly" in n)
    assert "PiUnreg.fmu" in note
    assert "pythonfmu build --handle-state" in note


@pytest.mark.parametrize("lost", [False, True])
def test_state_that_an_fmu_keeps_elsewhere(tmp_path, lost):
    """An integral in the instance is saved with it, one in a variable of the library is not."""
    mk, name = maker(), "lost" if lost else "kept"
    where = "static double w;" if lost else "double w=S[3];"
    step = f"{where} w+=h*($x_d$-$x$); S[3]=w; $u$=25*($x_d$-$x$)-8*$v$+5*w;"
    mk.plant(str(tmp_path / "cart.fmu"))
    mk.pd(str(tmp_path / f"{name}.fmu"), name=name, out="", step=step, init="$u$=2.5;")
    study = Loop(
        str(tmp_path / f"{name}.fmu"),
        str(tmp_path / "cart.fmu"),
        Reference.constant(0.1),
        stop=0.5,
        step=1e-3,
    )
    result = run_closed_loop(study)
    assert any("does not restore it correctly" in n for n in result.notes) == lost
    assert not result.run.stopped
    assert np.isfinite(result.run.outputs["x"]).all()

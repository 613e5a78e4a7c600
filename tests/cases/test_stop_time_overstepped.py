"""No step of a run or of its checks ends behind the stop time that the FMUs were told."""

from __future__ import annotations

import pytest
from cases import case, maker

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop

STRICT = "if(t+h>m->stop)return 3;"


def test_co_runs_end_with_the_run(tmp_path):
    folder = case("stop_time_overstepped", tmp_path)
    names = str(folder / "pd_ns.fmu"), str(folder / "cart_st2.fmu")
    study = Loop(*names, Reference.constant(0.1), stop=5.0, step=5e-4, isolate=False)
    run = run_closed_loop(study).run
    assert run.verdict.trusted, run.verdict.reason
    assert run.outputs["x"][-1] == pytest.approx(0.1, abs=1e-5)


@pytest.mark.parametrize("saves", [False, True])
@pytest.mark.parametrize("in_step", [False, True])
def test_fmus_that_refuse_a_step_behind_the_stop_time(tmp_path, saves, in_step):
    """A controller that answers in its step is not tried beyond the end either."""
    mk = maker()
    mk.plant(str(tmp_path / "cart.fmu"), saves=saves, step=STRICT + mk.PLANT_STEP)
    law = "$u$=25.0*($x_d$-$x$)-8.0*$v$;"
    body = {"out": "", "step": STRICT + law, "init": law} if in_step else {"step": STRICT}
    mk.pd(str(tmp_path / "pd.fmu"), saves=saves, **body)
    names = str(tmp_path / "pd.fmu"), str(tmp_path / "cart.fmu")
    for stop, step in ((0.3, 7e-4), (0.7, 1e-3), (0.35, 3.1e-4)):
        study = Loop(*names, Reference.constant(0.1), stop=stop, step=step, isolate=False)
        run = run_closed_loop(study).run
        assert not run.stopped
        assert run.verdict.trusted or in_step  # one that answers in its step is late by one
        assert run.time[-1] == stop


def test_our_plant_probes_no_controller_beyond_the_end(tmp_path):
    mk = maker()
    mk.pd(str(tmp_path / "pd.fmu"), step=STRICT)
    for coupling in (Coupling.INTERFACE_JACOBIAN, Coupling.GAUSS_SEIDEL):
        study = Loop(str(tmp_path / "pd.fmu"), stop=0.03, step=7e-4, coupling=coupling)
        assert not run_closed_loop(study).run.stopped

"""FMUs that cannot be started or print without end, and what becomes of the rest."""

import os

import pytest
from cases import maker

from ballscrew.orchestration.fmu.isolated import IsolatedInstance
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.solver.errors import FmuError

MISSING = "ModuleNotFoundError: No module named 'zmq'"


@pytest.fixture
def mk():
    return maker()


def test_why_an_fmu_is_not_instantiated_is_told_in_its_own_words(mk, tmp_path):
    says = f'fprintf(stderr,"Traceback\\n{MISSING}\\n");return 0;'
    mk.pd(str(tmp_path / "pd.fmu"), inst=says)
    with pytest.raises(FmuError, match=MISSING):
        IsolatedInstance(tmp_path / "pd.fmu", "controller")


@pytest.mark.ci
def test_an_fmu_that_prints_without_end_fills_no_disk(mk, tmp_path):
    """Four megabytes in a run: none of it lies in a file."""
    mk.plant(str(tmp_path / "cart.fmu"))
    line = "x" * 1000
    mk.pd(str(tmp_path / "pd.fmu"), step=f'for(int k=0;k<40;k++)puts("{line}");')
    names = str(tmp_path / "pd.fmu"), str(tmp_path / "cart.fmu")
    run = run_closed_loop(Loop(*names, Reference.constant(0.1), stop=0.1, step=1e-3)).run
    assert not run.stopped
    instance = IsolatedInstance(tmp_path / "pd.fmu", "controller")
    try:
        files = [os.readlink(f"/proc/{instance._process.pid}/fd/{n}") for n in (1, 2)]
    finally:
        instance.close()
    assert all(name.startswith("pipe:") for name in files)

"""Dask where it is broken: one line within a minute, and what is done is kept."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from dask_cluster import cluster
from waiting import wait_for

from ballscrew.orchestration.study import workers as workers_module
from ballscrew.solver.errors import UserError

pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's, as it ends


@pytest.mark.prove
def test_workers_that_are_frozen_are_told(tmp_path, monkeypatch):
    """After five seconds here, and fifty else."""
    assert workers_module.SILENT + 2 * workers_module.CHECK < 60
    monkeypatch.setattr(workers_module, "SILENT", 5.0)
    monkeypatch.setattr(workers_module, "CHECK", 0.5)
    frozen = []
    with cluster(tmp_path) as (workers, processes):

        def work():
            for _ in workers.map(time.sleep, ((f"{k}", (0.5,)) for k in range(8))):
                for process in processes:
                    process.send_signal(signal.SIGSTOP)
                frozen.append(time.monotonic())

        with pytest.raises(UserError, match=r"has lost contact with its workers.*--resume"):
            work()
        assert time.monotonic() - frozen[-1] < 20


@pytest.mark.ci
def test_a_command_whose_scheduler_is_killed_keeps_its_parts_and_goes_on(tmp_path):
    out = tmp_path / "out"
    words = [Path(sys.executable).with_name("ballscrew"), "map", "--controller", "pid"]
    words += ["--x", "Kp=300:400:20", "--y", "plant.Fs=2.4:2.5:20", "--stop", "1", "--out", out]
    with cluster(tmp_path, workers=1) as (workers, processes):
        command = subprocess.Popen(
            [*words, "--dask", workers.address], stderr=subprocess.PIPE, text=True
        )
        wait_for(lambda: list(out.glob("map.parts/c0-*")), 120.0, command)
        processes.scheduler.kill()
        begin = time.monotonic()
        _, said = command.communicate(timeout=60)
    assert time.monotonic() - begin < 30
    assert command.returncode == 2
    assert said.startswith("ballscrew: the Dask scheduler at tcp://")
    assert len(said.splitlines()) == 1
    assert 0 < len(list(out.glob("map.parts/c0-*"))) < 5
    again = subprocess.run([*words, "--workers", "1", "--resume"], capture_output=True)
    assert again.returncode == 0

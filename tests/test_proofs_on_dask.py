"""Proofs run on the workers of a Dask scheduler, as maps and studies do."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from dask_cluster import cluster
from waiting import wait_for

PROOFS = Path(__file__).resolve().parents[1] / "proofs"
GROUP = ("--groups", "prescribed_motion", "--laws", "dahl", "--rigs", "3", "--first", "40")


@pytest.mark.prove
def test_a_proof_on_dask_that_loses_a_worker_is_that_of_one_process(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(PROOFS))  # of the scheduler and the workers
    proof = [sys.executable, str(PROOFS / "identification.py"), *GROUP]
    with cluster(tmp_path) as (dask, workers):
        on_dask = [*proof, "--dask", dask.address, "--out", str(tmp_path / "dask.json")]
        running = subprocess.Popen(on_dask, stderr=subprocess.PIPE, text=True)
        # each worker has a rig in hand
        wait_for(lambda: all(dask.client.processing().values()), 120.0, running)
        workers[0].kill()
        assert running.wait() in (0, 1), running.stderr.read()  # 1: an interval misses too often
        running.stderr.close()
    here = [*proof, "--workers", "1", "--out", str(tmp_path / "here.json")]
    subprocess.run(here, stderr=subprocess.DEVNULL)

    def found(name):
        report = json.loads((tmp_path / name).read_text())["prescribed_motion"]["dahl"]
        return {k: v for k, v in report.items() if k != "seconds_of_one_identification"}

    assert found("dask.json") == found("here.json")
    assert found("here.json")["parameters"]["sigma"]["rigs"] == 3

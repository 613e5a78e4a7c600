"""Long work: what is done of it is kept and belongs to it, also where Dask is broken."""

import json
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import pytest
from dask_cluster import cluster
from waiting import wait_for

from ballscrew.orchestration.study import workers as workers_module
from ballscrew.orchestration.study.workers import KeptParts
from ballscrew.solver.errors import UserError

pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's, as it ends


@pytest.mark.ci
def test_a_scheduler_without_a_worker_is_told_within_fifteen_seconds(tmp_path, monkeypatch):
    """After a second here."""
    assert workers_module.PATIENCE + 2 * workers_module.CHECK < 15
    monkeypatch.setattr(workers_module, "PATIENCE", 1.0)
    monkeypatch.setattr(workers_module, "CHECK", 0.5)
    begin, said = time.monotonic(), r"has no worker: start one .*continue with --resume"
    with cluster(tmp_path, workers=0) as (workers, _), pytest.raises(UserError, match=said):
        list(workers.map(abs, iter([("a", (1,))])))
    assert time.monotonic() - begin > 1.0


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
    assert 0 < len(list(out.glob("map.parts/c0-*"))) < 40
    for more in (["--resume"], ["--out", tmp_path / "whole"]):  # the same table as at one go
        subprocess.run([*words, "--workers", "1", *more], check=True, capture_output=True)
    tables = [(folder / "map.parquet").read_bytes() for folder in (out, tmp_path / "whole")]
    assert tables[0] == tables[1]


@pytest.mark.ci
@pytest.mark.parametrize(
    ("kept", "resume", "refused"),
    [
        ({}, False, ""),
        ({}, True, "no work to continue"),
        ({"own": 1}, False, "add --resume"),
        ({"own": 1}, True, ""),
        ({"other": 1}, True, "another work"),
        ({"other": 1, "own": 1}, True, ""),
        ({"half": '{"of": "other", "fo'}, False, ""),
        ({"unknown": json.dumps([1])}, False, "another work"),
    ],
)
def test_a_folder_is_claimed_by_what_its_parts_belong_to(tmp_path, kept, resume, refused):
    place = tmp_path / "work.parts"
    for name, content in kept.items():
        KeptParts(place, name).write(f"{name}.json", content)
        if isinstance(content, str):
            (place / f"{name}.json").write_text(content)
    own = KeptParts(place, "own")
    assert own.read("own.json") == kept.get("own")
    assert own.read("other.json") is own.read("half.json") is None
    with pytest.raises(UserError, match=refused) if refused else nullcontext():
        own.claim("work", resume)

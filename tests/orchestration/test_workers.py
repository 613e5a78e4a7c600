"""Dask where it is broken: one line within a minute, and what is done is kept."""

import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from dask_cluster import cluster
from waiting import wait_for

from ballscrew.orchestration import workers as workers_module
from ballscrew.orchestration.workers import WorkersLost

pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's, as it ends


def sleeps(count, seconds):
    return ((f"{k}", (seconds,)) for k in range(count))


def lost(workers, seconds=0.0, then=lambda: None):
    """The line, and how long it took since `then` was called after the first results."""
    begin = time.monotonic()

    def work():
        nonlocal begin
        for _ in workers.map(time.sleep, sleeps(8, seconds)):
            then()
            begin = time.monotonic()

    with pytest.raises(WorkersLost, match="--resume") as caught:
        work()
    assert "\n" not in str(caught.value)
    return str(caught.value), time.monotonic() - begin


@pytest.fixture
def impatient(monkeypatch):
    """Five seconds for the fifty."""
    assert workers_module.SILENT + 2 * workers_module.CHECK < 60
    monkeypatch.setattr(workers_module, "SILENT", 5.0)
    monkeypatch.setattr(workers_module, "CHECK", 0.5)


def test_results_come_with_their_names_and_own_errors_stay(tmp_path):
    with cluster(tmp_path) as (workers, _):
        numbers = ((f"{k}", (k, 2)) for k in range(9))
        assert dict(workers.map(pow, numbers)) == {f"{k}": k**2 for k in range(9)}
        with pytest.raises(ValueError, match="invalid literal"):
            list(workers.map(int, iter([("0", ("no number",))])))


def test_a_scheduler_that_is_killed_is_told(tmp_path):
    with cluster(tmp_path) as (workers, processes):
        said, seconds = lost(workers, then=processes.scheduler.kill, seconds=0.5)
    assert "is gone" in said
    assert seconds < 30


def test_a_scheduler_that_is_frozen_is_told(tmp_path, impatient):
    with cluster(tmp_path) as (workers, processes):
        stop = lambda: processes.scheduler.send_signal(signal.SIGSTOP)  # noqa: E731
        said, seconds = lost(workers, then=stop, seconds=0.5)
    assert "does not answer" in said
    assert seconds < 20


def test_workers_that_are_frozen_are_told(tmp_path, impatient):
    with cluster(tmp_path) as (workers, processes):

        def stop():
            for process in processes:
                process.send_signal(signal.SIGSTOP)

        said, seconds = lost(workers, then=stop, seconds=0.5)
    assert "has lost contact with its workers" in said
    assert seconds < 20


def test_no_worker_is_told(tmp_path, impatient):
    with cluster(tmp_path, workers=0) as (workers, _):
        said, seconds = lost(workers)
    assert "has no worker: start one" in said
    assert seconds < 20


def test_a_task_that_takes_longer_than_that_is_no_fault(tmp_path, impatient):
    with cluster(tmp_path, workers=1) as (workers, _):
        assert list(workers.map(time.sleep, sleeps(1, 9.0))) == [("0", None)]


def test_workers_without_the_package_are_told(tmp_path, impatient):
    """They end, as Dask has it, when they cannot read a task."""
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / "ballscrew.py").write_text(
        "raise ModuleNotFoundError(\"No module named 'ballscrew'\")"
    )
    with cluster(tmp_path, PYTHONPATH=str(hidden)) as (workers, _):
        said, seconds = lost(workers)
    assert "has lost all workers: install the same version of ballscrew" in said
    assert seconds < 30


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


@contextmanager
def something_else(answer):
    """A program that listens, and says something that is not Dask's."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            while True:
                try:
                    client, _ = server.accept()
                except OSError:
                    return
                with client:
                    client.sendall(answer)
                    time.sleep(0.2)

        threading.Thread(target=serve, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    "answer", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-OpenSSH_9.6\r\n", b"\0" * 64, b""]
)
def test_something_else_at_the_address_is_one_line(answer, tmp_path):
    with something_else(answer) as address:
        words = ["map", "--controller", "pid", "--x", "Kp=300:400:2", "--y", "plant.Fs=2.4:2.5:2"]
        words += ["--stop", "0.1", "--dask", address, "--out", str(tmp_path / "out")]
        begin = time.monotonic()
        done = subprocess.run(
            [Path(sys.executable).with_name("ballscrew"), *words], capture_output=True, text=True
        )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"responds at {address}" in done.stderr
    assert time.monotonic() - begin < 60

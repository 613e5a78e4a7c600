"""Requests that need more memory than there is are refused before anything is done."""

import resource
import subprocess
import sys
import tempfile

import pytest

from ballscrew.cli import main
from ballscrew.orchestration import memory

GIGABYTE = 10**9
MAP = ["map", "--controller", "pid", "--stop", "0.1", "--workers", "1", "--out", "OUT"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run --controller pid --step 1e-6 --stop 50", "5e+07 communication steps need, about"),
        (
            "run --controller pid --coupling monolithic --step 1e-6 --stop 50",
            "5e+07 communication steps need, about",
        ),
        ("map --controller pid --x Kp=1:2:100000 --y Kd=1:2:100000", "100000 x 100000 cells need"),
        (f"map --controller pid --x Kp=1:2:{'9' * 400} --y Kd=1:2:9", "cells need, about"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line_that_says_how_much_and_what_to_do(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(memory, "available_memory", lambda: 2 * GIGABYTE)
    assert main([*arguments.split(), "--out", "OUT"]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert "but only 2 GB is available; " in heard
    assert heard.count("\n") == 1
    left = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert left == []


def test_a_folder_of_a_refused_map_takes_the_next_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(memory, "available_memory", lambda: 1000)
        assert main([*MAP, "--x", "Kp=100:500:3", "--y", "Kd=20:40:3"]) == 2
    assert main([*MAP, "--x", "Kp=100:500:2", "--y", "Kd=20:40:2"]) == 0


def test_the_limits_of_the_process_are_seen():
    code = "from ballscrew.orchestration.memory import available_memory; print(available_memory())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 * GIGABYTE,) * 2),
    )
    assert 0 < int(done.stdout) < 4 * GIGABYTE


@pytest.mark.parametrize("version", [1, 2])
def test_the_limits_of_containers_are_seen(tmp_path, monkeypatch, version):
    top = tmp_path if version == 2 else tmp_path / "memory"
    group = top / "pod" / "box"
    group.mkdir(parents=True)
    names = ("memory.max", "memory.current", "inactive_file")
    if version == 1:
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    for place, limit in ((group, "max"), (group.parent, str(3 * GIGABYTE))):
        (place / names[0]).write_text(f"{limit}\n")
        (place / names[1]).write_text(f"{GIGABYTE}\n")
        (place / "memory.stat").write_text(f"anon 7\n{names[2]} 1000\n")
    kind = "" if version == 2 else "cpu,memory"
    lines = {"/proc/self/cgroup": [f"4:{kind}:/pod/box"]}
    real = memory._lines
    monkeypatch.setattr(memory, "_CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "_lines", lambda path: lines.get(str(path)) or real(path))
    assert list(memory._of_the_cgroups()) == [2 * GIGABYTE + 1000]

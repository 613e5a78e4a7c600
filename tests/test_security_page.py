"""What a hostile FMU can do, and that it can do nothing under the recipe of docs/security.md."""

import re
import shutil
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from third_party_fmus import proportional

PAGE = Path(__file__).resolve().parents[1] / "docs" / "security.md"
ASKED = "ballscrew run --controller theirs.fmu --out out"
ACTS = """
import os, pathlib, signal, socket

def plants(folder):
    return lambda: pathlib.Path(folder, "planted").write_text("planted")

def tells():
    with socket.create_connection(("127.0.0.1", {port}), 2) as connection:
        connection.sendall(b"hello")

def reads():
    with open({secret!r}) as stream:
        assert stream.read() == "the secret"

def peeks():
    assert b"THE_SECRET" in pathlib.Path("/proc/1/environ").read_bytes()

acts = dict(tells=tells, reads=reads, peeks=peeks)
acts |= dict(lists=lambda: os.listdir({home!r})[0], kills=lambda: os.kill({victim}, signal.SIGKILL))
acts |= dict(knows=lambda: os.environ["THE_SECRET"])
acts |= dict(sets=lambda: open("/proc/sys/kernel/hostname", "r+").close())
acts |= {{name: plants(folder) for name, folder in {folders!r}.items()}}

def act(report):
    done = []
    while acts:  # once in a process
        name, function = acts.popitem()
        try:
            function()
            done.append(name)
        except Exception:
            pass
    if done:
        pathlib.Path(report).write_text(" ".join(done))
"""


@pytest.mark.ci
def test_under_the_lines_of_the_page_a_hostile_fmu_harms_nobody(tmp_path, monkeypatch):
    if not shutil.which("bwrap"):
        pytest.skip("needs bubblewrap (`apt install bubblewrap`), for the recipe of security.md")
    (lines,) = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert ASKED in lines
    folders = {name: tmp_path / name for name in ("home", "out", "here", "temporary")}
    for place in folders.values():
        place.mkdir()
    home, here = folders["home"], folders["here"]
    (home / "secret").write_text("the secret")
    monkeypatch.setenv("PATH", f"{sys.prefix}/bin", prepend=":")
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("THE_SECRET", "the secret")
    monkeypatch.chdir(here)
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        subprocess.Popen(["sleep", "300"]) as victim,
    ):
        given = {"port": server.getsockname()[1], "victim": victim.pid, "home": str(home)}
        given |= {"secret": str(home / "secret")}
        text = ACTS.format(folders={n: str(place) for n, place in folders.items()}, **given)
        server.setblocking(False)

        def run(script, report):
            """The course of a run of that FMU, which writes there what it could do."""
            name, act = report.parent.name.title(), f"hostile.act({str(report)!r})"
            options = {"head": "import hostile\n", "in_step": act, "modules": {"hostile": text}}
            shutil.copy(proportional(tmp_path / name, name, **options), here / "theirs.fmu")
            subprocess.run(["sh", "-euc", script], check=True, capture_output=True)
            return (here / "out" / "trajectory.csv").read_text()

        def harm():
            """Damage that is visible from outside."""
            found = {n for n, place in folders.items() if (place / "planted").exists()}
            with suppress(BlockingIOError):
                server.accept()[0].close()
                found.add("tells")
            with suppress(subprocess.TimeoutExpired):
                victim.wait(1)
                found.add("kills")
            return found

        try:
            short = f"{ASKED} --stop 0.005 --step 1e-4"
            found = run(lines.replace(ASKED, short), Path("/home/axis/report"))
            assert harm() == set()
            assert not (here / "report").exists()  # nothing was done inside either
            report = folders["temporary"] / "report"
            assert run(short, report) == found
            assert harm() == {"tells", "kills", *folders}
            words = report.read_text().split()
            assert {"tells", "reads", "lists", "kills", "knows", *folders} <= set(words)
        finally:
            victim.kill()

"""A third-party controller that tries to harm its user, and checks of its effects."""

from __future__ import annotations

import socket
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest
from third_party_fmus import proportional

ACTS = """
import os, pathlib, signal, socket

def plants(folder):
    def act():
        pathlib.Path(folder, "planted").write_text("planted")
    return act

def tells():
    with socket.create_connection(("127.0.0.1", {port}), 2) as connection:
        connection.sendall(b"hello")

def reads():
    with open({secret!r}) as stream:
        assert stream.read() == "the secret"

def lists():
    assert os.listdir({home!r})

def kills():
    os.kill({victim}, signal.SIGKILL)

def knows():
    os.environ["THE_SECRET"]

def peeks():
    assert b"THE_SECRET" in pathlib.Path("/proc/1/environ").read_bytes()

def sets():
    open("/proc/sys/kernel/hostname", "r+").close()

acts = dict(tells=tells, reads=reads, lists=lists, kills=kills)
acts |= dict(knows=knows, peeks=peeks, sets=sets)
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
FOLDERS = ("home", "out", "here", "temporary")


class World:
    """Folders of a user that an FMU must not access; ``here`` is for work, ``out`` for results."""

    def __init__(self, folder: Path, server: socket.socket, victim: subprocess.Popen) -> None:
        self.folders = {name: folder / name for name in FOLDERS}
        for place in self.folders.values():
            place.mkdir()
        self.secret = self.folders["home"] / "secret"
        self.secret.write_text("the secret")
        self.server, self.victim = server, victim

    def hostile(self, in_step: str, name: str = "Hostile") -> Path:
        """An FMU with the module ``hostile``, which is harmless except for the given step."""
        text = ACTS.format(
            port=self.server.getsockname()[1],
            secret=str(self.secret),
            home=str(self.folders["home"]),
            victim=self.victim.pid,
            folders={name: str(place) for name, place in self.folders.items()},
        )
        folder = self.folders["home"].parent / name
        modules = {"hostile": text}
        return proportional(folder, name, head="import hostile\n", in_step=in_step, modules=modules)

    def harm(self) -> set[str]:
        """Damage that is visible from outside."""
        found = {n for n, place in self.folders.items() if (place / "planted").exists()}
        self.server.setblocking(False)
        try:
            self.server.accept()[0].close()
            found.add("tells")
        except BlockingIOError:
            pass
        try:
            self.victim.wait(1)
            found.add("kills")
        except subprocess.TimeoutExpired:
            pass
        return found


@contextmanager
def world(folder: Path, patch: pytest.MonkeyPatch):
    """A `World`, with the home folder, the variables and the working folder of its user."""
    victim = subprocess.Popen(["sleep", "300"])
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            made = World(folder, server, victim)
            patch.setenv("HOME", str(made.folders["home"]))
            patch.setenv("THE_SECRET", "the secret")
            patch.chdir(made.folders["here"])
            yield made
    finally:
        victim.kill()
        victim.wait()

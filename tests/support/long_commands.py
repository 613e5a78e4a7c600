"""Long commands, started as by a shell, and all their processes.

Every process inherits the environment of its parent: a mark in it identifies all processes of a
command, even after a change of session or parent.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

import numpy as np

BALLSCREW = Path(sys.executable).with_name("ballscrew")
_MARK = "BALLSCREW_TESTS_MARK"
_TICKS = os.sysconf("SC_CLK_TCK")

COMMANDS = {
    "run": "run --controller nctf --stop 4000",
    "run_isolated": "run --controller nctf --stop 4000 --isolate",
    "run_monolithic": "run --controller nctf --stop 400000 --step 1 --coupling monolithic",
    "swap": "swap --controllers iol nctf --stop 4000 --isolate",
    "lyapunov": "lyapunov --controller nctf --stop 20000",
    "lyapunov_fmu": "lyapunov --controller nctf --stop 2000 --via fmu",
    "map": "map --controller iol --x sigma0_hat=66965.89:66969.24:90 "
    "--y sigma1_hat=339:367:90 --workers 2",
    "rig": "rig 2.8 2.4 --law lugre",
    "identify": "identify {data}/trial --law lugre",
    "diagnose": "diagnose {data}/axis.csv",
}
WITH_CHILDREN = ("run_isolated", "swap", "map")


def write_data(folder: Path) -> None:
    """Write the input files of some commands: a rig's record, and a record of an axis."""
    from ballscrew.measurement.rig.bench import run_trial
    from ballscrew.measurement.rig.trials import TRIALS

    run_trial(TRIALS["2.4/7"], "lugre").save(folder / "trial")
    t = np.arange(0.0, 20.0, 2e-3)
    x = 0.02 * np.sin(0.7 * t) + 0.01 * np.sin(2.3 * t)
    v = np.gradient(x, t)
    table = np.column_stack([t, 3.0 * np.sign(v) + 40.0 * v, x])
    np.savetxt(folder / "axis.csv", table, delimiter=",", header="time,u,x", comments="")


class Command:
    """A running command of `COMMANDS`, or of words; `data` is the folder of `write_data`."""

    def __init__(self, name: str | list[str], data: Path, out: Path) -> None:
        words = COMMANDS[name].format(data=data).split() if isinstance(name, str) else name
        self._mark = uuid.uuid4().hex
        self.process = subprocess.Popen(
            [str(BALLSCREW), *words, "--out", str(out)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # tests started in the background by a shell ignore SIGINT
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            env=os.environ | {_MARK: self._mark},
        )

    def processes(self) -> dict[int, float]:
        """Its running processes, with the processor time of each [s]."""
        found = {}
        wanted = f"{_MARK}={self._mark}".encode()
        for folder in Path("/proc").iterdir():
            if not folder.name.isdigit():
                continue
            try:
                if wanted not in (folder / "environ").read_bytes().split(b"\0"):
                    continue
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:  # of another user, or ended
                continue
            if fields[0] != "Z":
                found[int(folder.name)] = (int(fields[11]) + int(fields[12])) / _TICKS
        return found

    def wait_until_it_answers(self) -> None:
        """Wait until the interpreter has started and code of the command can run.

        The command blocks interrupts, starts its work in a child and waits for them. Linux does
        not count a signal as blocked while a process waits for it; then the child is there.
        """
        interrupt = 1 << (signal.SIGINT - 1)
        while True:
            assert self.process.poll() is None, "the command ended by itself"
            status = Path(f"/proc/{self.process.pid}/status").read_text(encoding="utf-8")
            blocked = int(status.partition("SigBlk:")[2].split()[0], 16)
            if blocked & interrupt or len(self.processes()) > 1:
                return
            time.sleep(0.001)

    def wait_until_busy(self, seconds: float, children: int = 0, patience: float = 120.0) -> None:
        """Wait until its processes have used this processor time, and it has this many children."""
        self.wait_until_it_answers()
        deadline = time.monotonic() + patience
        while True:
            running = self.processes()
            if len(running) > children and sum(running.values()) >= seconds:
                return
            assert self.process.poll() is None, "the command ended by itself"
            assert time.monotonic() < deadline, "the command does nothing"
            time.sleep(0.02)

    def left_after(self, seconds: float) -> dict[int, float]:
        """Its processes still running after some seconds; returns as soon as there are none."""
        deadline = time.monotonic() + seconds
        while (left := self.processes()) and time.monotonic() < deadline:
            time.sleep(0.05)
        return left


@dataclass(frozen=True)
class Ending:
    """The end of a command."""

    code: int
    seconds: float  # from the signal to the end of the main process
    said: str  # on standard error
    left: dict[int, float]  # processes still running five seconds later

    def fault(self) -> str:
        """Error of the end of an interrupted command; empty if there is none."""
        lines = self.said.splitlines()
        if self.code != 130:
            return f"exit code {self.code}: {self.said}"
        if self.seconds > 2.0:
            return f"took {self.seconds:.2f} s"
        if len(lines) != 1 or not lines[0].startswith("ballscrew: interrupted after "):
            return f"said {self.said!r}"
        return f"{len(self.left)} processes left" if self.left else ""


def interrupted(command: Command, number: int) -> Ending:
    """Send a signal to a command and return its end."""
    begin = time.monotonic()
    command.process.send_signal(number)
    _, said = command.process.communicate(timeout=60)
    seconds = time.monotonic() - begin
    return Ending(command.process.returncode, seconds, said, command.left_after(5.0))


def seen_in(folder: Path) -> dict[str, bytes]:
    """Files visible to a user in a folder."""
    return {p.name: p.read_bytes() for p in folder.glob("[!.]*") if p.is_file()}

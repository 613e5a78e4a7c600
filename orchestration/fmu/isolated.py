"""An FMU in its own process, so that a crash, a hang or its modules do not affect this one.

`IsolatedInstance` is the master's side; `main` runs in a new interpreter with an `FmuInstance`, and
answers over a socket. A message is a line of JSON: a list of calls, each a name with its arguments;
its answer is a status with the result of the last call, or of the first that fails. Calls without
an answer wait for the next one that has an answer, so that a communication step needs few
exchanges. No Python objects are exchanged: the FMU's side is not trusted.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import threading
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...fmus.made_here import is_ours
from ...fmus.reading import Description, UnpackedFmu
from ...solver.arrays import Vector
from ...solver.errors import FmuError, UserError
from .fmu_instance import SHORTER, AnyFmu, FmuInstance, Reader, StepFailed, Value, Writer
from .limits import TIME_LIMIT
from .operating_system import end_host, how_ended, start_host

DONE, FAILED, REFUSED, DISCARDED = range(4)
_KEPT = 4096  # bytes of its output
_FAREWELL = 5.0  # s, time limit for a normal end
_AT_ONCE, _LARGEST = 1 << 16, 1 << 28  # bytes of an answer
_ALONE = "test this FMU alone: the error is in the FMU itself"


class IsolatedInstance(AnyFmu):
    """An FMU, run in another process, with a time limit for each call [s].

    Raises `FmuError` as `FmuInstance`, and if its process ends when it is opened.
    """

    def __init__(
        self, source: Path | str | UnpackedFmu, name: str, time_limit: float = TIME_LIMIT
    ) -> None:
        super().__init__(source, name)
        self.time_limit = time_limit
        self._waiting: list[tuple[Any, ...]] = []
        self._changes = 0  # number of calls that may have changed outputs
        self._made = 0  # number of writers, readers and states in the other process
        self._dead = ""
        folder = self._fmu.folder
        self._socket, self._process = start_host(__name__, folder)
        self._socket.settimeout(time_limit)
        held = self._socket, self._process.stdin
        self._end = weakref.finalize(self, end_host, self._process, *held)
        self._printed = bytearray()
        streams = self._process.stdout, self._printed
        self._listener = threading.Thread(target=_keep_end, args=streams, daemon=True)
        self._listener.start()
        try:
            self._ask("open", str(self.path), str(folder), self.description.to_dict(), name)
        except UserError as error:
            self._end()
            if isinstance(error, StepFailed):
                raise FmuError(f"{self.path}: cannot be instantiated: {error}") from error
            raise FmuError(f"{error}{self._last_output()}") from error

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        self._ask("do", "enter", dict(values), stop)

    def leave_initialization(self) -> None:
        (period,) = self._numbers([self._ask("do", "leave_initialization")], ["its sample time"])
        self.sample_time = float(period) or self.sample_time

    def writer(self, names: Sequence[str]) -> Writer:
        number = self._make("writer", list(names))
        return lambda values: self._tell("write", number, np.asarray(values, dtype=float).tolist())

    def reader(self, names: Sequence[str]) -> Reader:
        number = self._make("reader", list(names))
        known, read_after = np.zeros(0), -1

        def read() -> Vector:
            nonlocal known, read_after
            # a step begins with the end values of the last one: this saves half of all requests
            if read_after != self._changes or self._dead:
                known = self._numbers(self._ask("read", number), names)
                read_after = self._changes
            return known.copy()

        return read

    def _numbers(self, answer: Any, names: Sequence[str]) -> Vector:
        """An answer as numbers, one for each name; what is none ends the process."""
        with contextlib.suppress(ValueError, TypeError, OverflowError):
            numbers = np.array(answer, dtype=float)
            if numbers.shape == (len(names),):
                return numbers
        raise self._lost(f"gave no numbers for {', '.join(names)}")

    def step(self, t: float, h: float) -> None:
        """Move on; a failure shows when something is read."""
        self._tell("do", "step", t, h)

    def save(self) -> Any:
        return self._make("save")

    def restore(self, state: Any) -> None:
        self._tell("give", "restore", state)

    def release(self, state: Any) -> None:
        if not self._dead:
            self._tell("give", "release", state)

    def reopened(self) -> IsolatedInstance:
        other = IsolatedInstance(self._fmu, self.name, self.time_limit)
        other.sample_time, other.can_save = self.sample_time, self.can_save
        return other

    def close(self) -> None:
        if self._end.alive and not self._dead:
            self._socket.settimeout(min(self.time_limit, _FAREWELL))
            with contextlib.suppress(OSError, StepFailed, FmuError):
                self._ask("do", "close")
        self._end()
        self._clean()

    def _make(self, *call: Any) -> int:
        self._made += 1
        self._tell("make", self._made, *call)
        return self._made

    def _tell(self, *call: Any) -> None:
        self._changes += 1
        self._waiting.append(call)

    def _ask(self, *call: Any) -> Any:
        """Send everything that waits and this call; return its answer."""
        if self._dead:
            raise StepFailed(self._dead)
        self._changes += call[0] != "read"
        calls, self._waiting = [*self._waiting, call], []
        try:
            self._socket.sendall(json.dumps(calls).encode() + b"\n")
            status, result = json.loads(self._received())
        except TimeoutError:
            names = [c[1] if c[0] == "do" else c[0] for c in calls]
            name = "step" if "step" in names else names[-1]
            what = f"did not answer the call {name} within {self.time_limit:g} s"
            raise self._lost(what, "if it is only slow, use a longer time limit") from None
        except (OSError, EOFError):
            raise self._lost(self._how_it_ended()) from None
        except (ValueError, TypeError, RecursionError):
            raise self._lost("gave an answer that is not understood") from None
        if status == DONE:
            return result
        text = " ".join(str(result).split())
        if status == REFUSED:
            raise FmuError(text)
        raise StepFailed(text, SHORTER if status == DISCARDED else "")

    def _received(self) -> bytes:
        """One line; the socket's own time limit is for each piece."""
        end, data = time.monotonic() + (self._socket.gettimeout() or 0.0), b""
        while not data.endswith(b"\n"):
            if data and time.monotonic() > end:
                raise TimeoutError
            more = self._socket.recv(_AT_ONCE)
            data += more
            if not more or len(data) > _LARGEST:
                raise EOFError
        return data

    def _lost(self, how: str, advice: str = _ALONE) -> StepFailed:
        self._dead = f"{self.name} ({self.path.name}) {how}"
        end_host(self._process)
        return StepFailed(self._dead, advice)

    def _how_it_ended(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_FAREWELL)
        code = self._process.returncode
        how = "closed the connection" if code is None else how_ended(code)
        return how + self._last_output()

    def _last_output(self) -> str:
        """The last line that it printed, for a message; it has ended."""
        self._listener.join(_FAREWELL)
        lines = self._printed.decode("utf-8", "replace").strip().split("\n")
        return f"; its last output: {lines[-1].strip()[:200]}" if lines[-1] else ""


def _keep_end(stream: Any, printed: bytearray) -> None:
    """Read a process's output continuously, so that no disk or pipe is filled, and keep its end."""
    with stream:
        while data := stream.read(_AT_ONCE):
            printed += data
            del printed[:-_KEPT]


def open_fmu(
    path: Path, name: str, isolate: bool | None = None, time_limit: float = TIME_LIMIT
) -> FmuInstance | IsolatedInstance:
    """Open an FMU in its own process if requested; default: if it was not written by this program.

    Raises `FmuError` as its class does.
    """
    if is_ours(path) if isolate is None else not isolate:
        instance = FmuInstance(path, name)
        if not instance.description.once_per_process:
            return instance
        instance.close()  # co-runs need further instances
    return IsolatedInstance(path, name, time_limit)


# -- the other process ---------------------------------------------------------------------------


def main(connection: socket.socket) -> None:
    """Answer calls until the connection is closed, then end immediately."""
    host = _Host()
    with contextlib.suppress(OSError):
        for line in connection.makefile("rb"):
            connection.sendall(json.dumps(host.answer(line)).encode() + b"\n")
    # Without the interpreter's own end, in which a third-party library may still crash.
    os._exit(0)


class _Host:
    """The FMU, and by number what was made of it: writers, readers and saved states."""

    _fmu: FmuInstance

    def __init__(self) -> None:
        self._made: dict[int, Any] = {}

    def answer(self, line: bytes) -> tuple[int, Any]:
        """Do every call of a message; return a status and the answer to the last."""
        result: Any = None
        try:
            for name, *arguments in json.loads(line):
                result = getattr(self, name)(*arguments)
        except StepFailed as error:
            return DISCARDED if error.advice == SHORTER else FAILED, str(error)
        except FmuError as error:
            return REFUSED, str(error)
        except Exception as error:
            return FAILED, f"{type(error).__name__}: {error}"
        return DONE, result

    def open(self, path: str, folder: str, description: dict[str, Any], name: str) -> None:
        unpacked = UnpackedFmu(Path(path), Description.from_dict(description), Path(folder))
        self._fmu = FmuInstance(unpacked, name)

    def do(self, call: str, *arguments: Any) -> float:
        getattr(self._fmu, call)(*arguments)
        return self._fmu.sample_time

    def make(self, number: int, call: str, *arguments: Any) -> None:
        self._made[number] = getattr(self._fmu, call)(*arguments)

    def write(self, number: int, values: list[float]) -> None:
        self._made[number](np.array(values, dtype=float))

    def read(self, number: int) -> list[float]:
        values: list[float] = self._made[number]().tolist()
        return values

    def give(self, call: str, number: int) -> None:
        """Give a state back, to be restored or released."""
        state = self._made[number] if call == "restore" else self._made.pop(number)
        getattr(self._fmu, call)(state)

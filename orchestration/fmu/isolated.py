"""An FMU in its own process, so that a crash, a hang or its modules do not affect this one.

`IsolatedInstance` is the master's side; `main` runs in another process with an `FmuInstance`, and
answers over a socket. A call that is made once for an instance, and its answer, are a line of JSON
each: a name with its arguments, and a status with a result. Values, steps and states are arrays of
numbers that compiled code exchanges (``master/c/remote.c``). No Python objects are exchanged: the
FMU's side is not trusted.
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
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numpy as np

from ...fmus.made_here import is_ours
from ...fmus.reading import Description, UnpackedFmu
from ...solver.arrays import Vector
from ...solver.errors import FmuError, UserError
from .compiled import WAITS, Bound, Calls, Guarded, Struct, address_of, call, library, struct
from .fmu_instance import ENTRY_POINTS, SHORTER, AnyFmu, FmuInstance, Reader, StepFailed, Writer
from .limits import TIME_LIMIT
from .operating_system import end_host, how_ended, line_of, start_host

DONE, FAILED, REFUSED, DISCARDED = range(4)
_KEPT = 4096  # bytes of its output
_FAREWELL = 5.0  # s, time limit for a normal end
_ROOM = 1024  # of a message of compiled code, in addition to two numbers for each variable
_ENDED = 1  # how compiled code lost the connection
_STRANGE = "gave an answer that is not understood"
_ALONE = "test this FMU alone: the error is in the FMU itself"


class IsolatedInstance(AnyFmu):
    """An FMU, run in another process, with a time limit for each call [s].

    Raises `FmuError` as `FmuInstance`, and if its process ends when it is opened.
    """

    def __init__(
        self, source: Path | str | UnpackedFmu, name: str, time_limit: float = TIME_LIMIT
    ) -> None:
        super().__init__(source, name, time_limit)
        self.time_limit = time_limit
        self._dead, self._printed = "", bytearray()
        folder = self._fmu.folder
        self._socket, self._process = start_host(__name__, folder)
        self._end = weakref.finalize(
            self, end_host, self._process, self._socket, self._process.stdin
        )
        streams = self._process.stdout, self._printed
        self._listener = threading.Thread(target=_keep_end, args=streams, daemon=True)
        self._listener.start()
        self._guarded, self._line, self._remotes = Guarded(), struct("Line"), list[Struct]()
        waits, room = self._guarded.address(WAITS, self._wait), _ROOM + 2 * len(self._variables)
        self._line.set(socket=self._socket.fileno(), wait=waits, room=np.zeros(room))
        try:
            self._ask("open", str(self.path), str(folder), self.description.to_dict(), name)
            self._with_ports([], [])
        except UserError as error:
            self.close()
            if isinstance(error, StepFailed):
                raise FmuError(f"{self.path}: cannot be instantiated: {error}") from error
            raise FmuError(f"{error}{self._last_output()}") from error

    def enter(self, values: Mapping[str, float | str], stop: float) -> None:
        self._ask("do", "enter", dict(values), stop)

    def leave_initialization(self) -> None:
        period = self._ask("do", "leave_initialization")
        try:
            self.sample_time = float(period) or self.sample_time
        except (TypeError, ValueError, OverflowError):
            raise self._lost(_STRANGE) from None

    def writer(self, names: Sequence[str]) -> Writer:
        number = self._with_ports(names, [])

        def write(values: Vector) -> None:
            self._call(number, "set_real", 0, len(names), np.ascontiguousarray(values, dtype=float))

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        number = self._with_ports([], names)

        def read() -> Vector:
            values = np.empty(len(names))
            self._call(number, "get_real", 0, len(names), values)
            return values

        return read

    def step(self, t: float, h: float) -> None:
        """Move on; a failure shows when something is read, as for states."""
        self._call(0, "do_step", t, h, 0)

    def save(self) -> Any:
        state = np.zeros(1, dtype=np.intp)
        self._call(0, "get_state", state)
        return state

    def restore(self, state: Any) -> None:
        self._call(0, "set_state", int(state[0]))

    def release(self, state: Any) -> None:
        if not self._dead:
            self._call(0, "free_state", state)

    def close(self) -> None:
        if self._end.alive and not self._dead:
            self.time_limit = min(self.time_limit, _FAREWELL)
            with contextlib.suppress(OSError, StepFailed, FmuError):
                self._ask("do", "close")
        self._end()
        self._clean()

    def _ask(self, *given: Any) -> Any:
        """Send what compiled code has noted, then a call; return its answer."""
        if self._dead:
            raise StepFailed(self._dead)
        if self._remotes:
            self._call(0, "flush")
        self._line.record.changes += 1
        try:
            self._socket.settimeout(self.time_limit)
            self._socket.sendall(json.dumps(given).encode() + b"\n")
            status, result = json.loads(line_of(self._socket, self.time_limit))
        except TimeoutError:
            raise self._late(given[1] if given[0] == "do" else given[0]) from None
        except OSError:
            raise self._lost(self._how_it_ended()) from None
        except (ValueError, TypeError, RecursionError):
            raise self._lost(_STRANGE) from None
        if status == DONE:
            return result
        text = " ".join(str(result).split())
        if status == REFUSED:
            raise FmuError(text)
        raise StepFailed(text, SHORTER if status == DISCARDED else "")

    def bind(self, inputs: Sequence[str], outputs: Sequence[str]) -> Calls:
        """Functions that compiled code calls for these ports, and what gives a call's error."""
        number = self._with_ports(inputs, outputs)
        points = (address_of(getattr(library(), f"remote_{name}")) for name in ENTRY_POINTS[1:])
        return (self._remotes[number], *points), self._failure

    def _with_ports(self, inputs: Sequence[str], outputs: Sequence[str]) -> int:
        """The number of these ports on both sides; the first are none."""
        self._ask("bind", list(inputs), list(outputs))
        remote, number = struct("Remote"), len(self._remotes)
        remote.set(line=self._line, number=number, read_at=-1, known=np.zeros(len(outputs)))
        remote.set(set_at=-1, given=np.zeros(len(inputs)))
        self._remotes.append(remote)
        return number

    def _call(self, number: int, function: str, *arguments: Any) -> None:
        if call(f"remote_{function}", self._remotes[number], *arguments):
            raise self._failure()

    def _wait(self, goes_on: int) -> None:
        """Wait for an answer to compiled code: only Python hears an interrupt."""
        if not goes_on:
            self._until = time.monotonic() + self.time_limit
        if not wait([self._socket], max(self._until - time.monotonic(), 0.0)):
            raise self._late("step")

    def _failure(self) -> BaseException:
        """The error of a call of compiled code that has failed."""
        error, self._guarded.error = self._guarded.error, None
        if error is None and (lost := self._line.record.lost) and not self._dead:
            error = self._lost(self._how_it_ended() if lost == _ENDED else _STRANGE)
        if error is None:
            try:
                self._ask("fail")
            except UserError as found:
                error = found
        return error or RuntimeError(f"{self.name} failed without an error")

    def _late(self, name: str) -> StepFailed:
        what = f"did not answer the call {name} within {self.time_limit:g} s"
        return self._lost(what, "if it is only slow, use a longer time limit")

    def _lost(self, how: str, advice: str = _ALONE) -> StepFailed:
        self._line.record.lost = _ENDED
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
        while data := stream.read(1 << 16):
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


def main(connection: socket.socket) -> None:
    """Answer calls until the connection is closed, then end immediately."""
    np.random.seed()  # forked processes would all draw the same numbers
    host = _Host(connection)
    with contextlib.suppress(OSError):
        while True:
            if host.bound:
                call("remote_serve", host.served)
            answer = host.answer(line_of(connection))
            connection.sendall(json.dumps(answer).encode() + b"\n")
    # Without the interpreter's own end, in which a third-party library may still crash.
    os._exit(0)


class _Host:
    """The FMU, and its ports by number for compiled code."""

    _fmu: FmuInstance

    def __init__(self, connection: socket.socket) -> None:
        self.served = struct("Served")
        self.served.set(socket=connection.fileno())
        self.bound: list[Bound] = []

    def answer(self, line: bytes) -> tuple[int, Any]:
        """Do a call; return a status and its result."""
        try:
            name, *arguments = json.loads(line)
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
        self.served.set(room=np.zeros(_ROOM + 2 * len(self._fmu.description.variables)))

    def do(self, call: str, *arguments: Any) -> float:
        getattr(self._fmu, call)(*arguments)
        return self._fmu.sample_time

    def bind(self, inputs: list[str], outputs: list[str]) -> None:
        """Give these ports the next number."""
        self.bound.append(Bound(self._fmu, inputs, outputs, struct("Calls")))
        addresses = [b.calls.address for b in self.bound]
        self.served.set(calls=np.array(addresses, dtype=np.intp))

    def fail(self) -> None:
        """Raise the error of the last call of compiled code."""
        raise self.bound[self.served.record.asked].failure() or RuntimeError("no call has failed")

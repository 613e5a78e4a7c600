"""An FMU in its own process, so that a crash, a hang or its modules do not affect this one.

This is the master's side. The other side is `isolated_host.py`, a new interpreter that runs an
`FmuInstance` and answers over a socket; the end of its output is kept, and an error message shows
the last line. Requests without an answer are sent together with the next one that has an answer,
so that a communication step needs few exchanges.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import struct
import subprocess
import threading
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...fmus.made_here import is_ours
from ...fmus.reading import UnpackedFmu
from ...solver.errors import FmuError
from . import isolated_host
from .fmu_instance import (
    SHORTER,
    AnyFmu,
    FmuInstance,
    Reader,
    StepFailed,
    Value,
    Writer,
    inputs_of,
    open_source,
)
from .isolated_host import DISCARDED, FAILED, OK, REFUSED, Request, receive, send
from .limits import TIME_LIMIT
from .operating_system import end_host, how_ended, start_host

Vector = npt.NDArray[np.float64]

_KEPT = 4096  # bytes of its output
_FAREWELL = 5.0  # s, time limit for a normal end


class IsolatedInstance(AnyFmu):
    """An FMU, run in another process.

    Parameters
    ----------
    source : path-like or UnpackedFmu
    name : str
        Instance name; also the name of the FMU in messages.
    time_limit : float
        Time limit of one call [s].

    Raises
    ------
    FmuError
        If the file is not an FMU that can run here, or its process ends when it is opened.
    """

    def __init__(
        self, source: Path | str | UnpackedFmu, name: str, time_limit: float = TIME_LIMIT
    ) -> None:
        self._fmu, self._clean = open_source(self, source)
        self.name = name
        self.time_limit = time_limit
        description = self._fmu.description
        self.inputs: Sequence[str] = inputs_of(description)
        self.outputs: Sequence[str] = description.names("output")
        self.parameters = description.names("parameter")
        self.can_save = description.saves_state
        self.steps_vary = description.steps_vary
        self.sample_time, self.stop = 0.0, math.inf
        self._waiting: list[bytes] = []
        self._changes = 0  # number of requests that may have changed outputs
        self._bound = self._saved = 0
        self._stepping = False
        self._dead = ""
        self._printed = _Printed()
        folder = self._fmu.folder
        self._socket, self._process, held = start_host(
            isolated_host.__name__, folder, self._printed.descriptor
        )
        self._socket.settimeout(time_limit)
        self._end = weakref.finalize(self, _ended, self._process, self._socket, held)
        request = {
            "path": str(self._fmu.path),
            "folder": str(folder),
            "description": description.to_dict(),
            "name": name,
        }
        try:
            self._ask(Request.OPEN, json.dumps(request).encode())
        except FmuError as error:
            self._end()
            self._clean()
            words = self._printed.last_line()
            told = f"{error}; its last output: {words}" if words else str(error)
            raise FmuError(told) from error
        except StepFailed as error:
            self._end()
            self._clean()
            raise FmuError(f"{self._fmu.path}: cannot be instantiated: {error}") from error
        except BaseException:
            self._end()
            self._clean()
            raise

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        self.stop = stop
        request = json.dumps({"values": dict(values), "stop": stop}).encode()
        self._ask(Request.ENTER_INITIALIZATION, request)

    def leave_initialization(self) -> None:
        """As `FmuInstance.leave_initialization`.

        Raises
        ------
        StepFailed
            If the FMU rejects them, or its process ends.
        """
        data = self._ask(Request.LEAVE_INITIALIZATION)
        if len(data) != 8:
            raise self._lost(f"gave {len(data)} bytes for its sample time")
        (told,) = struct.unpack("<d", data)
        self.sample_time = told or self.sample_time

    def writer(self, names: Sequence[str]) -> Writer:
        number = self._bind(Request.BIND_WRITER, names)

        def write(values: Vector) -> None:
            self._tell(Request.WRITE, number + np.asarray(values, dtype=float).tobytes())

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        number, size = self._bind(Request.BIND_READER, names), 8 * len(names)
        known, read_after = np.zeros(0), -1

        def read() -> Vector:
            nonlocal known, read_after
            # a step begins with the end values of the last one: this saves half of all requests
            if read_after != self._changes or self._dead:
                data = self._ask(Request.READ, number)
                if len(data) != size:
                    raise self._lost(f"gave {len(data)} bytes for {', '.join(names)}")
                known, read_after = np.frombuffer(data), self._changes
            return known.copy()

        return read

    def _bind(self, request: Request, names: Sequence[str]) -> bytes:
        number = struct.pack("<I", self._bound)
        self._bound += 1
        self._tell(request, number + json.dumps(list(names)).encode())
        return number

    def step(self, t: float, h: float) -> None:
        """Move on; a failure shows when something is read."""
        self._tell(Request.STEP, struct.pack("<dd", t, h))
        self._stepping = True

    def save(self) -> Any:
        state = struct.pack("<Q", self._saved)
        self._saved += 1
        self._tell(Request.SAVE, state)
        return state

    def restore(self, state: Any) -> None:
        self._tell(Request.RESTORE, state)

    def release(self, state: Any) -> None:
        if not self._dead:
            self._tell(Request.RELEASE, state)

    def reopened(self) -> IsolatedInstance:
        other = IsolatedInstance(self._fmu, self.name, self.time_limit)
        other.sample_time, other.can_save = self.sample_time, self.can_save
        return other

    def close(self) -> None:
        if self._end.alive and not self._dead:
            self._socket.settimeout(min(self.time_limit, _FAREWELL))
            with contextlib.suppress(OSError, StepFailed, FmuError):
                self._ask(Request.CLOSE)
                self._process.wait(_FAREWELL)
        self._end()
        self._clean()

    def _tell(self, request: Request, data: bytes = b"") -> None:
        if request is not Request.READ:
            self._changes += 1
        self._waiting.append(struct.pack("<BI", request, len(data)) + data)

    def _ask(self, request: Request, data: bytes = b"") -> bytes:
        """Send everything that waits and this request; return its answer."""
        if self._dead:
            raise StepFailed(self._dead)
        self._tell(request, data)
        packet = b"".join(self._waiting)
        self._waiting.clear()
        try:
            send(self._socket, packet)
            answer = receive(self._socket)
        except TimeoutError:
            limit = f"{self.time_limit:g} s"
            call = Request.STEP if self._stepping else request
            what = f"did not answer the call {call.name.lower()} within {limit}"
            raise self._lost(what, "if it is only slow, use a longer --time-limit") from None
        except (OSError, EOFError):
            raise self._lost(self._how_it_ended()) from None
        self._stepping = False
        status, rest = answer[0] if answer else FAILED, answer[1:]
        if status == OK:
            return rest
        text = " ".join(rest.decode("utf-8", "replace").split())
        if status == REFUSED:
            raise FmuError(text)
        raise StepFailed(text, SHORTER if status == DISCARDED else "")

    def _lost(
        self, how: str, advice: str = "test this FMU alone: the error is in the FMU itself"
    ) -> StepFailed:
        self._dead = f"{self.name} ({self._fmu.path.name}) {how}"
        end_host(self._process)
        return StepFailed(self._dead, advice)

    def _how_it_ended(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_FAREWELL)
        code = self._process.returncode
        how = "closed the connection" if code is None else how_ended(code)
        last = self._printed.last_line()
        return f"{how}; its last output: {last}" if last else how


class _Printed:
    """The end of a process's output, read continuously, so that no disk or pipe is filled."""

    def __init__(self) -> None:
        self._end = b""
        reading, self.descriptor = os.pipe()
        self._reader = threading.Thread(target=self._read, args=(reading,), daemon=True)
        self._reader.start()

    def _read(self, descriptor: int) -> None:
        with open(descriptor, "rb", buffering=0) as stream:
            while data := stream.read(1 << 16):
                self._end = (self._end + data)[-_KEPT:]

    def last_line(self) -> str:
        """The last line of a process that has ended."""
        self._reader.join(_FAREWELL)
        lines = self._end.decode("utf-8", "replace").split("\n")
        return next((line.strip()[:200] for line in reversed(lines) if line.strip()), "")


def open_fmu(
    path: Path, name: str, isolate: bool | None = None, time_limit: float = TIME_LIMIT
) -> FmuInstance | IsolatedInstance:
    """Open an FMU in its own process if requested; default: if it was not written by this program.

    Raises
    ------
    FmuError
    """
    if is_ours(path) if isolate is None else not isolate:
        instance = FmuInstance(path, name)
        if not instance.description.once_per_process:
            return instance
        instance.close()  # co-runs need further instances
    return IsolatedInstance(path, name, time_limit)


def _ended(process: subprocess.Popen[bytes], *files: Any) -> None:
    end_host(process)
    for file in files:
        file.close()

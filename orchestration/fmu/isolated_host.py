"""The process that runs one FMU for `IsolatedInstance`, and the protocol of the two.

A packet is its length and then requests: each one is a kind, a length and its data. A packet gets
one answer, a status and data: from its last request, or from the first that fails; the requests
after that are dropped. No Python objects are exchanged: the FMU's side is not trusted.
"""

from __future__ import annotations

import enum
import json
import math
import os
import socket
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...fmus.reading import Description, UnpackedFmu
from ...solver.errors import FmuError
from .fmu_instance import SHORTER, FmuInstance, StepFailed

OK, FAILED, REFUSED, DISCARDED = range(4)
_HEAD = struct.Struct("<I")  # a packet's size
_AT_ONCE = 1 << 16  # bytes
_LARGEST = 1 << 28  # bytes of a packet


class Request(enum.IntEnum):
    OPEN = 1
    ENTER_INITIALIZATION = 2
    LEAVE_INITIALIZATION = 3
    BIND_WRITER = 4
    BIND_READER = 5
    WRITE = 6
    READ = 7
    STEP = 8
    SAVE = 9
    RESTORE = 10
    RELEASE = 11
    CLOSE = 12


def send(connection: socket.socket, data: bytes) -> None:
    connection.sendall(_HEAD.pack(len(data)) + data)


def receive(connection: socket.socket) -> bytes:
    """One packet.

    Raises
    ------
    EOFError
        If the connection is closed.
    TimeoutError
        If the connection has a time limit and it has passed.
    """
    limit = connection.gettimeout()
    end = math.inf if limit is None else time.monotonic() + limit
    data, whole = b"", _HEAD.size
    while len(data) < whole:  # almost always once: the next packet is sent after the answer
        if data and time.monotonic() > end:  # the socket's own limit is for each piece
            raise TimeoutError
        more = connection.recv(_AT_ONCE)
        data += more
        if len(data) >= _HEAD.size:
            whole = _HEAD.size + _HEAD.unpack_from(data)[0]
        if not more or whole > _LARGEST or len(data) > whole:
            raise EOFError
    return data[_HEAD.size :]


def main(connection: socket.socket) -> None:
    """Answer requests until the connection is closed, then end immediately."""
    host = _Host()
    closed = False
    while not closed:
        try:
            packet = receive(connection)
        except (EOFError, OSError):
            break
        try:
            answer = bytes([OK]) + host.answer(packet)
        except StepFailed as error:
            kind = DISCARDED if error.advice == SHORTER else FAILED
            answer = bytes([kind]) + str(error).encode()
        except FmuError as error:
            answer = bytes([REFUSED]) + str(error).encode()
        except Exception as error:
            answer = bytes([FAILED]) + f"{type(error).__name__}: {error}".encode()
        closed = host.closed
        send(connection, answer)
    # Without the interpreter's own end, in which a third-party library may still crash.
    os._exit(0)


class _Host:
    def __init__(self) -> None:
        self.closed = False
        self._bound: dict[bytes, Any] = {}
        self._states: dict[bytes, Any] = {}
        self._actions: dict[int, Callable[[bytes], bytes | None]] = {
            Request.OPEN: self._open,
            Request.ENTER_INITIALIZATION: self._enter,
            Request.LEAVE_INITIALIZATION: self._leave,
            Request.BIND_WRITER: self._bind_writer,
            Request.BIND_READER: self._bind_reader,
            Request.WRITE: lambda data: self._bound[data[:4]](np.frombuffer(data[4:])),
            Request.READ: lambda data: self._bound[data]().tobytes(),
            Request.STEP: lambda data: self._fmu.step(*struct.unpack("<dd", data)),
            Request.SAVE: self._save,
            Request.RESTORE: lambda data: self._fmu.restore(self._states[data]),
            Request.RELEASE: lambda data: self._fmu.release(self._states.pop(data)),
            Request.CLOSE: self._close,
        }

    def answer(self, packet: bytes) -> bytes:
        """Do every request of a packet; return the answer to the last."""
        at, result = 0, None
        while at < len(packet):
            kind, size = struct.unpack_from("<BI", packet, at)
            at += 5 + size
            result = self._actions[kind](packet[at - size : at])
        return result or b""

    def _open(self, data: bytes) -> None:
        request = json.loads(data)
        description = Description.from_dict(request["description"])
        unpacked = UnpackedFmu(Path(request["path"]), description, Path(request["folder"]))
        self._fmu = FmuInstance(unpacked, request["name"])

    def _enter(self, data: bytes) -> None:
        request = json.loads(data)
        self._fmu.enter(request["values"], request["stop"])

    def _leave(self, _data: bytes) -> bytes:
        self._fmu.leave_initialization()
        return struct.pack("<d", self._fmu.sample_time)

    def _bind_writer(self, data: bytes) -> None:
        self._bound[data[:4]] = self._fmu.writer(json.loads(data[4:]))

    def _bind_reader(self, data: bytes) -> None:
        self._bound[data[:4]] = self._fmu.reader(json.loads(data[4:]))

    def _save(self, data: bytes) -> None:
        self._states[data] = self._fmu.save()

    def _close(self, _data: bytes) -> None:
        self.closed = True
        self._fmu.close()

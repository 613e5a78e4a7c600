"""One FMU instance as the master sees it: named signals, steps, and saved states."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..fmus.process_end import end_cleanly
from ..fmus.reading import FmuError, UnpackedFmu, unpack

Vector = npt.NDArray[np.float64]

_SIGNALS = ctypes.CFUNCTYPE(
    ctypes.c_int,
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint),
    ctypes.c_size_t,
    ctypes.POINTER(ctypes.c_double),
)
_STEP = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
)
_STATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
_OK = 1  # fmi2OK or fmi2Warning

SAMPLE_TIME = "sample_time"


class StepFailed(RuntimeError):
    """A participant could not do a step; the message is its own, where it gave one."""


class Writer(Protocol):
    def __call__(self, values: Vector) -> None: ...


class Reader(Protocol):
    def __call__(self) -> Vector: ...


class Participant(Protocol):
    """What the master needs of anything that takes part in a loop.

    An implementation promises: `step` moves from t to t + h with its inputs held; after `restore`
    it goes on as it would have at `save`; `reopened` is a fresh instance of the same thing.
    """

    name: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    can_save: bool
    sample_time: float

    def nominal(self, name: str) -> float: ...
    def initialize(self, values: Mapping[str, float], stop: float) -> None: ...
    def writer(self, names: Sequence[str]) -> Writer: ...
    def reader(self, names: Sequence[str]) -> Reader: ...
    def step(self, t: float, h: float) -> None: ...
    def save(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def release(self, state: Any) -> None: ...
    def reopened(self) -> Participant: ...
    def close(self) -> None: ...


class FmuParticipant:
    """An FMI 2.0 co-simulation FMU, run in this process through fmpy's FMU2Slave.

    Parameters
    ----------
    source : path-like or UnpackedFmu
    name : str
        Instance name; also what the FMU is called in messages.

    Raises
    ------
    FmuError
        If the file is no FMU that can run here.
    """

    def __init__(self, source: Path | str | UnpackedFmu, name: str) -> None:
        from fmpy.fmi2 import FMU2Slave

        if isinstance(source, UnpackedFmu):
            self._fmu = source
        else:
            self._fmu = unpack(source)
            weakref.finalize(self, self._fmu.remove)
        self.name = name
        description = self._fmu.description
        self._real = {v.name: v for v in description.modelVariables if v.type == "Real"}
        self._message = next(
            (
                v.valueReference
                for v in description.modelVariables
                if v.type == "String" and v.name == "message" and v.causality == "output"
            ),
            None,
        )
        self.inputs: Sequence[str] = [n for n, v in self._real.items() if v.causality == "input"]
        self.outputs: Sequence[str] = [n for n, v in self._real.items() if v.causality == "output"]
        self.parameters: list[str] = [
            n for n, v in self._real.items() if v.causality == "parameter"
        ]
        self.can_save = bool(description.coSimulation.canGetAndSetFMUstate)
        self.sample_time = 0.0
        self._slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(self._fmu.folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self._open = False
        try:
            self._slave.instantiate()
        except Exception as error:
            raise FmuError(f"{self._fmu.path}: cannot be instantiated: {error}") from error
        self._open = True
        end_cleanly(Path(self._slave.dll._name))
        library = self._slave.dll
        self._set_real = _SIGNALS(("fmi2SetReal", library))
        self._get_real = _SIGNALS(("fmi2GetReal", library))
        self._do_step = _STEP(("fmi2DoStep", library))
        self._get_state = _STATE(("fmi2GetFMUstate", library))
        self._set_state = _STATE(("fmi2SetFMUstate", library))
        self._free_state = _STATE(("fmi2FreeFMUstate", library))
        self._component = ctypes.c_void_p(self._slave.component)

    @property
    def path(self) -> Path:
        return self._fmu.path

    def nominal(self, name: str) -> float:
        return abs(float(self._real[name].nominal or 1.0))

    def initialize(self, values: Mapping[str, float], stop: float) -> None:
        """Set parameters and start values, and go through initialization.

        Raises
        ------
        StepFailed
            If the FMU refuses.
        """
        try:
            self._slave.setupExperiment(startTime=0.0, stopTime=stop)
            for name, value in values.items():
                self._slave.setReal([self._real[name].valueReference], [value])
            self._slave.enterInitializationMode()
            self._slave.exitInitializationMode()
            if SAMPLE_TIME in self.parameters:
                self.sample_time = float(
                    self._slave.getReal([self._real[SAMPLE_TIME].valueReference])[0]
                )
        except Exception as error:
            raise StepFailed(f"{self.name}: {self.message() or error}") from error
        if self.message():
            raise StepFailed(self.message())

    def message(self) -> str:
        """What the FMU says of its failure, if it is one of ours; else empty."""
        if self._message is None:
            return ""
        (text,) = self._slave.getString([self._message])
        return str(text.decode("utf-8", "replace"))

    def writer(self, names: Sequence[str]) -> Writer:
        references, buffer, pointer = self._bind(names)
        call, component, n = self._set_real, self._component, len(names)

        def write(values: Vector) -> None:
            buffer[:] = values
            if n and call(component, references, n, pointer) > _OK:
                raise StepFailed(f"{self.name}: refuses the values of {', '.join(names)}")

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        references, buffer, pointer = self._bind(names)
        call, component, n = self._get_real, self._component, len(names)

        def read() -> Vector:
            if n and call(component, references, n, pointer) > _OK:
                raise StepFailed(f"{self.name}: cannot give {', '.join(names)}")
            return buffer.copy()

        return read

    def _bind(self, names: Sequence[str]) -> tuple[Any, Vector, Any]:
        references = (ctypes.c_uint * len(names))(*(self._real[n].valueReference for n in names))
        buffer = np.zeros(len(names))
        return references, buffer, buffer.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def step(self, t: float, h: float) -> None:
        status = self._do_step(self._component, t, h, 1)
        if status > _OK:
            raise StepFailed(
                self.message()
                or f"{self.name}: the step from t = {t:.9g} s failed with FMI status {status}"
            )

    def save(self) -> Any:
        state = ctypes.c_void_p()
        if self._get_state(self._component, ctypes.addressof(state)) > _OK:
            raise StepFailed(f"{self.name}: cannot save its state")
        return state

    def restore(self, state: Any) -> None:
        if self._set_state(self._component, state) > _OK:
            raise StepFailed(f"{self.name}: cannot restore its state")

    def release(self, state: Any) -> None:
        self._free_state(self._component, ctypes.addressof(state))

    def reopened(self) -> FmuParticipant:
        return FmuParticipant(self._fmu, self.name)

    def close(self) -> None:
        if self._open:
            self._open = False
            try:
                self._slave.terminate()
            finally:
                self._slave.freeInstance()

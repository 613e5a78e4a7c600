"""One FMU instance as the master sees it: named signals, steps, and saved states."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import itertools
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ..fmus.process_end import end_cleanly
from ..fmus.reading import Description, FmuError, UnpackedFmu, unpack

Vector = npt.NDArray[np.float64]

# fmi2SetReal and fmi2GetReal, fmi2DoStep, and those of saved states
SIGNALS = ctypes.CFUNCTYPE(
    ctypes.c_int,
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint),
    ctypes.c_size_t,
    ctypes.POINTER(ctypes.c_double),
)
STEP = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
)
STATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
ENTRY_POINTS = (
    "component",
    "set_real",
    "get_real",
    "do_step",
    "get_state",
    "set_state",
    "free_state",
)
OK, _DISCARD, _FATAL = 1, 2, 4  # fmi2Warning counts as OK
_LOGGED: dict[int, str] = {}
_LOG_NUMBERS = itertools.count(1)

SAMPLE_TIME = "sample_time"


class StepFailed(RuntimeError):
    """A FMU instance could not do a step; the message is its own, where it gave one.

    Attributes
    ----------
    advice : str
        What the user can do.
    """

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice or (
            "use a smaller --step; if it ends the same way, the loop itself is unstable or a "
            "parameter is wrong"
        )


class Writer(Protocol):
    def __call__(self, values: Vector) -> None: ...


class Reader(Protocol):
    def __call__(self) -> Vector: ...


class Instance(Protocol):
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
    def follows_at_once(self, name: str) -> bool: ...
    def initialize(self, values: Mapping[str, float], stop: float) -> None: ...
    def writer(self, names: Sequence[str]) -> Writer: ...
    def reader(self, names: Sequence[str]) -> Reader: ...
    def step(self, t: float, h: float) -> None: ...
    def save(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def release(self, state: Any) -> None: ...
    def reopened(self) -> Instance: ...
    def close(self) -> None: ...


class FmuInstance:
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
        self._fmu, self._clean = opened_source(self, source)
        self.name = name
        description = self.description
        self._real = {v.name: v for v in description.variables if v.type == "Real"}
        self._numbers = {v.name: v for v in description.variables}
        self.inputs: Sequence[str] = description.names("input")
        self.outputs: Sequence[str] = description.names("output")
        self.parameters = description.names("parameter")
        self.can_save = description.saves_state
        self.sample_time = 0.0
        self._log = next(_LOG_NUMBERS)
        self._status = 0  # the worst yet
        try:
            self._slave = self._instantiated()
        except BaseException:
            self._clean()
            raise
        self._open = True
        library = self._slave.dll
        end_cleanly(Path(library._name))
        self._set_real = SIGNALS(("fmi2SetReal", library))
        self._get_real = SIGNALS(("fmi2GetReal", library))
        self._do_step = STEP(("fmi2DoStep", library))
        self._get_state = STATE(("fmi2GetFMUstate", library))
        self._set_state = STATE(("fmi2SetFMUstate", library))
        self._free_state = STATE(("fmi2FreeFMUstate", library))
        self._component = ctypes.c_void_p(self._slave.component)

    @property
    def description(self) -> Description:
        return self._fmu.description

    def _instantiated(self) -> Any:
        from fmpy import calloc, fmi2, free

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = _logger()
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        callbacks.componentEnvironment = self._log
        try:
            slave = fmi2.FMU2Slave(
                guid=self._fmu.description.guid,
                unzipDirectory=str(self._fmu.folder),
                modelIdentifier=self._fmu.description.identifier,
                instanceName=self.name,
            )
            slave.instantiate(callbacks=callbacks, loggingOn=True)
        except Exception as error:
            reason = _LOGGED.get(self._log) or str(error)
            raise FmuError(f"{self._fmu.path}: cannot be instantiated: {reason}") from error
        return slave

    def nominal(self, name: str) -> float:
        return self._real[name].nominal

    def follows_at_once(self, name: str) -> bool:
        """Whether an output may follow inputs without a step, as far as the FMU says."""
        return self._real[name].direct

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
                variable = self._numbers[name]
                setters = {
                    "Real": self._slave.setReal,
                    "Integer": self._slave.setInteger,
                    "Boolean": self._slave.setBoolean,
                }
                setters[variable.type]([variable.reference], [value])
            self._slave.enterInitializationMode()
            self._slave.exitInitializationMode()
            if SAMPLE_TIME in self.parameters:
                self.sample_time = float(
                    self._slave.getReal([self._real[SAMPLE_TIME].reference])[0]
                )
        except Exception as error:
            status = getattr(error, "status", _FATAL)
            raise self.failed(status, f"cannot be initialized: {error}") from error
        if self.message():
            raise StepFailed(self.message())

    def message(self) -> str:
        """What the FMU says of its failure: ours in an output for it, others in their log."""
        reference = self._fmu.description.message_reference
        if reference is None:
            return _LOGGED.get(self._log, "")
        (text,) = self._slave.getString([reference])
        return str(text.decode("utf-8", "replace"))

    def writer(self, names: Sequence[str]) -> Writer:
        references, buffer, pointer = self._bind(names)
        call, component, n = self._set_real, self._component, len(names)

        def write(values: Vector) -> None:
            buffer[:] = values
            if n and (status := call(component, references, n, pointer)) > OK:
                raise self.failed(status, f"refuses the values of {', '.join(names)}")

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        references, buffer, pointer = self._bind(names)
        call, component, n = self._get_real, self._component, len(names)

        def read() -> Vector:
            if n and (status := call(component, references, n, pointer)) > OK:
                raise self.failed(status, f"cannot give {', '.join(names)}")
            return buffer.copy()

        return read

    def _bind(self, names: Sequence[str]) -> tuple[Any, Vector, Any]:
        references = (ctypes.c_uint * len(names))(*self.references(names))
        buffer = np.zeros(len(names))
        return references, buffer, buffer.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def step(self, t: float, h: float) -> None:
        status = self._do_step(self._component, t, h, 1)
        if status > OK:
            raise self.failed(status, f"the step failed with FMI status {status}")

    def save(self) -> Any:
        state = ctypes.c_void_p()
        status = self._get_state(self._component, ctypes.addressof(state))
        if status > OK:
            raise self.failed(status, "cannot save its state")
        return state

    def restore(self, state: Any) -> None:
        status = self._set_state(self._component, state)
        if status > OK:
            raise self.failed(status, "cannot restore its state")

    def entry_points(self) -> tuple[int, ...]:
        """Addresses of the instance and of its functions, in the order of `ENTRY_POINTS`."""
        calls = (
            self._set_real,
            self._get_real,
            self._do_step,
            self._get_state,
            self._set_state,
            self._free_state,
        )
        addresses = (ctypes.cast(call, ctypes.c_void_p).value or 0 for call in calls)
        return (self._component.value or 0, *addresses)

    def references(self, names: Sequence[str]) -> list[int]:
        """Value references of real variables."""
        return [self._real[n].reference for n in names]

    def failed(self, status: int, what: str) -> StepFailed:
        """The error for a call that ended with this status, with the FMU's own words."""
        self._status = max(self._status, status)
        reason = self.message() if status < _FATAL else _LOGGED.get(self._log, "")
        if reason.startswith(f"{self.name}: "):  # ours put the instance's name first
            return StepFailed(reason)
        whose = f"{self.name} ({self._fmu.path.name})"
        return StepFailed(f"{whose}: {what}{': ' if reason else ''}{' '.join(reason.split())}")

    def release(self, state: Any) -> None:
        self._free_state(self._component, ctypes.addressof(state))

    def reopened(self) -> FmuInstance:
        other = FmuInstance(self._fmu, self.name)
        other.sample_time = self.sample_time
        return other

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        _LOGGED.pop(self._log, None)
        self._clean()
        if self._status >= _FATAL:
            return  # FMI allows no call any more
        # what it computed is read already: a bad end changes nothing
        with contextlib.suppress(Exception):
            if self._status <= OK:
                self._slave.terminate()
        self._slave.freeInstance()


def opened_source(
    owner: object, source: Path | str | UnpackedFmu
) -> tuple[UnpackedFmu, Callable[[], object]]:
    """The FMU unpacked, and how to remove a folder made for `owner`, which ends with it anyway."""
    if isinstance(source, UnpackedFmu):
        return source, lambda: None
    fmu = unpack(source)
    return fmu, weakref.finalize(owner, fmu.remove)


@functools.cache
def _logger() -> Any:
    """What FMUs call to log: keeps the last error of each instance."""
    from fmpy import fmi2

    def log(environment: int, _name: bytes, status: int, _category: bytes, text: bytes) -> None:
        if status > _DISCARD and text:
            _LOGGED[environment or 0] = text.decode("utf-8", "replace").strip()

    return fmi2.fmi2CallbackLoggerTYPE(log)

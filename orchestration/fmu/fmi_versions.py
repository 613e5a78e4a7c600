"""The functions of FMI 2.0 and 3.0, for co-simulation and model exchange, with common names."""

from __future__ import annotations

import contextlib
import ctypes
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ...fmus.process_end import end_cleanly
from ...fmus.reading import WHOLE, NumberVariable, UnpackedFmu
from ...solver.arrays import Vector

Types = dict[str, tuple[str, npt.DTypeLike]]
"""By type: the name of its calls after the verb, and how its values are kept."""

# fmi2DoStep, and the functions of saved states in both versions
STEP = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
)
STATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
OK, DISCARD, ERROR, FATAL = 1, 2, 3, 4  # of a call; a warning counts as OK
END = "requested the end of the simulation at t = {:g} s"


class Refused(RuntimeError):
    """An FMU rejected a call, with a status of FMI."""

    def __init__(self, message: str, status: int = ERROR) -> None:
        super().__init__(message)
        self.status = status


class Ports:
    """Variables of one type, to be set or read in one call."""

    def __init__(
        self, variables: Sequence[NumberVariable], function: str, kind: npt.DTypeLike
    ) -> None:
        self.names = [v.name for v in variables]
        self.function = function
        self.references = (ctypes.c_uint * len(variables))(*(v.reference for v in variables))
        self.values = np.zeros(len(variables), dtype=kind)
        pointer = ctypes.POINTER(np.ctypeslib.as_ctypes_type(self.values.dtype))
        self.pointer = self.values.ctypes.data_as(pointer)
        self._type = variables[0].type
        # the first number above the largest
        self._low, self._end = 0.0, 2.0
        if self._type in WHOLE and self._type != "Boolean":
            size = np.iinfo(self.values.dtype)
            self._low, self._end = float(size.min), float(size.max) + 1.0

    def put(self, values: Vector) -> None:
        """Store values for the next call; raises `Refused` if the type does not hold one."""
        if self._type in WHOLE:
            fit = (values == np.rint(values)) & (values >= self._low) & (values < self._end)
            if not fit.all():
                at = int(np.argmin(fit))
                wanted = "0 or 1" if self._type == "Boolean" else "a whole number in its range"
                raise Refused(
                    f"{self.names[at]} is of type {self._type} and was given {values[at]:g}, "
                    f"expected {wanted}"
                )
        self.values[:] = values


class Fmi2:
    """The calls of one FMU of FMI 2.0; `open` makes the instance."""

    _VERSION = "fmi2"
    _STATE = "FMUstate"
    _TYPES: ClassVar[Types] = {
        "Real": ("Real", np.float64),
        "Integer": ("Integer", np.int32),
        "Enumeration": ("Integer", np.int32),
        "Boolean": ("Boolean", np.int32),
    }

    def __init__(self, fmu: UnpackedFmu, name: str) -> None:
        self._description = fmu.description
        self._told = {
            "guid": fmu.description.guid,
            "unzipDirectory": str(fmu.folder),
            "modelIdentifier": fmu.description.identifier,
            "instanceName": name,
        }
        self.words = ""  # the last error that it logged
        self.ended = ""  # when it requested the end of the simulation
        self.integrator: Any = None  # for model exchange, after initialization

    def open(self) -> None:
        """Make the instance; what is raised says why it cannot be made, if `words` do not."""
        self._fmu = self._instantiated()
        self.library = self._fmu.dll
        end_cleanly(Path(self.library._name))
        self.component = ctypes.c_void_p(self._fmu.component)
        self.get_state, self.set_state, self.free_state = (
            STATE((f"{self._VERSION}{verb}{self._STATE}", self.library))
            for verb in ("Get", "Set", "Free")
        )

    def _instantiated(self) -> Any:
        from fmpy import calloc, fmi2, free

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._hear)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        kind = fmi2.FMU2Model if self._description.exchanges else fmi2.FMU2Slave
        instance = kind(**self._told)
        instance.instantiate(callbacks=callbacks, loggingOn=True)
        return instance

    def _hear(self, *told: Any) -> None:
        """Both versions' callback for a log message: it ends with status, category and text."""
        status, text = told[-3], told[-1]
        if status > DISCARD and text:
            self.words = text.decode("utf-8", "replace").strip()

    def ports(self, variables: Sequence[NumberVariable]) -> Ports:
        return Ports(variables, *self._TYPES[variables[0].type])

    def transfer(self, verb: str, ports: Ports) -> int:
        """Set or get; the FMI status."""
        call = getattr(self.library, f"{self._VERSION}{verb}{ports.function}")
        count = len(ports.references)
        counted = [count] if self._VERSION == "fmi3" else []  # of values
        return int(call(self.component, ports.references, count, ports.pointer, *counted))

    def text(self, reference: int) -> str:
        (text,) = self._fmu.getString([reference])
        return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)

    def set_text(self, reference: int, text: str) -> None:
        self._fmu.setString([reference], [text])

    def set_up(self, stop: float) -> None:
        """Do the calls before start values are set."""
        self._fmu.setupExperiment(startTime=0.0, stopTime=stop)

    def enter(self, stop: float) -> None:
        """Enter initialization mode."""
        self._fmu.enterInitializationMode()

    def leave(self) -> None:
        """Leave initialization mode."""
        self._fmu.exitInitializationMode()
        if self._description.exchanges:
            from .model_exchange import Integrator

            has_inputs = bool(self._description.names("input"))
            self.integrator = Integrator(self._fmu, *self._sizes(), has_inputs)

    def _sizes(self) -> tuple[int, int]:
        """Numbers of states and event indicators."""
        return self._description.states, self._description.indicators

    @property
    def place(self) -> tuple[Any, ...]:
        """Data that are not in a saved state of the FMU."""
        if self.integrator is None:
            return (self.ended,)
        return self.ended, self.integrator.time, self.integrator.next_event

    @place.setter
    def place(self, place: tuple[Any, ...]) -> None:
        self.ended = place[0]
        if self.integrator is not None:
            _, self.integrator.time, self.integrator.next_event = place

    @functools.cached_property
    def do_step(self) -> Any:
        """The FMU's own function, also for compiled code."""
        return STEP(("fmi2DoStep", self.library))

    def step(self, t: float, h: float) -> int:
        """Move from t to t + h; the FMI status. Raises `Refused` if the simulation was ended."""
        if self.ended:
            raise Refused(self.ended, DISCARD)
        if self.integrator is None:
            return self._co_step(t, h)
        self.integrator.step(t + h)
        return self._end(self.integrator.time, t, h) if self.integrator.ends else 0

    def _co_step(self, t: float, h: float) -> int:
        status = int(self.do_step(self.component, t, h, 1))
        if status == DISCARD and (reached := self.asked_end()) is not None:
            return self._end(reached, t, h)
        return status

    def asked_end(self) -> float | None:
        """After a discarded step, the end that the FMU requests; None if the step is too long."""
        from fmpy import fmi2
        from fmpy.fmi1 import FMICallException

        with contextlib.suppress(FMICallException):  # not all answer this
            if self._fmu.getBooleanStatus(fmi2.fmi2Terminated):
                return float(self._fmu.getRealStatus(fmi2.fmi2LastSuccessfulTime))
        return None

    def _end(self, reached: float, t: float, h: float) -> int:
        self.ended = END.format(reached)
        if reached < t + h * (1 - 1e-9):
            raise Refused(self.ended, DISCARD)
        return 0

    def terminate(self) -> None:
        self._fmu.terminate()

    def free(self) -> None:
        self._fmu.freeInstance()


class Fmi3(Fmi2):
    """The calls of one FMU of FMI 3.0; of co-simulation without event mode and early return."""

    _VERSION = "fmi3"
    _STATE = "FMUState"
    _TYPES: ClassVar[Types] = {
        "Float64": ("Float64", np.float64),
        "Float32": ("Float32", np.float32),
        "Boolean": ("Boolean", np.bool_),
        "Enumeration": ("Int64", np.int64),
        **{
            f"{sign}Int{bits}": (f"{sign}Int{bits}", np.dtype(f"{sign}Int{bits}".lower()))
            for sign in ("", "U")
            for bits in (8, 16, 32, 64)
        },
    }

    def _instantiated(self) -> Any:
        from fmpy import fmi3

        kind = fmi3.FMU3Model if self._description.exchanges else fmi3.FMU3Slave
        instance = kind(**self._told)
        instance.instantiate(loggingOn=True, logMessage=self._hear)
        return instance

    def set_up(self, stop: float) -> None:
        pass

    def enter(self, stop: float) -> None:
        self._fmu.enterInitializationMode(startTime=0.0, stopTime=stop)

    def _sizes(self) -> tuple[int, int]:
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()

    def _co_step(self, t: float, h: float) -> int:
        _, ends, early, reached = self._fmu.doStep(t, h)
        if ends:
            return self._end(reached, t, h)
        if early:
            raise Refused(
                f"stopped at t = {reached:g} s although early return is not allowed", DISCARD
            )
        return 0

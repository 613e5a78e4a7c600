"""The functions of FMI 2.0 and 3.0, for co-simulation and model exchange, with common names."""

from __future__ import annotations

import contextlib
import ctypes
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from ...fmus.process_end import end_cleanly
from ...fmus.reading import SIZED, WHOLE, NumberVariable, UnpackedFmu
from ...solver.arrays import Vector

if TYPE_CHECKING:
    from .model_exchange import Integrator

# by type: the name of its calls after the verb, and how its values are kept
Types = dict[str, tuple[str, npt.DTypeLike]]

# fmi2DoStep, and the functions of saved states in both versions, for those made here
STEP = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
)
STATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
OK, DISCARD, ERROR, FATAL = 1, 2, 3, 4  # of a call; a warning counts as OK
SAME = 1e-9  # largest difference of equal times, as a share of them


class Refused(RuntimeError):
    """An FMU rejected a call, with a status of FMI."""

    def __init__(self, message: str, status: int = ERROR) -> None:
        super().__init__(message)
        self.status = status


class Ports:
    """Variables of one type, to be set or read in one call."""

    def __init__(self, variables: list[NumberVariable], function: str, kind: npt.DTypeLike) -> None:
        self.names = [v.name for v in variables]
        self.function = function
        self.references = (ctypes.c_uint * len(variables))(*(v.reference for v in variables))
        self.values = np.zeros(len(variables), dtype=kind)
        self.cells = np.ctypeslib.as_ctypes(self.values)  # the same, for a call
        self._type = variables[0].type
        self._low, self._end = 0.0, 2.0  # the first number above the largest
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
                said = f"{self.names[at]} is of type {self._type} and was given {values[at]:g}"
                raise Refused(f"{said}, expected {wanted}")
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

    def __init__(self) -> None:
        self.words = ""  # the last error that it logged
        self.end = math.inf  # when it requested the end of the simulation [s]
        self.integrator: Integrator | None = None  # for model exchange, after initialization

    def open(self, fmu: UnpackedFmu, name: str) -> None:
        """Make the instance; what is raised says why it cannot be made, if `words` do not."""
        self.description = fmu.description
        self.fmu = self._instantiated(
            guid=fmu.description.guid,
            unzipDirectory=str(fmu.folder),
            modelIdentifier=fmu.description.identifier,
            instanceName=name,
        )
        self.library = self.fmu.dll
        end_cleanly(Path(self.library._name))
        self.component = ctypes.c_void_p(self.fmu.component)
        self.states = [self.call(verb, self._STATE) for verb in ("Get", "Set", "Free")]

    def _instantiated(self, **arguments: str) -> Any:
        from fmpy import calloc, fmi2, free

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._hear)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        fmu = (fmi2.FMU2Model if self.description.exchanges else fmi2.FMU2Slave)(**arguments)
        fmu.instantiate(callbacks=callbacks, loggingOn=True)
        return fmu

    def _hear(self, *arguments: Any) -> None:
        """Both versions' callback for a log message: it ends with status, category and text."""
        status, text = arguments[-3], arguments[-1]
        if status > DISCARD and text:
            self.words = text.decode("utf-8", "replace").strip()

    def call(self, verb: str, what: str) -> Any:
        """A function of the FMU; its arguments are checked as fmpy declares them."""
        return getattr(self.library, f"{self._VERSION}{verb}{what}")

    def ports(self, variables: list[NumberVariable]) -> Ports:
        return Ports(variables, *self._TYPES[variables[0].type])

    def transfer(self, verb: str, ports: Ports) -> int:
        """Set or get; the FMI status."""
        count = len(ports.references)
        counted = [count] if self._VERSION == "fmi3" else []  # of values
        call = self.call(verb, ports.function)
        return int(call(self.component, ports.references, count, ports.cells, *counted))

    def set_up(self, stop: float) -> None:
        """Do the calls before start values are set."""
        self.fmu.setupExperiment(startTime=0.0, stopTime=stop)

    def enter(self, stop: float) -> None:
        """Enter initialization mode."""
        self.fmu.enterInitializationMode()

    def sizes(self) -> tuple[int, int]:
        """Numbers of states and event indicators."""
        return self.description.states, self.description.indicators

    def step(self, t: float, h: float) -> int:
        """Move from t to t + h; the FMI status. Raises `Refused` beyond its end."""
        if t >= self.end * (1 - SAME):
            raise Refused(self.ending, DISCARD)
        self.end = math.inf  # also where an earlier state was restored
        status = self._co_step(t, h) if self.integrator is None else 0
        if self.integrator and self.integrator.step(t, t + h):
            self.end = self.integrator.time
        if self.end < t + h * (1 - SAME):
            raise Refused(self.ending, DISCARD)
        return status if self.end == math.inf else 0

    def _co_step(self, t: float, h: float) -> int:
        status = int(self.library.fmi2DoStep(self.component, t, h, 1))
        if status == DISCARD:
            self.ask_for_end()
        return status

    def ask_for_end(self) -> None:
        """After a discarded step: whether the FMU requests the end; else the step is too long."""
        from fmpy import fmi2
        from fmpy.fmi1 import FMICallException

        with contextlib.suppress(FMICallException):  # not all answer this
            if self.fmu.getBooleanStatus(fmi2.fmi2Terminated):
                self.end = float(self.fmu.getRealStatus(fmi2.fmi2LastSuccessfulTime))

    @property
    def ending(self) -> str:
        return f"requested the end of the simulation at t = {self.end:g} s"


class Fmi3(Fmi2):
    """The calls of one FMU of FMI 3.0; of co-simulation without event mode and early return."""

    _VERSION = "fmi3"
    _STATE = "FMUState"
    _TYPES: ClassVar[Types] = {
        "Float64": ("Float64", np.float64),
        "Float32": ("Float32", np.float32),
        "Boolean": ("Boolean", np.bool_),
        "Enumeration": ("Int64", np.int64),
        **{name: (name, np.dtype(name.lower())) for name in SIZED},
    }

    def _instantiated(self, **arguments: str) -> Any:
        from fmpy import fmi3

        fmu = (fmi3.FMU3Model if self.description.exchanges else fmi3.FMU3Slave)(**arguments)
        fmu.instantiate(loggingOn=True, logMessage=self._hear)
        return fmu

    def set_up(self, stop: float) -> None:
        pass

    def enter(self, stop: float) -> None:
        self.fmu.enterInitializationMode(startTime=0.0, stopTime=stop)

    def sizes(self) -> tuple[int, int]:
        return self.fmu.getNumberOfContinuousStates(), self.fmu.getNumberOfEventIndicators()

    def _co_step(self, t: float, h: float) -> int:
        _, ends, early, reached = self.fmu.doStep(t, h)
        if early and not ends:
            raise Refused(f"stopped at t = {reached:g} s: early return is not allowed", DISCARD)
        self.end = reached if ends else math.inf
        return 0

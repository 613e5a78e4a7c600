"""Move a model-exchange FMU through time: CVODE between events, and the events."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from fmpy.sundials import CVodeSolver, byref
from fmpy.sundials.cvode import CV_ROOT_RETURN, CVode
from fmpy.sundials.libraries import sundials_core, sundials_cvode
from fmpy.sundials.sundials_context import SUNContext_PushErrHandler

from .fmi_versions import DISCARD, ERROR, Refused

TOLERANCE = 1e-10  # relative; the absolute one is this share of each state's nominal value
_MOST_STEPS = 100_000  # of CVODE in one communication step
_SAME = 1e-13  # largest difference of equal times, as a share of them
_ONE_STEP = 2  # CV_ONE_STEP
_RECOVERABLE, _FAILED = 1, -1
_HELD = SimpleNamespace(apply=lambda t: None)  # inputs, over a step

_stop_at = sundials_cvode.CVodeSetStopTime
_stop_at.argtypes = [ctypes.c_void_p, ctypes.c_double]
_warn_at_most = sundials_cvode.CVodeSetMaxHnilWarns
_warn_at_most.argtypes = [ctypes.c_void_p, ctypes.c_int]


class _Cvode(CVodeSolver):  # type: ignore[misc]
    """fmpy's CVODE, one step at a time, that raises the errors of the FMU."""

    error: Exception | None = None

    def __init__(self, **options: Any) -> None:
        super().__init__(input=_HELD, startTime=0.0, relativeTolerance=TOLERANCE, **options)
        _warn_at_most(self.cvode_mem, -1)
        sundials_core.SUNContext_ClearErrHandlers(self.sunctx)  # removes the one that prints
        SUNContext_PushErrHandler(self.sunctx, self.ehfun_, None)

    def f(self, *given: Any) -> int:
        return self._guarded(super().f, given)

    def g(self, *given: Any) -> int:
        return self._guarded(super().g, given)

    def _guarded(self, call: Callable[..., int], given: tuple[Any, ...]) -> int:
        try:
            return call(*given)
        except Exception as error:  # which must not pass through compiled code
            self.error = error
            discards = getattr(error, "status", ERROR) == DISCARD
            return _RECOVERABLE if discards else _FAILED

    def advance(self, until: float) -> tuple[bool, float]:
        """Do one step, at most to a time; return if an event indicator changed sign, and when."""
        reached = ctypes.c_double()
        _stop_at(self.cvode_mem, until)
        flag = CVode(self.cvode_mem, until, self.x, byref(reached), _ONE_STEP)
        if flag < 0:
            if self.error is not None:
                raise self.error
            raise Refused(f"CVODE failed: {(self.error_info or [f'code {flag}'])[-1]}")
        if not self.discrete:
            self.set_x(self.px, self.nx)
        self.set_time(reached.value)
        return flag == CV_ROOT_RETURN, reached.value


class Integrator:
    """Does communication steps of a model-exchange FMU. Between them it is in event mode.

    Every step restarts CVODE, so that it depends only on the FMU's state. If the FMU has inputs, a
    time event at the end of a step is left to the next step: only then do the inputs have their
    values of that time, and a sampled controller reads them in its event.

    The model is fmpy's FMU2Model or FMU3Model, just initialized, at time 0; `states` and
    `indicators` are numbers of them; `time` [s] is the one that was reached.
    """

    def __init__(self, model: Any, states: int, indicators: int, has_inputs: bool) -> None:
        self._model, self._has_inputs = model, has_inputs
        three = hasattr(model, "updateDiscreteStates")
        self._update = model.updateDiscreteStates if three else model.newDiscreteStates
        self.time, self._next_event, self._ends = 0.0, math.inf, False
        if not has_inputs:
            self._settle()
        self._solver = _Cvode(
            nx=states,
            nz=indicators,
            get_x=model.getContinuousStates,
            set_x=model.setContinuousStates,
            get_dx=model.getContinuousStateDerivatives if three else model.getDerivatives,
            get_z=model.getEventIndicators,
            get_nominals=model.getNominalsOfContinuousStates,
            set_time=model.setTime,
        )

    def step(self, start: float, end: float) -> bool:
        """Move to a time, or until the FMU requests the end: whether it did.

        Raises `Refused`, FMICallException.
        """
        if not _reached(start, self.time):  # an earlier state was restored
            self.time = start
        self._settle()  # changes by the inputs
        self._resume()
        left = _MOST_STEPS
        while not self._ends and not _reached(self.time, end):
            if not (left := left - 1):
                raise Refused(f"CVODE is at t = {self.time:g} s after {_MOST_STEPS} steps")
            changes = False
            until = min(end, self._next_event)
            if not _reached(self.time, until):
                changes, self.time = self._solver.advance(until)
            if due := _reached(self.time, self._next_event):  # its own number, to the last digit
                self.time = max(self.time, self._next_event)
                self._model.setTime(self.time)
            asks, self._ends = self._model.completedIntegratorStep()
            waits = self._has_inputs and _reached(self.time, end)
            if not self._ends and (changes or asks or (due and not waits)):
                self._model.enterEventMode()
                self._settle()
                self._resume()
        if not self._ends:
            self._model.enterEventMode()
            if not (self._has_inputs and _reached(end, self._next_event)):
                self._settle()
        return self._ends

    def _resume(self) -> None:
        """Enter continuous time, except if the FMU requested the end."""
        if not self._ends:
            self._model.enterContinuousTimeMode()
            self._solver.error = None
            self._solver.reset(self.time)

    def _settle(self) -> None:
        """Find the discrete states at an event."""
        again = True
        while again:
            again, self._ends, _, _, defined, when = self._update()
            again = again and not self._ends
        self._next_event = when if defined else math.inf


def _reached(time: float, wanted: float) -> bool:
    return wanted - time <= _SAME * max(1.0, abs(time))

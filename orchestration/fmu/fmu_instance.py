"""Interface of an FMU instance for the master: named signals, steps, and saved states."""

from __future__ import annotations

import contextlib
import ctypes
import math
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, Self, TypeAlias

import numpy as np

from ...fmus.ports import law_ports
from ...fmus.reading import SETTABLE, Description, UnpackedFmu, unpack
from ...solver.arrays import Vector
from ...solver.errors import FmuError, UserError
from .fmi_versions import DISCARD, FATAL, OK, SAME, Fmi2, Fmi3, Ports, Refused

ENTRY_POINTS = "component set_real get_real do_step get_state set_state free_state".split()
PUT, TAKE, MOVE, SAVE, RESTORE = range(5)  # kinds of failed calls, as in ``master/c/calls.h``
_FAILED = ["rejects the values of", "cannot give", "the step ended with"]
_FAILED += ["cannot save its state", "cannot restore its state"]
SAMPLE_TIME = "sample_time"
AS_PRINTED = 1e-6  # of a start value: what a tool that prints few digits may change
SHORTER = "it needs shorter communication steps"
_ADVICE = "use shorter communication steps; if the result is the same, the loop itself is unstable"
_ADVICE += " or a parameter is wrong"

Value: TypeAlias = "float | str"  # value of a parameter: a number, or the text of a String
Writer: TypeAlias = Callable[[Vector], None]
Reader: TypeAlias = Callable[[], Vector]


class StepFailed(UserError, RuntimeError):
    """An FMU instance could not do a step; the message comes from the FMU, if it gave one.

    `advice` is for the user.
    """

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice or _ADVICE


class Instance(Protocol):
    """Interface of any participant in a loop.

    Rules for an implementation: between `enter_initialization` and `leave_initialization`
    inputs can be set and outputs read repeatedly; `reopened` is a new instance of the same FMU.
    What fails raises `StepFailed`.
    """

    name: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    sample_time: float

    @property
    def can_save(self) -> bool: ...
    def nominal(self, name: str) -> float: ...
    def is_real(self, name: str) -> bool: ...
    def follows_at_once(self, name: str) -> bool: ...
    def initially_from(self, name: str) -> Sequence[str]: ...
    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None: ...
    def leave_initialization(self) -> None: ...
    def writer(self, names: Sequence[str]) -> Writer: ...
    def reader(self, names: Sequence[str]) -> Reader: ...
    def reopened(self) -> Instance: ...
    def close(self) -> None: ...

    def initialize(self, values: Mapping[str, Value], stop: float) -> None:
        """Go through initialization alone."""
        self.enter_initialization(values, stop)
        self.leave_initialization()


class Stepped(Instance, Protocol):
    """An instance that has methods for its steps; those of a group are in compiled code.

    `step` moves from t to t + h with its inputs held; after `restore` it continues exactly as
    after `save`.
    """

    def step(self, t: float, h: float) -> None: ...
    def save(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def release(self, state: Any) -> None: ...
    def reopened(self) -> Stepped: ...


class Wrapped:
    """An instance with something changed; the rest is passed on to it."""

    initialize = Instance.initialize

    def __init__(self, instance: Instance) -> None:
        self._instance = instance

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instance, name)


class AnyFmu(Stepped):
    """Common part of FMU instances in this or another process."""

    can_save = False  # as declared, until a trial shows that it cannot
    sample_time, stop = 0.0, math.inf
    # after initialization: texts on values that the FMU did not have, or does not take; parameters
    # that could not be set, with the values that the FMU has
    notes: Sequence[str] = ()
    kept: Mapping[str, float] = MappingProxyType({})

    def __init__(self, source: Path | str | UnpackedFmu, name: str, *how: Any) -> None:
        self._clean: Callable[[], object] = lambda: None
        if isinstance(source, UnpackedFmu):
            self._fmu = source
        else:
            self._fmu = unpack(source)
            self._clean = weakref.finalize(self, self._fmu.remove)
        self.name, self.path, self._how = name, self._fmu.path, how
        self.description: Description = self._fmu.description
        self._variables = self.description.by_name
        self.outputs = self.description.names("output")
        self.parameters: Sequence[str] = self.description.names("parameter")
        inputs = self.description.names("input")
        # the law's ramp counts from the start of a communication step: model exchange has none
        law = law_ports(inputs, inputs, self.outputs) if self.description.exchanges else set[str]()
        self.inputs = [n for n in inputs if n not in law]
        about = self.description
        self.can_save, self.steps_vary = about.saves_state, about.steps_vary

    def nominal(self, name: str) -> float:
        return self._variables[name].nominal

    def is_real(self, name: str) -> bool:
        """Whether a signal is a real number."""
        return self._variables[name].is_real

    def follows_at_once(self, name: str) -> bool:
        """Whether an output may have direct feedthrough, as declared by the FMU."""
        return self._variables[name].direct

    def initially_from(self, name: str) -> Sequence[str]:
        """Inputs that an output may depend on in initialization, as declared by the FMU."""
        sources = self._variables[name].initially_from
        return self.inputs if sources is None else sources

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """Set parameters and start values, enter initialization mode, and set inputs there.

        What the FMU does not have as its description says is set then, too. Parameters that still
        differ from that, or from the given values, are `kept`.
        """
        self.stop = stop
        self.enter(values, stop)
        settable = (v for v in self._variables.values() if v.causality in SETTABLE)
        starts = {v.name: v.start for v in settable if v.start is not None and v.name not in values}
        had = self._unlike(starts)
        if had:
            self.writer(list(had))(np.array([starts[n] for n in had]))
        given = {n: float(values[n]) for n in self.parameters if n in values}
        kept = self._unlike({n: starts[n] for n in had} | given)
        self.kept = {n: value for n, value in kept.items() if n in self.parameters}
        file = self.path.name
        self.notes = [
            f"{file} starts with {n} = {value:g}, but its description says {starts[n]:g}: "
            f"{'this cannot be set' if n in kept else 'this was set'}"
            for n, value in had.items()
            if n in self.parameters
        ]
        self.notes += [
            f"{file} has {n} = {kept[n]:g}: it does not take the given {value:g}"
            for n, value in given.items()
            if n in kept
        ]

    def _unlike(self, wanted: Mapping[str, float]) -> dict[str, float]:
        """Present values of those that are not as wanted."""
        found = zip(wanted, self.reader(list(wanted))().tolist(), strict=True) if wanted else ()
        return {n: v for n, v in found if not math.isclose(v, wanted[n], rel_tol=AS_PRINTED)}

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        """As `enter_initialization`, except for start values of the description."""

    def reopened(self) -> Self:
        other = type(self)(self._fmu, self.name, *self._how)
        other.sample_time, other.can_save = self.sample_time, self.can_save
        return other


class FmuInstance(AnyFmu):
    """An FMU, run in this process; messages have its instance name. Raises `FmuError`."""

    def __init__(self, source: Path | str | UnpackedFmu, name: str) -> None:
        super().__init__(source, name)
        self._given: Mapping[str, Value] = {}
        self._status = 0  # the worst so far
        self._fmi = Fmi2() if self.description.fmi == 2 else Fmi3()
        try:
            self._fmi.open(self._fmu, name)
        except Exception as error:
            reason = self._fmi.words or error
            raise FmuError(f"{self.path}: cannot be instantiated: {reason}") from error
        self._open = True

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        self._given = {name: v for name, v in values.items() if name in self.inputs}
        with self._initializing():
            self._fmi.set_up(stop)
            self._set({name: v for name, v in values.items() if name not in self._given})
            self._fmi.enter(stop)
            self._set(self._given)

    def leave_initialization(self) -> None:
        """Leave initialization mode, and set the inputs among the values again."""
        with self._initializing():
            self._fmi.fmu.exitInitializationMode()
            if self.description.exchanges:
                from .model_exchange import Integrator

                moved = bool(self.description.names("input"))
                self._fmi.integrator = Integrator(self._fmi.fmu, *self._fmi.sizes(), moved)
            self._set(self._given)
            if SAMPLE_TIME in self.parameters:
                self.sample_time = float(self.reader([SAMPLE_TIME])()[0])
        if self.message():
            raise StepFailed(self.message())

    def _set(self, values: Mapping[str, Value]) -> None:
        for name, value in values.items():
            if isinstance(value, str):
                self._fmi.fmu.setString([self.description.strings[name]], [value])
            else:
                self.writer([name])(np.array([value], dtype=float))

    @contextlib.contextmanager
    def _initializing(self) -> Iterator[None]:
        try:
            yield
        except StepFailed:
            raise
        except Exception as error:
            raise self._refusal(error, "cannot be initialized: ") from error

    def message(self) -> str:
        """The FMU's error message: for our FMUs from their String, for others from their log."""
        if (reference := self.description.message_reference) is None:
            return self._fmi.words
        (text,) = self._fmi.fmu.getString([reference])
        return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)

    def writer(self, names: Sequence[str]) -> Writer:
        parts = self._ports(names)

        def write(values: Vector) -> None:
            for places, ports in parts:
                try:
                    ports.put(values[places])
                except Refused as error:
                    raise self._refusal(error) from error
                self._check(self._fmi.transfer("Set", ports), PUT, ports.names)

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        parts = self._ports(names)

        def read() -> Vector:
            values = np.empty(len(names))
            for places, ports in parts:
                self._check(self._fmi.transfer("Get", ports), TAKE, ports.names)
                values[places] = ports.values
            return values

        return read

    def _ports(self, names: Sequence[str]) -> list[tuple[slice | list[int], Ports]]:
        """Places and ports, one for each type."""
        types = [self._variables[n].type for n in names]
        parts: list[tuple[slice | list[int], Ports]] = []
        for kind in dict.fromkeys(types):
            places = [k for k, found in enumerate(types) if found == kind]
            ports = self._fmi.ports([self._variables[names[k]] for k in places])
            parts.append((places if len(places) < len(names) else slice(None), ports))
        return parts

    def step(self, t: float, h: float) -> None:
        try:
            status = self._fmi.step(t, h)
        except Exception as error:
            raise self._refusal(error) from error
        self._check(status, MOVE)

    def failure(self, status: int, call: int, names: Sequence[str] = ()) -> StepFailed:
        """The error for a call, of these kinds, that ended with this status."""
        what = f"{_FAILED[call]} {', '.join(names)}".strip()
        if call == MOVE and status == DISCARD:
            self._fmi.ask_for_end()
            too_long = "rejects the step because it is too long"
            what = too_long if self._fmi.end == math.inf else self._fmi.ending
        elif call == MOVE:
            what += " a fatal error" if status == FATAL else " an error"
        return self._failed(status, what)

    def _failed(self, status: int, what: str) -> StepFailed:
        """The error for what ended with this status, with the FMU's own message."""
        self._status = max(self._status, status)
        reason = self.message() if status < FATAL else self._fmi.words
        advice = SHORTER if status == DISCARD and self._fmi.end == math.inf else ""
        if reason.startswith(f"{self.name}: "):  # ours put the instance's name first
            return StepFailed(reason, advice)
        text = f"{what}{': ' if reason else ''}{' '.join(reason.split())}"
        return StepFailed(f"{self.name} ({self.path.name}): {text}", advice)

    def _refusal(self, error: Exception, what: str = "") -> StepFailed:
        return self._failed(getattr(error, "status", FATAL), what + str(error).rstrip("."))

    def _check(self, status: int, call: int, names: Sequence[str] = ()) -> None:
        if status > OK:
            raise self.failure(status, call, names)

    def save(self) -> Any:
        state = ctypes.c_void_p()
        self._check(self._fmi.states[0](self._fmi.component, ctypes.byref(state)), SAVE)
        return state

    def restore(self, state: Any) -> None:
        self._check(self._fmi.states[1](self._fmi.component, state), RESTORE)

    def release(self, state: Any) -> None:
        self._fmi.states[2](self._fmi.component, ctypes.byref(state))

    def is_compiled(self, names: Sequence[str]) -> bool:
        """Whether compiled code can call its functions directly for these ports."""
        plain = self.description.fmi == 2 and not self.description.exchanges
        return plain and all(self._variables[n].type == "Real" for n in names)

    def entry_points(self) -> tuple[int, ...]:
        """Addresses of the instance and of its functions, in the order of `ENTRY_POINTS`."""
        of = self._fmi.library
        calls = (of.fmi2SetReal, of.fmi2GetReal, of.fmi2DoStep, *self._fmi.states)
        addresses = (ctypes.cast(call, ctypes.c_void_p).value or 0 for call in calls)
        return (self._fmi.component.value or 0, *addresses)

    def check_end(self, _: Any, t: float, h: float, __: int) -> None:
        """Raise `Refused` unless a discarded step was the last one, as the FMU then says."""
        self._fmi.end = math.inf
        self._fmi.ask_for_end()
        if not t + h * (1 - SAME) <= self._fmi.end < math.inf:
            raise Refused(self._fmi.ending, DISCARD)

    def references(self, names: Sequence[str]) -> list[int]:
        """Value references of variables."""
        return [self._variables[n].reference for n in names]

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        self._clean()
        if self._status >= FATAL:
            return  # FMI allows no call any more
        # its results are already read: a failure at the end has no effect
        with contextlib.suppress(Exception):
            if self._status <= OK:
                self._fmi.fmu.terminate()
        self._fmi.fmu.freeInstance()

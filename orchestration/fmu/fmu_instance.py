"""Interface of an FMU instance for the master: named signals, steps, and saved states."""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import math
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from ...fmus.ports import law_ports
from ...fmus.reading import SETTABLE, Description, NumberVariable, UnpackedFmu, unpack
from ...solver.errors import FmuError, UserError
from .fmi_versions import (
    DISCARD,
    END,
    ERROR,
    FATAL,
    OK,
    Fmi2,
    Fmi3,
    Ports,
    Refused,
    forget,
    last_words,
)

Vector = npt.NDArray[np.float64]

ENTRY_POINTS = "component set_real get_real do_step get_state set_state free_state".split()
_LOG_NUMBERS = itertools.count(1)

Value: TypeAlias = "float | str"
"""Value of a parameter: a number, or the text of a String."""

SAMPLE_TIME = "sample_time"
AS_PRINTED = 1e-6  # of a start value: what a tool that prints few digits may change
SHORTER = "it needs shorter steps: use a smaller --step"


class StepFailed(UserError, RuntimeError):
    """An FMU instance could not do a step; the message comes from the FMU, if it gave one.

    Attributes
    ----------
    advice : str
        Advice for the user.
    """

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice or (
            "use a smaller --step; if the result is the same, the loop itself is "
            "unstable or a parameter is wrong"
        )


Writer: TypeAlias = Callable[[Vector], None]
Reader: TypeAlias = Callable[[], Vector]


class Instance(Protocol):
    """Interface of any participant in a loop.

    Rules for an implementation: between `enter_initialization` and `leave_initialization`
    inputs can be set and outputs read repeatedly; `step` moves from t to t + h with its inputs
    held; after `restore` it continues exactly as after `save`; `reopened` is a new instance of
    the same FMU.
    """

    name: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    can_save: bool
    sample_time: float

    def nominal(self, name: str) -> float: ...
    def is_real(self, name: str) -> bool: ...
    def follows_at_once(self, name: str) -> bool: ...
    def initially_from(self, name: str) -> Sequence[str]: ...
    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None: ...
    def leave_initialization(self) -> None: ...
    def writer(self, names: Sequence[str]) -> Writer: ...
    def reader(self, names: Sequence[str]) -> Reader: ...
    def step(self, t: float, h: float) -> None: ...
    def save(self) -> Any: ...
    def restore(self, state: Any) -> None: ...
    def release(self, state: Any) -> None: ...
    def reopened(self) -> Instance: ...
    def close(self) -> None: ...


class AnyFmu:
    """Common part of FMU instances in this or another process.

    Attributes
    ----------
    notes : list of str
        On values that the FMU did not have, or does not take; after initialization.
    kept : mapping of str to float
        Parameters that could not be set, with the values that the FMU has; after initialization.
    """

    notes: Sequence[str] = ()
    kept: Mapping[str, float] = MappingProxyType({})

    def __init__(self, source: Path | str | UnpackedFmu, name: str) -> None:
        self._clean: Callable[[], object] = lambda: None
        if isinstance(source, UnpackedFmu):
            self._fmu = source
        else:
            self._fmu = unpack(source)
            self._clean = weakref.finalize(self, self._fmu.remove)
        self.name = name
        description = self.description
        self.inputs: Sequence[str] = inputs_of(description)
        self.outputs: Sequence[str] = description.names("output")
        self.parameters: Sequence[str] = description.names("parameter")
        self.can_save = description.saves_state
        self.steps_vary = description.steps_vary
        self.sample_time, self.stop = 0.0, math.inf

    @property
    def description(self) -> Description:
        return self._fmu.description

    @property
    def path(self) -> Path:
        return self._fmu.path

    @cached_property
    def _variables(self) -> Mapping[str, NumberVariable]:
        return self.description.by_name

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
        told = self._variables[name].initially_from
        return self.inputs if told is None else told

    def initialize(self, values: Mapping[str, Value], stop: float) -> None:
        """Go through initialization alone, see `FmuInstance.enter_initialization`."""
        self.enter_initialization(values, stop)
        self.leave_initialization()

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """Set parameters and start values, enter initialization mode, and set inputs there.

        What the FMU does not have as its description says is set then, too. Parameters that still
        differ from that, or from the given values, are `kept`.

        Raises
        ------
        StepFailed
            If the FMU rejects them.
        """
        self.enter(values, stop)
        numbers = {*self.parameters} & self._variables.keys()
        given = {n: float(value) for n, value in values.items() if n in numbers}
        told = {n: start for n, start in self._starts.items() if n not in values}
        had = self._unlike(told)
        if had:
            self.writer(list(had))(np.array([told[n] for n in had]))
        kept = self._unlike({n: told[n] for n in had} | given)
        self.kept = {n: value for n, value in kept.items() if n in numbers}
        self.notes = [
            f"{self.path.name} starts with {name} = {value:g}, but its description says "
            f"{told[name]:g}: {'this cannot be set' if name in kept else 'this was set'}"
            for name, value in had.items()
            if name in numbers
        ]
        self.notes += [
            f"{self.path.name} has {name} = {value:g}: it does not take the given {given[name]:g}"
            for name, value in kept.items()
            if name in given
        ]

    @cached_property
    def _starts(self) -> dict[str, float]:
        """Start values of the description that can be set."""
        described = self.description.variables
        return {
            v.name: v.start for v in described if v.causality in SETTABLE and v.start is not None
        }

    def _unlike(self, told: Mapping[str, float]) -> dict[str, float]:
        """Present values of those that are not as told."""
        found = zip(told, self.reader(list(told))().tolist(), strict=True) if told else ()
        return {n: v for n, v in found if not math.isclose(v, told[n], rel_tol=AS_PRINTED)}

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        raise NotImplementedError

    def writer(self, names: Sequence[str]) -> Writer:
        raise NotImplementedError

    def reader(self, names: Sequence[str]) -> Reader:
        raise NotImplementedError

    def leave_initialization(self) -> None:
        raise NotImplementedError


class FmuInstance(AnyFmu):
    """An FMU, run in this process.

    Parameters
    ----------
    source : path-like or UnpackedFmu
    name : str
        Instance name; also the name of the FMU in messages.
    calls : class, optional
        Interface for the calls. Default: its library, by its version of FMI.

    Raises
    ------
    FmuError
        If the file is not an FMU that can run here.
    """

    def __init__(
        self, source: Path | str | UnpackedFmu, name: str, calls: type[Fmi2] | None = None
    ) -> None:
        super().__init__(source, name)
        self._given: Mapping[str, Value] = {}
        self._log = next(_LOG_NUMBERS)
        self._status = 0  # the worst so far
        try:
            usual = Fmi2 if self.description.fmi == 2 else Fmi3
            self._fmi = (calls or usual)(self._fmu, name, self._log)
        except Exception as error:
            self._clean()
            reason = last_words(self._log) or str(error)
            raise FmuError(f"{self._fmu.path}: cannot be instantiated: {reason}") from error
        except BaseException:
            self._clean()
            raise
        self._open = True

    def enter(self, values: Mapping[str, Value], stop: float) -> None:
        """As `enter_initialization`, except for start values of the description."""
        self.stop = stop
        self._given = {name: v for name, v in values.items() if name in self.inputs}
        with self._initializing():
            self._fmi.set_up(stop)
            self._set({name: v for name, v in values.items() if name not in self._given})
            self._fmi.enter(stop)
            self._set(self._given)

    def leave_initialization(self) -> None:
        """Leave initialization mode, and set the inputs among the values again.

        Raises
        ------
        StepFailed
            If the FMU rejects them.
        """
        with self._initializing():
            self._fmi.leave()
            self._set(self._given)
            if SAMPLE_TIME in self.parameters:
                self.sample_time = float(self.reader([SAMPLE_TIME])()[0])
        if self.message():
            raise StepFailed(self.message())

    def _set(self, values: Mapping[str, Value]) -> None:
        for name, value in values.items():
            if isinstance(value, str):
                self._fmi.set_text(self.description.strings[name], value)
                continue
            self.writer([name])(np.array([value], dtype=float))

    @contextlib.contextmanager
    def _initializing(self) -> Iterator[None]:
        try:
            yield
        except StepFailed:
            raise
        except Exception as error:
            status = getattr(error, "status", FATAL)
            raise self.failed(status, f"cannot be initialized: {error}") from error

    def message(self) -> str:
        """The FMU's error message: for our FMUs from their String, for others from their log."""
        reference = self._fmu.description.message_reference
        if reference is None:
            return last_words(self._log)
        return self._fmi.text(reference)

    def writer(self, names: Sequence[str]) -> Writer:
        parts = self._ports(names)

        def write(values: Vector) -> None:
            for places, ports in parts:
                try:
                    ports.put(values[places])
                except Refused as error:
                    raise self.failed(error.status, str(error)) from error
                if (status := self._fmi.transfer("Set", ports)) > OK:
                    raise self.failed(status, f"rejects the values of {', '.join(ports.names)}")

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        parts = self._ports(names)

        def read() -> Vector:
            values = np.empty(len(names))
            for places, ports in parts:
                if (status := self._fmi.transfer("Get", ports)) > OK:
                    raise self.failed(status, f"cannot give {', '.join(ports.names)}")
                values[places] = ports.values
            return values

        return read

    def _ports(self, names: Sequence[str]) -> list[tuple[slice | list[int], Ports]]:
        """Places and ports, one for each type."""
        types = dict.fromkeys(self._variables[n].type for n in names)
        parts: list[tuple[slice | list[int], Ports]] = []
        for kind in types:
            places = [k for k, n in enumerate(names) if self._variables[n].type == kind]
            own = [names[k] for k in places]
            ports = self._fmi.ports(own, kind, self.references(own))
            parts.append((places if len(types) > 1 else slice(None), ports))
        return parts

    def step(self, t: float, h: float) -> None:
        try:
            status = self._fmi.step(t, h)
        except StepFailed:
            raise
        except Exception as error:
            status = getattr(error, "status", FATAL)
            raise self.failed(status, str(error).rstrip(".")) from error
        if status > OK:
            raise self.step_failed(status)

    def step_failed(self, status: int) -> StepFailed:
        """The error for a step that ended with this status."""
        words = {
            DISCARD: "rejects the step because it is too long",
            ERROR: "the step ended with an error",
            FATAL: "the step ended with a fatal error",
        }
        if status == DISCARD and (reached := self._fmi.asked_end()) is not None:
            self._fmi.ended = words[DISCARD] = END.format(reached)
        return self.failed(status, words.get(status, f"the step ended with FMI status {status}"))

    def save(self) -> Any:
        state = ctypes.c_void_p()
        status = self._fmi.get_state(self._fmi.component, ctypes.addressof(state))
        if status > OK:
            raise self.failed(status, "cannot save its state")
        return state, self._fmi.place

    def restore(self, state: Any) -> None:
        pointer, place = state
        status = self._fmi.set_state(self._fmi.component, pointer)
        if status > OK:
            raise self.failed(status, "cannot restore its state")
        self._fmi.place = place

    def is_compiled(self, names: Sequence[str]) -> bool:
        """Whether compiled code can call its functions directly for these ports."""
        plain = self.description.fmi == 2 and not self.description.exchanges
        return plain and all(self._variables[n].type == "Real" for n in names)

    def entry_points(self) -> tuple[int, ...]:
        """Addresses of the instance and of its functions, in the order of `ENTRY_POINTS`."""
        fmi, library = self._fmi, self._fmi.library
        moves = library.fmi2SetReal, library.fmi2GetReal, fmi.do_step
        states = fmi.get_state, fmi.set_state, fmi.free_state
        addresses = (ctypes.cast(call, ctypes.c_void_p).value or 0 for call in (*moves, *states))
        return (fmi.component.value or 0, *addresses)

    def references(self, names: Sequence[str]) -> list[int]:
        """Value references of variables."""
        return [self._variables[n].reference for n in names]

    def failed(self, status: int, what: str) -> StepFailed:
        """The error for a call that ended with this status, with the FMU's own message."""
        self._status = max(self._status, status)
        reason = self.message() if status < FATAL else last_words(self._log)
        advice = SHORTER if status == DISCARD and not self._fmi.ended else ""
        if reason.startswith(f"{self.name}: "):  # ours put the instance's name first
            return StepFailed(reason, advice)
        whose = f"{self.name} ({self._fmu.path.name})"
        text = f"{whose}: {what}{': ' if reason else ''}{' '.join(reason.split())}"
        return StepFailed(text, advice)

    def release(self, state: Any) -> None:
        self._fmi.free_state(self._fmi.component, ctypes.addressof(state[0]))

    def reopened(self, calls: type[Fmi2] | None = None) -> FmuInstance:
        other = FmuInstance(self._fmu, self.name, calls)
        other.sample_time, other.can_save = self.sample_time, self.can_save
        return other

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        forget(self._log)
        self._clean()
        if self._status >= FATAL:
            return  # FMI allows no call any more
        # its results are already read: a failure at the end has no effect
        with contextlib.suppress(Exception):
            if self._status <= OK:
                self._fmi.terminate()
        self._fmi.free()


def inputs_of(description: Description) -> list[str]:
    """Inputs that a master drives: not the feedback law's of model exchange.

    The law's ramp counts from the start of a communication step: model exchange has none.
    """
    inputs = description.names("input")
    law = law_ports(inputs, inputs, description.names("output"))
    return [n for n in inputs if not description.exchanges or n not in law]

"""The program inside an exported FMU: a pythonfmu slave around generated equations.

This file is part of every FMU, with the few files that it imports, see ``carried_runtime.py``, and
the generated equations; on the host it needs pythonfmu (which the FMU contains) and numpy.

Errors are never raised as Python exceptions, because those reach the master without a text and may
end its process: they are logged, kept in the String ``message``, and the step fails.
"""

from __future__ import annotations

import hashlib
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import unquote, urlparse

import numpy as np
from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from ..solver.core import CHATTER, DONE, NO_DELAY, NOT_FINITE, REACHED, TOO_MANY_STEPS, System
from ..solver.tape import record_edited
from .process_end import end_cleanly

MAX_STEPS = 200_000
_Saved = tuple[bytes, bytes, str, bool]  # memory, delayed signals, failure, whether it has started
ROUND_OFF = 1e-9  # share of a sampling period within which two times are equal


class ComponentSlave(Fmi2Slave):  # type: ignore[misc]
    """A component as a co-simulation slave; subclasses define which one.

    Attributes
    ----------
    layout : dict
        Places of everything in ``memory``; see the project's ``fmus/interface.py``.
    equations : str
        Name of the generated functions' file, without ``.py``.
    tapes : bytes
        The same for the core, see `System`.
    """

    layout: ClassVar[dict[str, Any]]
    equations: ClassVar[str]
    tapes: ClassVar[bytes]

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        at = self.layout
        resources = str(kwargs.get("resources") or "")
        folder = unquote(urlparse(resources).path) if "://" in resources else resources
        folder = folder[1:] if folder[2:3] == ":" else folder  # /C:/ of a Windows URI
        library = Path(folder).parent / "binaries" / "linux64" / f"{at['model']}.so"
        end_cleanly(library)
        self.modelName = at["model"]
        self.memory = np.array([*at["initial"], *at["nominal"]])
        view: Any = self.memory.data  # of which Python reads a number sooner than of an array
        self._bytes, self._numbers = view.cast("B"), view[: at["size"]]
        self.failure = ""
        self.started = False
        n = len(at["nominal"])
        self._atol = self.memory[at["size"] :]
        self._held = self.memory[: at["held"]]
        self._p = self.memory[at["parameters"] : at["states"]]
        self._x = self.memory[at["states"] : at["states"] + n]
        self._y = self.memory[at["outputs"] : at["starts"]]
        self._info = self.memory[at["info"] : at["time"]]
        self._discrete = self._held[at["inputs"] : at["inputs"] + at["discrete"]]
        self._update = np.zeros(len(self._discrete))
        self._system: Any = None  # if it cannot be run
        self._stale = True
        file = Path(folder, f"{self.equations}.py")
        try:
            tapes = self._current_tapes(file)
        except Exception as error:
            self._fail(f"{file.name} cannot be run: {error}")
            return
        try:
            self._system = System(tapes)
        except OSError as error:
            self._fail(
                f"no compiled solver for this platform, {sys.platform}: {error}; export it where "
                "the package ziglang is installed, or here, or with --native and --platforms"
            )
            return
        kept = (self._x, self._held, self._p, self._y, self._atol, self._info)
        self._instance = self._system.instance(*kept)

    def _current_tapes(self, file: Path) -> bytes:
        """The equations as the core runs them; recorded again if their text was edited."""
        text = file.read_bytes()
        if hashlib.sha256(text).hexdigest().startswith(file.stem.rpartition("_")[2]):
            return self.tapes
        self.log(f"{self.instance_name}: {file.name} was edited; it runs as it is now")
        sizes = {"p": len(self._p), "y": len(self._y), "d": len(self._discrete)}
        return record_edited(text.decode(), self.tapes, np.array(self.layout["nominal"]), sizes)

    # -- variables ---------------------------------------------------------------------------

    # An exception in a get or a set ends the host, and a get has no status: a
    # request with a wrong type returns NaN, and the next step fails.

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        places, numbers = self.layout["places"], self._numbers
        try:
            if not math.isfinite(sum(values)):  # of numbers, it may be too large
                names = {place: name for name, place in self.layout["names"].items()}
                for vr, value in zip(vrs, values, strict=True):
                    if not math.isfinite(value):
                        self._fail(f"{names[places[vr]]} was set to {value}, not a number")
                        return
            for vr, value in zip(vrs, values, strict=True):
                numbers[places[vr]] = value
        except (IndexError, KeyError):
            for vr in vrs:
                self._place(vr, "cannot be set; it is not an input or a parameter")
        self._stale = True

    def get_real(self, vrs: list[int]) -> list[float]:
        if self._stale:
            self._compute_outputs()
        places, numbers = self.layout["places"], self._numbers
        try:
            return [numbers[places[vr]] for vr in vrs]
        except IndexError:
            found = [self._place(vr, "is a String, not a number") for vr in vrs]
            return [math.nan if p is None else numbers[p] for p in found]

    def _place(self, vr: int, wrong: str) -> int | None:
        """Place of a Real; None, and a failure with the text `wrong`, if there is none."""
        places = self.layout["places"]
        if 0 < vr < len(places) - 1:
            return int(places[vr])
        message = vr == len(places) - 1
        self._fail(f"message {wrong}" if message else f"no variable has the value reference {vr}")
        return None

    def get_string(self, vrs: list[int]) -> list[str]:
        message = len(self.layout["places"]) - 1
        for vr in vrs:
            if vr != message:
                self._fail(f"no String has the value reference {vr}")
        return [self.failure if vr == message else "" for vr in vrs]

    def _fail_for_none(self, vrs: list[int], what: str) -> None:
        if vrs:
            self._fail(f"{len(vrs)} {what} were given, but there are none")

    def get_integer(self, vrs: list[int]) -> list[int]:
        self._fail_for_none(vrs, "Integers")
        return [0] * len(vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        self._fail_for_none(vrs, "Booleans")
        return [False] * len(vrs)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._fail_for_none(vrs, "Integers")

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._fail_for_none(vrs, "Booleans")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._fail_for_none(vrs, "Strings that can be set")

    def _compute_outputs(self) -> None:
        if not self.started:
            self._initialize_states()
        if self.layout["frame"]:
            self._take_frame()
        if self._system:
            self._instance.out(self._numbers[self.layout["time"]])
        else:
            self._y[:] = math.nan
        self._stale = False

    def _take_frame(self) -> None:
        """Set tangents from their inputs, if a new frame is requested."""
        at = self.layout["frame"]
        if self.memory[at["ask"]] != self.memory[at["seen"]]:
            self.memory[at["seen"]] = self.memory[at["ask"]]
            given = self.memory[at["from"] : at["from"] + at["count"]]
            self.memory[at["to"] : at["to"] + at["count"]] = given

    # -- life cycle --------------------------------------------------------------------------

    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        self.memory[self.layout["time"]] = start_time
        if tolerance and (self._x.size or self.layout["delays"]):
            self.memory[self.layout["tolerance"]] = tolerance
        self._stale = True

    def exit_initialization_mode(self) -> None:
        at = self.layout
        for name, (low, high) in at["ranges"].items():
            value = self.memory[at["names"][name]]
            if (low is not None and value < low) or (high is not None and value > high):
                unit = "" if at["units"][name] == "1" else " " + at["units"][name]
                within = f"[{'-inf' if low is None else f'{low:g}'}, "
                within += f"{'inf' if high is None else f'{high:g}'}]"
                self._fail(f"parameter {name} = {value:g}{unit} is out of its range {within}")
        self._initialize_states()
        self.started = True
        self._stale = True

    def _initialize_states(self) -> None:
        at = self.layout
        n = self._x.size
        first = at["starts"]
        self._x[:] = self.memory[first : first + n]
        self._discrete[:] = self.memory[first + n : first + n + len(self._discrete)]
        self._atol[:] = self.memory[at["tolerance"]] * np.array(at["nominal"])
        self._info[:] = 0.0
        if self._system:
            self._system.forget()
            if at["modes"]:
                self._settle()
        if at["sample_time"] >= 0:  # samples count from t = 0, also if the run begins later
            past = self.memory[at["time"]] / self.memory[at["sample_time"]]
            self.memory[at["samples"]] = math.ceil(past - ROUND_OFF)

    def _settle(self) -> None:
        """Enter the mode that follows from the start values and parameters."""
        self._held[-1] = 0.0
        time = self.memory[self.layout["time"]]
        status = self._system.settle(time, self._x, self._held, self._p, self._info)
        if status != DONE:
            self._fail(f"events follow each other without end at t = {time:.9g} s")

    def do_step(self, current_time: float, step_size: float) -> bool:
        if self.failure:
            self._log_failure()
            return False
        if not step_size > 0.0 or not math.isfinite(current_time + step_size):
            self._fail(f"a step from t = {current_time} s by {step_size} s is invalid")
            return False
        at, numbers = self.layout, self._numbers
        if at["frame"]:
            self._take_frame()
        try:
            if at["step_start"] >= 0:
                numbers[at["step_start"]] = current_time
            if at["sample_time"] < 0:
                done = self._advance(current_time, current_time + step_size)
            else:
                done = self._advance_sampled(current_time, step_size)
        except Exception as error:
            done = False
            self._fail(f"{error} in the step from t = {current_time:.9g} s")
        numbers[at["time"]] = current_time + step_size
        self._stale = True
        return done

    def _advance(self, t0: float, t1: float) -> bool:
        tolerance = self._numbers[self.layout["tolerance"]]
        status = self._instance.advance(t0, t1, tolerance, MAX_STEPS)
        if status == NOT_FINITE:
            self._fail(f"the state is not finite at t = {t1:.9g} s")
        elif status == NO_DELAY:
            self._fail("a delay is 0 s; expected more than 0 s")
        elif status != DONE:
            reached = self._info[REACHED]
            what = {
                TOO_MANY_STEPS: f"{MAX_STEPS} internal steps were not enough",
                CHATTER: "events follow each other without end",
            }.get(status, "the internal step became too small")
            rest = "" if status == CHATTER else "; the solution diverges"
            self._fail(f"{what} at t = {reached:.9g} s{rest}")
        return bool(status == DONE)

    def _advance_sampled(self, t0: float, step_size: float) -> bool:
        """Update the discrete states at every sample instant in [t0, t0 + step_size)."""
        at = self.layout
        period = float(self.memory[at["sample_time"]])
        end, now = t0 + step_size, t0
        index = int(self.memory[at["samples"]])
        while index * period < end - ROUND_OFF * period:
            instant = max(index * period, now)
            if instant > now + ROUND_OFF * period:
                if not self._advance(now, instant):
                    return False
                now = instant
            self._system.sample(now, self._x, self._held, self._p, self._update)
            self._discrete[:] = self._update
            index += 1
        self.memory[at["samples"]] = index
        return self._advance(now, end) if self._x.size or at["delays"] else True

    # -- state -------------------------------------------------------------------------------

    def _get_fmu_state(self) -> _Saved:
        delays = self._system and self._system.delays
        history = self._system.history.tobytes() if delays else b""
        return self.memory.tobytes(), history, self.failure, self.started

    def _set_fmu_state(self, state: _Saved) -> None:
        self._bytes[:], history, self.failure, self.started = state
        if history:
            self._system.remember(np.frombuffer(history))
        self._stale = True

    @staticmethod
    def _fmu_state_to_bytes(state: _Saved) -> bytes:
        memory, history, failure, started = state
        parts = memory, history, failure.encode()
        sizes = (len(part).to_bytes(8, "little") for part in parts)
        return b"".join([bytes([started]), *sizes, *parts])

    @staticmethod
    def _fmu_state_from_bytes(data: bytes) -> _Saved:
        ends = [25]
        for k in range(3):
            ends.append(ends[-1] + int.from_bytes(data[1 + 8 * k : 9 + 8 * k], "little"))
        memory, history, failure = (data[a:b] for a, b in pairwise(ends))
        return memory, history, failure.decode(), bool(data[0])

    # -- errors ------------------------------------------------------------------------------

    def _fail(self, text: str) -> None:
        if not self.failure:
            self.failure = f"{self.instance_name}: {text}"
            self._log_failure()

    def _log_failure(self) -> None:
        self.log(self.failure, Fmi2Status.error)

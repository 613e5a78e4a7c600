"""A host of model exchange that is as inaccurate as hosts are allowed to be.

It integrates with extrapolated linearly implicit Euler steps (P. Deuflhard, SIAM Rev. 27, 505
(1985)), which share nothing with the project's solver. It adds round-off to the states after every
step, and at an event it continues from just before, exactly at, just after or well after the event.
"""

from __future__ import annotations

from typing import Any

import fmpy
import numpy as np
from any_fmu import Host
from scipy.optimize import brentq

ROUND_OFF = 2.0**-52
MOST_EVENTS = 20_000  # most events in one course
FIRST_STEP = 1e-5  # after an event [s]; solvers restart there, and friction is steep near rest
ORDER = 6
OWN_SHARE = 0.01  # of the tolerance, for the error of its own solver: the FMU's events are tested
DERIVATIVES = {2: "GetDerivatives", 3: "GetContinuousStateDerivatives"}


class ExchangeHost(Host):
    """One instance, initialized, in continuous-time mode.

    `tolerance` is that of the host's own solver; `random` draws the round-off and the stop at an
    event. `x` are the states, `z` the event indicators at the last start of continuous time.
    """

    def __init__(self, path: Any, values: Any, tolerance: float, random: np.random.Generator):
        super().__init__(path, values, exchange=True)
        slopes = [v for v in self.variables if v.derivative is not None]
        self._slopes = [v.valueReference for v in slopes]
        self._states = [v.derivative.valueReference for v in slopes]
        self.tolerance, self.random, self.time = tolerance, random, 0.0
        self.events = 0
        self._early = False  # the last stop was before an event
        self.x, self.nominal = np.zeros(len(slopes)), np.zeros(len(slopes))
        self.z = np.zeros(fmpy.read_model_description(str(path)).numberOfEventIndicators)
        names = "SetTime", "SetContinuousStates", DERIVATIVES[self.version], "GetEventIndicators"
        self._calls = [getattr(self.fmu.dll, f"fmi{self.version}{name}") for name in names]
        self._buffers = [np.zeros(n) for n in (len(slopes), len(slopes), len(self.z))]
        self._pointers = [np.ctypeslib.as_ctypes(buffer) for buffer in self._buffers]
        self.go_on()

    # These three do not use fmpy's wrappers, which take ten times as long as the FMU.

    def put_states(self, t: float, x: np.ndarray) -> None:
        self._buffers[0][:] = x
        self._calls[0](self.fmu.component, t)
        self._calls[1](self.fmu.component, self._pointers[0], len(x))

    def slope(self, t: float, x: np.ndarray) -> np.ndarray:
        self.put_states(t, x)
        self._calls[2](self.fmu.component, self._pointers[1], len(x))
        return self._buffers[1]

    def indicators(self, t: float, x: np.ndarray) -> np.ndarray:
        self.put_states(t, x)
        self._calls[3](self.fmu.component, self._pointers[2], len(self.z))
        return self._buffers[2].copy()

    def go_on(self) -> None:
        """Process events and continue in continuous time; the FMU is in event mode."""
        self.events += 1
        if self.events > MOST_EVENTS:
            raise RuntimeError(f"events without end at t = {self.time:.9g} s")
        two = self.version == 2
        while (self.fmu.newDiscreteStates if two else self.fmu.updateDiscreteStates)()[0]:
            pass
        self.fmu.enterContinuousTimeMode()
        as_c = np.ctypeslib.as_ctypes
        self.fmu.getContinuousStates(as_c(self.x), len(self.x))
        self.fmu.getNominalsOfContinuousStates(as_c(self.nominal), len(self.x))
        self.z = self.indicators(self.time, self.x)
        self.step = FIRST_STEP

    def jump(self, values: Any) -> None:
        """Change inputs, in event mode."""
        self.fmu.enterEventMode()
        self.set(values)
        self.go_on()

    # -- solving -----------------------------------------------------------------------------

    def _jacobian(self) -> np.ndarray:
        n = len(self.x)
        columns = []
        for k in range(n):
            seed = [0.0] * n
            seed[k] = 1.0
            more = (n,) if self.version == 3 else ()
            columns.append(
                self.fmu.getDirectionalDerivative(self._slopes, self._states, seed, *more)
            )
        return np.array(columns).T

    def _attempt(self, h: float, jacobian: np.ndarray) -> tuple[np.ndarray, float]:
        """The states after a step of `h`, and its error in units of the tolerance."""
        row: list[np.ndarray] = []
        for parts in range(1, ORDER + 1):
            inverse = np.linalg.inv(np.eye(len(self.x)) * parts / h - jacobian)
            end = self.x
            for k in range(parts):
                end = end + inverse @ self.slope(self.time + k * h / parts, end)
            above, row = row, [end]
            for k, one in enumerate(above, start=1):
                row.append(row[-1] + (row[-1] - one) * (parts - k) / k)
        scale = OWN_SHARE * self.tolerance * (self.nominal + np.maximum(abs(self.x), abs(row[-1])))
        return row[-1], float(np.sqrt(np.mean(((row[-1] - row[-2]) / scale) ** 2)))

    def noise(self) -> np.ndarray:
        size = ROUND_OFF * (self.nominal + abs(self.x))
        return size * self.random.normal(size=len(self.x))

    def advance(self, to: float) -> None:
        """Go to the time `to` with the inputs held."""
        while self.time < to:
            h, end, crossed = self._accepted(min(self.step, to - self.time))
            self.time = to if h >= to - self.time else self.time + h
            self.x = end + self.noise()
            self.put_states(self.time, self.x)
            asks, _ = self.fmu.completedIntegratorStep()
            if crossed or asks:
                self.fmu.enterEventMode()
                self.go_on()
            else:
                self.z = self.indicators(self.time, self.x)

    def _accepted(self, h: float) -> tuple[float, np.ndarray, bool]:
        """Length and end of a step that meets the tolerance, and whether it ends at an event."""
        self.slope(self.time, self.x)
        jacobian = self._jacobian()
        while True:
            end, error = self._attempt(h, jacobian)
            if not error <= 1.0:
                h *= max(0.1, 0.9 * error**-0.2) if np.isfinite(error) else 0.1
                continue
            self.step = h * min(6.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.2))
            z = self.indicators(self.time + h, end)
            # as in CVODE: an indicator that begins at zero is ignored until it has a sign
            crossed = (self.z != 0.0) & (np.sign(z) != np.sign(self.z))
            if not crossed.any():
                return h, end, False
            stop = self._stop(h, jacobian, crossed)
            end, error = self._attempt(stop, jacobian)
            if error <= 1.0:
                return stop, end, True
            h = 0.5 * stop  # after the event other equations hold, which may hide an error

    def _stop(self, h: float, jacobian: np.ndarray, crossed: np.ndarray) -> float:
        """Time within the step at which the host stops for the first event."""

        def past(k: int, part: float) -> float:
            if part == 0.0:
                return float(self.z[k])
            end, _ = self._attempt(part, jacobian)
            return float(self.indicators(self.time + part, end)[k])

        roots = [
            brentq(lambda s, k=k: past(k, s), 0.0, h, xtol=1e-17, rtol=1e-15)
            for k in np.nonzero(crossed)[0]
        ]
        root = min(roots)
        ulp = float(np.spacing(self.time + root))
        self._early = not self._early and self.random.random() < 0.3
        away = -1.0 if self._early else self.random.choice([0.0, 1.0, 4.0, 64.0])
        return float(min(h, max(root + away * ulp, ulp)))

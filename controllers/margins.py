"""Stability margins of a linear loop, broken at the plant's command, continuous or sampled.

Margins and zero-order hold are those of python-control (S. Fuller et al., "The Python Control
Systems Library", IEEE CDC (2021)), the library maintained for this since 2009.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..solver.arrays import Matrix, Vector

Response = npt.NDArray[np.complex128]

LOWEST, HIGHEST, POINTS = 0.1, 1e5, 2000  # of the frequency response [rad/s]
UNSTABLE = 1e-6  # share of the fastest pole: round-off of a pole at the limit of stability


@dataclass(frozen=True)
class Linear:
    """Linear equations of a part: ``dx/dt = a x + b u, y = c x + d u``.

    The last states, `sampled` of them, change only at samples; their rows give the next value.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    sampled: int = 0


def open_loop(plant: Linear, controller: Linear, period: float = 0.0) -> Any:
    """The loop from command to command, a control.StateSpace; `period` [s] if it is sampled."""
    import control

    p = control.ss(plant.a, plant.b, plant.c, plant.d)
    k = controller
    if not k.sampled:
        return -(control.ss(k.a, k.b, k.c, k.d) * p)
    n = len(k.a) - k.sampled  # continuous states; between samples they get the sampled values
    turn, hold = np.eye(n), np.zeros((n, k.sampled))
    if n:
        between = control.ss(k.a[:n, :n], k.a[:n, n:], np.eye(n), hold)
        between = control.sample_system(between, period, "zoh")
        turn, hold = between.A, between.B
    # its output at a sample uses the new values of its states
    new_x, new_y, out = k.a[n:], k.b[n:], k.c[:, n:]
    a = np.vstack([np.hstack([turn, np.zeros((n, k.sampled))]) + hold @ new_x, new_x])
    law = control.ss(a, np.vstack([hold @ new_y, new_y]), out @ new_x, out @ new_y + k.d, period)
    return -(law * control.sample_system(p, period, "zoh"))


def is_stable(loop: Any) -> bool:
    """Whether a loop of `open_loop` is stable when it is closed."""
    import control

    poles = control.feedback(loop, 1).poles()
    beyond = np.abs(poles) - 1 if loop.dt else poles.real / np.abs(poles).max(initial=1.0)
    return bool((beyond <= UNSTABLE).all())


def response_of(loop: Any, points: int = POINTS) -> tuple[Vector, Response]:
    """Frequencies [rad/s], up to half the sampling frequency, and the loop's response there."""
    top = math.pi / loop.dt * (1 - 1e-9) if loop.dt else HIGHEST
    omega = np.geomspace(LOWEST, top, points)
    at = np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega
    return omega, np.asarray(loop(at), dtype=np.complex128)


@dataclass(frozen=True)
class Margins:
    """A linearized loop, broken at the plant's command.

    Stuck, friction is the spring and damper of its bristles; sliding, a damper, the slope of the
    friction curve at this speed.
    """

    state: str  # "stuck" or "sliding"
    speed: float  # [m/s]
    stable: bool  # whether the closed loop is stable
    # factor by which the loop's gain may rise, and to which it may fall; infinite and 0: no limit
    gain_margin: float
    gain_margin_down: float
    gain_frequency: float  # of the gain margin [Hz]; NaN without one
    phase_margin: float  # [degrees]; NaN if there is none
    crossover: float  # where the loop's gain is 1 [Hz]; NaN if there is none
    sensitivity: float  # largest ``|1/(1 + L)|``, Ms
    sensitivity_frequency: float  # [Hz]
    frequency: Vector  # shape (m,); [Hz]
    response: Response  # shape (m,); ``L``, see `open_loop`


def margins_of(loop: Any, state: str, speed: float) -> Margins:
    """Margins of a loop of `open_loop`."""
    import control

    omega, response = response_of(loop)
    data = control.frd(response, omega, smooth=True)  # no polynomials, which lose digits here
    found = [np.atleast_1d(f) for f in control.stability_margins(data, returnall=True)]
    gains, phases, distances, at_gain, at_phase, at_distance = found
    up = [(g, w) for g, w in zip(gains, at_gain, strict=True) if g > 1]
    gain, gain_at = min(up, default=(math.inf, math.nan))
    pairs = zip(phases, at_phase, strict=True)
    phase, phase_at = min(pairs, key=lambda p: abs(p[0]), default=(math.nan, math.nan))
    nearest = [*zip(distances, at_distance, strict=True)]
    nearest += [*zip(np.abs(1 + response), omega, strict=True)]
    distance, distance_at = min(nearest)
    hertz = 2 * math.pi
    return Margins(
        state=state,
        speed=speed,
        stable=is_stable(loop),
        gain_margin=float(gain),
        gain_margin_down=float(max((g for g in gains if g < 1), default=0.0)),
        gain_frequency=float(gain_at) / hertz,
        phase_margin=float(phase),
        crossover=float(phase_at) / hertz,
        sensitivity=max(1.0, float(1 / distance)),
        sensitivity_frequency=float(distance_at) / hertz,
        frequency=omega / hertz,
        response=response,
    )

"""Free curves as rivals of the causes: a force that is any smooth function of a signal.

If a cause is true, it scores better than a free curve, because it has fewer parameters. If a free
curve scores best, the residual varies in a way that no cause of the catalogue explains, and the
signal of the curve shows with what it varies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import BSpline

from ....solver.arrays import Vector
from ...identification.motion_parts import way_since_reversal
from ..model import Drive
from ..motion import Course
from .cause import Form, engaged
from .travel import Beats

_FUNCTIONS = 20  # of a curve over time or position
_SWINGS = 3
_SLOWEST_SWING = 5.0  # [Hz]


def free_curves(courses: Sequence[Course], model: Drive) -> list[Form]:
    """Free curves along the records; `lives` describes their signal, for a sentence."""
    sign = [engaged(c, model) for c in courses]
    one = [np.ones(len(c.x)) for c in courses]
    pace = [c.middle_v for c in courses]
    # time continues from record to record; position is common to all records
    begins = np.concatenate([[0.0], np.cumsum([c.time[-1] + c.step for c in courses])])
    time = [c.time + 0.5 * c.step + b for c, b in zip(courses, begins, strict=False)]
    place = [c.middle_x for c in courses]
    logway = [np.log(way_since_reversal(c.x, c.v)[0] + 2e-6) for c in courses]
    speed = [np.log(np.abs(c.middle_v) + 1e-4) for c in courses]
    rounded = any(Beats.of(c) for c in courses)  # rounding swings at a constant speed
    return [
        _splines("in time", time, sign, _FUNCTIONS),
        _splines("in time", time, one, _FUNCTIONS),
        _splines("with position", place, sign, _FUNCTIONS),
        _splines("with position", place, one, _FUNCTIONS),
        _splines("in time", time, pace, 12),
        _splines("with position", place, pace, 10),
        _splines("at reversals", logway, sign, 10),
        _splines("with speed", speed, sign, 8),
        _splines("with speed and one direction", speed, one, 8),
        *([] if rounded else [_swings("in time, swinging", courses, time)]),
    ]


def _swings(lives: str, courses: Sequence[Course], time: list[Vector]) -> Form:
    """Sines in time at the strongest frequencies of the unknown force."""
    c = max(courses, key=lambda c: len(c.x))
    window = np.hanning(len(c.unknown))
    power = np.abs(np.fft.rfft(c.unknown * window, 2 * len(window))) ** 2
    frequency = np.fft.rfftfreq(2 * len(window), c.step)
    power[frequency < _SLOWEST_SWING] = 0.0
    best = []
    for _ in range(_SWINGS):
        peak = int(np.argmax(power))
        best.append(float(frequency[peak]))
        power[max(peak - 8, 0) : peak + 9] = 0.0
    names = tuple(f"{w}{k}" for k in range(_SWINGS) for w in ("cos", "sin"))
    force = [
        np.column_stack([w(2 * np.pi * f * t) for f in best for w in (np.cos, np.sin)])
        for t in time
    ]
    return Form(names, force=force, lives=lives)


def _splines(lives: str, signal: list[Vector], carrier: list[Vector], count: int) -> Form:
    """Cubic B-splines over a signal, times another signal."""
    low = min(float(s.min()) for s in signal)
    high = max(low + 1e-9, *(float(s.max()) for s in signal))
    inner = np.linspace(low, high, count - 2)
    gap = inner[1] - inner[0]
    knots = np.concatenate([low - gap * np.arange(3, 0, -1), inner, high + gap * np.arange(1, 4)])
    force = []
    for s, c in zip(signal, carrier, strict=True):
        basis = BSpline.design_matrix(np.clip(s, low, high), knots, 3).toarray()
        force.append(basis[:, :count] * c[:, None])
    return Form(tuple(f"b{k}" for k in range(force[0].shape[1])), force=force, lives=lives)

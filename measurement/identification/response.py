"""Frequency response of a drive from a record with excitation: multisine, chirp or noise.

H1 by Welch's method (J. S. Bendat, A. G. Piersol, *Random Data*, 4th ed., 2010, chapters 5.2, 9.2)
of the differenced position, so that a drift does not leak.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.signal import coherence, csd, find_peaks, welch
from scipy.special import stdtrit

from ...solver.arrays import Vector
from ...solver.errors import BadRecord
from ...solver.files import write_json
from ..records.record import Record
from ..records.units import UNITS
from .intervals import CONFIDENCE, Interval, is_narrow

Spectrum = npt.NDArray[np.complex128]
Modes = tuple[Interval | None, Interval | None]

_BAND = np.log(1.3)  # of the frequency ratios to the peak that are fitted


@dataclass(frozen=True)
class Response:
    """Frequency response from command or force to position, and the first resonance."""

    frequency: Vector  # Hz, shape (n,)
    position: Spectrum  # m per unit of the input
    coherence: Vector
    unit: str  # of the input
    resonance: Interval | None = None  # Hz
    damping: Interval | None = None  # ratio

    @property
    def coherent(self) -> npt.NDArray[np.bool_]:
        return self.coherence > 0.7

    @property
    def highest(self) -> float:  # Hz
        return float(self.frequency[self.coherent].max(initial=0.0))

    @property
    def said(self) -> str:
        modes = [i for i in (self.resonance, self.damping) if i]
        words = [f"{i.value:.4g} ({i.low:.4g} .. {i.high:.4g})" for i in modes]
        if not words:
            return f"no resonance seen below {self.highest:.4g} Hz"
        return f"first resonance at {words[0]} Hz, damping ratio {words[1]}"

    def to_dict(self) -> dict[str, Any]:
        modes = {"resonance_Hz": self.resonance, "damping_ratio": self.damping}
        head = {"input_unit": self.unit, "coherent_up_to_Hz": self.highest, "said": self.said}
        return head | {n: asdict(mode) if mode else None for n, mode in modes.items()}

    def save(self, folder: Path) -> None:
        """Write ``response.json`` and ``response.csv`` into `folder`."""
        write_json(folder / "response.json", self.to_dict())
        phase = np.degrees(np.angle(self.position))
        table = np.column_stack([self.frequency, np.abs(self.position), phase, self.coherence])
        names = f"frequency [Hz],magnitude [m/{self.unit}],phase [deg],coherence [1]"
        np.savetxt(folder / "response.csv", table, "%.9g", delimiter=",", header=names, comments="")


def frequency_response(record: Record) -> Response:
    """Response of the position to the force, or to the command if no force was recorded."""
    name = next(n for n in ("force", "u", "i") if n in record.signals)
    kind = {"force": "force", "i": "current"}.get(name, record.command)
    given, moved = record.signals[name][:-1], np.diff(record.x)
    how = {"fs": 1.0 / record.step, "nperseg": max(len(given) // 8, 50)}  # 15 averages
    if len(given) < 400 or not np.ptp(given) > 0 or not np.ptp(moved) > 0:
        raise BadRecord(f"{record.name}: expected 400 samples with changing {name} and x")
    frequency, cross = csd(given, moved, **how)
    inside = (frequency > 1.5 * frequency[1]) & (frequency < 0.45 / record.step)
    share = np.clip(coherence(given, moved, **how)[1][inside], 0.0, 1.0)
    omega, own = 2 * np.pi * frequency[inside], welch(given, **how)[1][inside]
    position = cross[inside] / own / np.expm1(1j * omega * record.step)
    found = Response(frequency[inside], position, share, next(iter(UNITS[kind])))
    good, error = found.coherent, np.sqrt((1 - share) / np.maximum(30 * share, 1e-12))
    if np.count_nonzero(good) < 12:
        return found
    # what falls as the n-th power of frequency is n quarters of a turn late, except a controller;
    # seen two octaves from the lowest line on, below resonances and before a delay counts
    low = np.flatnonzero(good & (own > 0.01 * own[good].max()))
    low = low[: max(8, np.count_nonzero(omega[low] < 4 * omega[low[0]]))]
    power, _ = np.polyfit(np.log(omega[low]), np.log(np.abs(position[low])), 1)
    if np.median(np.cos(np.angle(position[low]) - 0.5 * np.pi * power)) < 0:
        raise BadRecord(
            f"{record.name}: {name} acts against the displacement, as that of a controller does "
            "whose drive is moved from outside; shake the drive by its command"
        )
    faster = -(omega**2) * position
    level = np.where(good, np.log10(np.abs(faster) + 1e-300), -300.0)
    peaks, properties = find_peaks(np.maximum(level, level.max() - 10), prominence=0.3)
    for peak, height in zip(peaks, properties["prominences"], strict=True):
        near = good & (np.abs(np.log(omega / omega[peak])) < _BAND)
        if np.count_nonzero(near) >= 12 and 10**height - 1 >= 8.0 * error[near].max():
            resonance, damping = _mode(faster[near], error[near], omega[near], omega[peak])
            if resonance:
                return replace(found, resonance=resonance, damping=damping)
    return found


def _mode(faster: Spectrum, error: Vector, omega: Vector, centre: float) -> Modes:
    """A mode beside a rigid body in an acceleration, by least squares: frequency and damping."""
    spread, ratio = np.maximum(error, 1e-3) * np.abs(faster), omega / centre
    line, off = ratio[1] - ratio[0], np.arange(-4.0, 4.01, 0.25)
    # a segment's window smooths the response by its power over frequency
    blur = (np.sinc(off) + 0.5 * (np.sinc(off - 1) + np.sinc(off + 1))) ** 2
    blurred = ratio[:, None] + off * line

    def left(unknown: Vector) -> Vector:
        own, damping = unknown
        mode = blurred**2 / (own**2 - blurred**2 + 2j * damping * own * blurred) @ blur
        columns = np.column_stack([np.ones(len(ratio)), ratio, mode]) / spread[:, None]
        rest = faster / spread - columns @ np.linalg.lstsq(columns, faster / spread)[0]
        return np.concatenate([rest.real, rest.imag])

    bounds = ([np.exp(-_BAND), 1e-5], [np.exp(_BAND), 1.0])
    fits = (least_squares(left, (1.0, z), bounds=bounds, x_scale=(0.01, z)) for z in (0.01, 0.05))
    best, freedom = min(fits, key=lambda f: f.cost), 2 * len(ratio) - 8
    variance = np.linalg.inv(best.jac.T @ best.jac) * 2 * best.cost / freedom
    # neighbouring lines of Hann's window are correlated
    reach = stdtrit(freedom, 0.5 + CONFIDENCE / 2) * np.sqrt(1.5 * np.diag(variance))
    if reach[0] > 0.1 or abs(np.log(best.x[0])) > 0.99 * _BAND:
        return None, None
    wide = 2 * best.x[1] * best.x[0] > 3.0 * line  # else only an upper bound of the damping
    f, d = best.x[0] * centre / (2 * np.pi), best.x[1]
    off_f, low = reach[0] * centre / (2 * np.pi), max(d - reach[1], 0.0) if wide else 0.0
    how, high = "a mode beside a rigid body, least squares on the response", d + reach[1]
    resonance = Interval(f, "Hz", None, f - off_f, f + off_f, how, True)
    damping = Interval(d, "1", None, low, high, how, bool(is_narrow(d, low, high)))
    return resonance, damping

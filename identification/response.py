"""Frequency response of a drive from a record with excitation: multisine, chirp or noise.

The estimate is H1, cross spectrum over the input's spectrum by Welch's method, with its coherence
(J. S. Bendat, A. G. Piersol, *Random Data*, 4th ed., 2010, chapters 5.2 and 9.2). Positions are
differenced first, so that a drift does not leak into all frequencies, and the difference is undone
in the response. The first resonance is a mode in addition to a rigid body, fitted to the
acceleration per force around the first peak.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.signal import coherence, csd, find_peaks, welch
from scipy.stats import t as student

from ..records.bad_record import BadRecord
from ..records.record import Record
from ..solver.files import write_json
from .intervals import CONFIDENCE, Interval, is_narrow

Vector = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_SEGMENTS = 8  # record length over segment length; with half overlap, 15 averages
_FEWEST = 400  # least number of samples
_COHERENT = 0.7  # least coherence of a used frequency
_PROMINENT = 0.3  # least height of a peak in powers of ten: a factor of two
_CERTAIN = 8.0  # least height of a peak in standard errors of a line
_BAND = 1.3  # frequency ratio of the fitted band around the peak
_RESOLVED = 3.0  # lines in a peak's width below which its damping is only a bound
_METHOD = "a mode beside a rigid body, least squares on the response"


@dataclass(frozen=True)
class Response:
    """Frequency response from command or force to position.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Frequencies [Hz].
    position, coherence : ndarray, shape (n,)
        Complex position per input, and coherence with the input, 0 to 1.
    error : ndarray, shape (n,)
        Relative standard deviation of `position`.
    unit : str
        Unit of the input.
    highest : float
        Highest frequency with sufficient coherence [Hz]; 0 without one.
    resonance, damping : Interval or None
        Frequency [Hz] and damping ratio [1] of the first resonance; None if none is visible.
    """

    frequency: Vector
    position: Complex
    coherence: Vector
    error: Vector
    unit: str
    highest: float
    resonance: Interval | None
    damping: Interval | None

    @property
    def coherent(self) -> npt.NDArray[np.bool_]:
        """Frequencies with sufficient coherence, shape (n,)."""
        return self.coherence > _COHERENT

    @property
    def said(self) -> str:
        """The resonance in a sentence."""
        f, d = self.resonance, self.damping
        if f is None or d is None:
            return f"no resonance seen below {self.highest:.4g} Hz"
        bounds = [math.nan if b is None else b for b in (f.low, f.high)]
        damped = f"at most {d.high:.2g} (lines too wide)" if d.low is None else f"{d.value:.3g}"
        if d.low is not None and d.high is not None:
            damped += f" ({d.low:.3g} .. {d.high:.3g})"
        return (
            f"first resonance at {f.value:.4g} Hz ({bounds[0]:.4g} .. {bounds[1]:.4g} Hz), damping "
            f"ratio {damped}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            "input_unit": self.unit,
            "coherent_up_to_Hz": self.highest,
            "resonance_Hz": asdict(self.resonance) if self.resonance else None,
            "damping_ratio": asdict(self.damping) if self.damping else None,
            "said": self.said,
        }

    def save(self, folder: Path) -> None:
        """Write ``response.json`` and ``response.csv`` into `folder`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "response.json", self.to_dict())
        phase = np.degrees(np.angle(self.position))
        table = np.column_stack([self.frequency, np.abs(self.position), phase, self.coherence])
        names = f"frequency [Hz],magnitude [m/{self.unit}],phase [deg],coherence [1]"
        np.savetxt(folder / "response.csv", table, "%.9g", delimiter=",", header=names, comments="")


def frequency_response(record: Record) -> Response:
    """Response of the position to the force, or to the command if no force was recorded.

    Parameters
    ----------
    record : Record

    Raises
    ------
    BadRecord
        If the record is too short, or its input or position does not change.
    """
    name = next(n for n in ("force", "u", "i") if n in record.signals)
    units = {"voltage": "V", "current": "A", "force": "N"}
    unit = {"force": "N", "i": "A"}.get(name, units.get(record.command, "V"))
    given, moved = record.signals[name][:-1], np.diff(record.x)
    if len(given) < _FEWEST:
        raise BadRecord(f"{record.name}: {len(given)} samples, expected at least {_FEWEST}")
    if not np.ptp(given) > 0 or not np.ptp(moved) > 0:
        raise BadRecord(
            f"{record.name}: {name} or x does not change; expected a drive with a "
            "multisine, chirp or noise"
        )
    rate = 1.0 / record.step
    length = len(given) // _SEGMENTS
    how = {"fs": rate, "nperseg": length}
    frequency, cross = csd(given, moved, **how)
    _, own = welch(given, **how)
    _, share = coherence(given, moved, **how)
    inside = (frequency > 1.5 * rate / length) & (frequency < 0.45 * rate)
    frequency, share = frequency[inside], np.clip(share[inside], 0.0, 1.0)
    omega = 2 * np.pi * frequency
    position = (cross / own)[inside] / (np.exp(1j * omega * record.step) - 1.0)
    averages = 2 * _SEGMENTS - 1
    error = np.sqrt((1 - share) / np.maximum(2 * averages * share, 1e-12))
    good = share > _COHERENT
    highest = float(frequency[good].max()) if good.any() else 0.0
    found = _first_resonance(frequency, -(omega**2) * position, error, good)
    return Response(frequency, position, share, error, unit, highest, *(found or (None, None)))


def _first_resonance(
    frequency: Vector, acceleration: Complex, error: Vector, good: npt.NDArray[np.bool_]
) -> tuple[Interval, Interval] | None:
    """Frequency [Hz] and damping ratio of the first peak of the acceleration per input."""
    level = np.where(good, np.log10(np.abs(acceleration) + 1e-300), -300.0)
    level = np.maximum(level, level.max() - 10)
    peaks, told = find_peaks(level, prominence=_PROMINENT)
    for k, peak in enumerate(peaks):
        centre = float(frequency[peak])
        near = good & (frequency > centre / _BAND) & (frequency < centre * _BAND)
        stands_out = 10 ** float(told["prominences"][k]) - 1
        if np.count_nonzero(near) < 12 or stands_out < _CERTAIN * float(error[near].max()):
            continue
        found = _fitted(frequency[near], acceleration[near], error[near], centre)
        if found:
            return found
    return None


def _fitted(
    frequency: Vector, acceleration: Complex, error: Vector, centre: float
) -> tuple[Interval, Interval] | None:
    spread = np.maximum(error, 1e-3) * np.abs(acceleration)
    ratio = frequency / centre
    line = frequency[1] - frequency[0]
    # a segment's window smooths the response by its power over frequency
    off = np.arange(-4.0, 4.01, 0.25)
    blur = (np.sinc(off) + 0.5 * (np.sinc(off - 1) + np.sinc(off + 1))) ** 2
    blur /= blur.sum()
    blurred = ratio[:, None] + off * line / centre

    def left(unknown: Vector) -> Vector:
        own, damping = unknown
        mode = blurred**2 / (own**2 - blurred**2 + 2j * damping * own * blurred) @ blur
        columns = np.column_stack([np.ones(len(ratio)), ratio, mode]) / spread[:, None]
        shares, *_ = np.linalg.lstsq(columns, acceleration / spread, rcond=None)
        rest = acceleration / spread - columns @ shares
        return np.concatenate([rest.real, rest.imag])

    bounds = ([1 / _BAND, 1e-5], [_BAND, 1.0])
    fits = [least_squares(left, (1.0, z), bounds=bounds, x_scale=(0.01, z)) for z in (0.01, 0.05)]
    best = min(fits, key=lambda f: f.cost)
    freedom = 2 * len(ratio) - 8  # three complex shares and two others
    variance = np.linalg.inv(best.jac.T @ best.jac) * 2 * best.cost / freedom
    # neighbouring lines of Hann's window are correlated
    reach = float(student.ppf(0.5 + CONFIDENCE / 2, freedom)) * np.sqrt(1.5 * np.diag(variance))
    own, damping = (float(x) for x in best.x)
    if reach[0] > 0.1 or not 1 / _BAND < own < _BAND:
        return None
    resolved = 2 * damping * own * centre > _RESOLVED * line
    value, wide = own * centre, float(reach[0]) * centre
    low = max(damping - float(reach[1]), 0.0) if resolved else None
    high = damping + float(reach[1])
    return (
        Interval(value, "Hz", None, value - wide, value + wide, _METHOD, True),
        Interval(damping, "1", None, low, high, _METHOD, is_narrow(damping, low, high)),
    )

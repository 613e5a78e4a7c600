"""Visibility of an effect in a record, and causes with the same shape, computed from the truth.

The method, in terms of the generator:

1. *Trace.* The axis is simulated with the effect, with neither friction noise nor instruments. At
   every substep the force of the command (or of the recorded current) is compared with the force
   that the faultless axis, with its true values, needs for that motion. If the current is recorded,
   the voltage is also compared. The differences, averaged over sampling periods, are the trace: the
   effect in the record. At a speed that the encoder cannot show, motion counts as rest, and a
   set-valued law gives no force.
2. *Noise.* The axis is simulated without the effect, with its friction noise. The same
   differences are directly its force noise, without differentiation. The errors of the instruments
   are the differences between the columns and the true signals of that run. A position error is
   converted to a force by mass, damping and back-EMF, and at rest by the bristles, in the frequency
   domain. Welch's spectra of both are added.
3. *Ratio.* Trace and shapes are weighted by that spectrum. Values that a user would fit are
   projected out: each believed value, with a cost by its tolerance (an error of 3 % costs 1), and
   an offset without cost (except for `load_bias`, which is an offset). The length of the remaining
   trace is the ratio: the signal-to-noise ratio of the best test for an effect of known shape.
4. *Same shape.* Each other cause of the catalogue is evaluated in several forms along the same
   motion. It has the effect's shape if one of them, together with the fitted values, gives a
   remaining ratio below 3.

A rounding encoder is treated as one with additive noise, so the ratio is conservative.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.signal.windows import tukey

from worlds import layout as at
from worlds.axes import BALL_SCREW
from worlds.effects import Effect, Setting
from worlds.shapes import Along, Shape, families, refits

SAME = 3.0  # ratio below which two shapes count as equal
HIGHEST = 1000.0  # highest used frequency, Hz
LEAST_NOISE = 1e-4  # numerical noise, share of the Coulomb force (or its voltage), rms
TAPER = 0.02

Columns = NDArray[np.float64]


@dataclass(frozen=True)
class Sight:
    """Visibility of one effect in one record, from the truth.

    Attributes
    ----------
    ratio : float
    shared : tuple of str
        Other causes of the same shape (empty if the ratio is below `SAME`).
    remaining : dict
        Remaining ratio after fitting each other cause.
    """

    ratio: float
    shared: tuple[str, ...]
    remaining: dict[str, float]


@dataclass(frozen=True)
class Errors:
    """Errors at the samples: position [m]; current [A] and command [V], or None."""

    x: Columns
    i: Columns | None
    u: Columns | None = None


@dataclass(frozen=True)
class Weights:
    """Weights that make the noise of the balances white: spectra at the samples' frequencies."""

    samples: int
    sampling: float
    spectra: Columns  # (balances, frequencies), one-sided

    def whiten(self, shape: Shape) -> Columns:
        """Balances (balances, samples) as one vector in noise of unit variance."""
        window = tukey(self.samples, TAPER)
        spectrum = np.fft.rfft(shape * window)[:, : self.spectra.shape[1]]
        scaled = spectrum * 2 / np.sqrt(self.samples * self.spectra / self.sampling)
        scaled[:, 0] /= np.sqrt(2.0)
        flat = scaled.ravel()
        return np.concatenate([flat.real, flat.imag])


def sampled(shape: Shape, per_sample: int) -> Shape:
    """The log's rows averaged over sampling periods; shape (..., rows) to (..., samples)."""
    count = shape.shape[-1] // per_sample
    cut = shape[..., : count * per_sample]
    return np.asarray(cut.reshape(*shape.shape[:-1], count, per_sample).mean(-1))


def needs(log: Columns, with_current: bool) -> Shape:
    """The differences of point 1, shape (balances, rows)."""
    columns = [at.NEED_FORCE, at.NEED_VOLTAGE] if with_current else [at.NEED]
    return np.asarray(log[:, columns].T)


def weigh(setting: Setting, noise: Shape, errors: Errors, resting: float) -> Weights:
    """Spectra of a faultless record's noise.

    Parameters
    ----------
    noise : ndarray, shape (balances, samples)
        The differences of a faultless run, sampled.
    errors : Errors
    resting : float
        Share of the time at rest, in which a position error is an error of the bristles'
        deflection.
    """
    par, rate = setting.double, 1 / setting.sampling
    length = min(noise.shape[1], max(256, int(4 * rate)))

    def spectrum(signal: Columns) -> Columns:
        return np.asarray(welch(signal, fs=rate, nperseg=length)[1])

    frequencies = welch(noise[0], fs=rate, nperseg=length)[0]
    s = 2j * np.pi * frequencies
    stiffness = par[at.SIGMA0] * np.sqrt(resting)
    of_force = np.abs(setting.mass * s**2 + par[at.SIGMA2] * s + stiffness) ** 2
    of_x = spectrum(errors.x)
    floor = 2 * (LEAST_NOISE * par[at.FC]) ** 2 / rate
    if len(noise) == 2 and errors.i is not None:
        of_i = spectrum(errors.i)
        volts = par[at.R] / par[at.KT]
        spectra = [
            spectrum(noise[0]) + of_force * of_x + par[at.KT] ** 2 * of_i + floor,
            spectrum(noise[1])
            + np.abs(par[at.KE] * s) ** 2 * of_x
            + np.abs(par[at.R] + par[at.L] * s) ** 2 * of_i
            + volts**2 * floor,
        ]
    else:
        if setting.axis.plant == BALL_SCREW:
            back = par[at.KT] * par[at.KE] / par[at.R]
            damping = par[at.SIGMA2] + back
            of_force = np.abs(setting.mass * s**2 + damping * s + stiffness) ** 2
        spectra = [spectrum(noise[0]) + of_force * of_x + floor]
    if errors.u is not None:
        drive = len(noise) == 1 and setting.axis.plant != BALL_SCREW
        of_u = par[at.GAIN] if drive else 1.0 if len(noise) == 2 else par[at.KT] / par[at.R]
        spectra[-1] = spectra[-1] + of_u**2 * spectrum(errors.u)
    own = np.fft.rfftfreq(noise.shape[1], setting.sampling)
    own = own[own <= HIGHEST]
    # Welch's lowest line is without its mean: use the next one instead
    at_own = [np.exp(np.interp(own, frequencies[1:], np.log(one[1:]))) for one in spectra]
    return Weights(noise.shape[1], setting.sampling, np.array(at_own))


def see(
    effect: Effect | None,
    alongs: list[Along],
    weights: list[Weights],
    per_sample: int,
    *,
    alike: bool = True,
) -> Sight:
    """Points 3 and 4 for an effect, or for the mismatch of the law if there is no effect.

    There is one motion with weights for every record of the machine, and one offset for all. Causes
    of the same shape are only searched with `alike`.
    """

    def white(shapes: Iterable[Shape]) -> Columns:
        whole = [
            w.whiten(sampled(shape, per_sample)[:, : w.samples])
            for shape, w in zip(shapes, weights, strict=True)
        ]
        return np.concatenate(whole)

    costly = [white(shapes) for shapes in zip(*(refits(a).values() for a in alongs), strict=True)]
    offset = white(a.force(np.ones(len(a.log))) for a in alongs)
    free = [] if effect is not None and effect.name == "load_bias" else [offset]
    count = len(costly)
    log_prior_odds = np.zeros((count, count + len(free)))
    log_prior_odds[:, :count] = np.eye(count)
    basis = np.linalg.qr(np.vstack([np.column_stack(costly + free), log_prior_odds]))[0]

    def left(vector: Columns) -> Columns:
        whole = np.concatenate([vector, np.zeros(count)])
        return np.asarray(whole - basis @ (basis.T @ whole))

    trace = left(white(needs(a.log, a.with_current) for a in alongs))
    ratio = float(np.linalg.norm(trace))
    if effect is None or not alike or ratio < SAME:
        return Sight(ratio, (), {})
    own_period = (effect.period,) if effect.period else ()
    remaining = {}
    known = [families(a, (a.setting.lead, *own_period)) for a in alongs]
    for name in known[0]:
        # a wrong sign is a scale of -1, no other scale is a wrong sign
        if name.startswith("sign") and not effect.name.startswith("sign"):
            continue
        if name != effect.name:
            forms = zip(*(one[name] for one in known), strict=True)  # each form, for all records
            blocks = [
                np.column_stack([left(white(c)) for c in zip(*form, strict=True)]) for form in forms
            ]
            remaining[name] = min(_beside(trace, block) for block in blocks)
    shared = tuple(sorted(n for n, r in remaining.items() if r < SAME))
    return Sight(ratio, shared, remaining)


def _beside(trace: Columns, block: Columns) -> float:
    """Residual of a trace after fitting a block of columns."""
    sizes = np.linalg.norm(block, axis=0)
    if not np.all(sizes > 1e-9):
        return float(np.linalg.norm(trace))
    columns = block / sizes
    best = np.linalg.lstsq(columns, trace, rcond=1e-9)[0]
    return float(np.linalg.norm(trace - columns @ best))

"""LuGre's sigma0 and sigma1 by the thesis, Eqs. 2.12-2.17, and the errors of these formulas.

Eq. 2.14 assumes that presliding is a spring. On a true LuGre surface the bristles yield before
break-away, so the stiffness is underestimated, more so with a larger force. Eq. 2.17 sets the
damping ratio to one; it is an assumption, not an identification.
"""

from __future__ import annotations

import math

import numpy as np

from ..records.record import Record
from .friction_estimation import FrictionEstimate
from .stribeck_fit import STUCK


def secant_bias(force: float, fs: float) -> float:
    """Result of Eq. 2.14 on a slowly loaded LuGre surface, over the true sigma0.

    From dz/dx = 1 - sigma0 z/Fs: x = -(Fs/sigma0) ln(1 - F/Fs).

    Parameters
    ----------
    force, fs : float
        Held force and break-away force [N], 0 < force < fs.
    """
    share = force / fs
    return share / -math.log1p(-share)


def assumed_damping(sigma0: float, sigma2: float, mass: float = 1.0, share: float = 1.0) -> float:
    """sigma1 = 2 sqrt(sigma0 m) - sigma2, Eq. 2.17 [N*s/m]: a share of the critical damping."""
    return share * 2 * math.sqrt(sigma0 * mass) - sigma2


def held_stiffness(record: Record, estimate: FrictionEstimate) -> tuple[float, float] | None:
    """sigma0 = F/x, Eq. 2.14 [N/m], and the force held [N] of a trial; None if the block moved."""
    x = estimate.motion.x
    if float(np.ptp(x)) > STUCK:
        return None
    last = slice(-max(5, len(x) // 5), None)
    displacement = float(x[last].mean() - x[0])
    force = float(estimate.friction[last].mean())
    if abs(displacement) < 3 * estimate.motion.noise or displacement * force <= 0:
        return None
    return force / displacement, force

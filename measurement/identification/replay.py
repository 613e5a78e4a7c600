"""Examples of the error of a motion's reconstruction from samples, on known motions.

A record's reconstructed motion is assumed to be true. It is measured like the record (encoder
counts from an unknown origin, or noise on the values held by a converter) and reconstructed again.
The difference is an example of the error of the first reconstruction over time: smoothing at a
reversal, or hidden motion of a block that sticks within a count.
"""

from __future__ import annotations

import numpy as np

from .friction_estimation import FrictionEstimate, SmoothedMotion, smooth_motion


def replay(estimate: FrictionEstimate, random: np.random.Generator) -> SmoothedMotion:
    """One example of the motion of a record, measured and reconstructed again.

    Parameters
    ----------
    estimate : FrictionEstimate
        Estimate of the record.
    random : numpy Generator
        Gives origin and noise.
    """
    motion = estimate.motion
    if motion.resolution:
        seen = motion.seen
        if motion.jitter:
            seen = seen + motion.jitter * motion.v * random.standard_normal(len(seen))
        position = motion.resolution * np.floor(seen / motion.resolution + random.random())
    else:
        held = motion.held
        fresh = motion.seen[held] + motion.spread[held] * random.standard_normal(len(held))
        runs = np.diff(np.append(held, len(motion.seen)))
        position = np.concatenate([np.full(held[0], fresh[0]), np.repeat(fresh, runs)])
    return smooth_motion(position, motion.step, motion.later, estimate.from_rest, motion)

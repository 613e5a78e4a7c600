"""What rebuilding a motion from its samples does to it, seen on motions that are known.

A record's rebuilt motion is taken for the truth, measured as the record was (encoder counts from an
unknown origin, or noise on the values that a converter holds) and rebuilt again. The difference is
an example of the error of the first rebuilding, with its course in time: what is smoothed away at
a reversal, what a block that sticks within a count does unseen.
"""

from __future__ import annotations

import numpy as np

from .friction_estimation import FrictionEstimate, SmoothedMotion, smooth_motion


def replay(estimate: FrictionEstimate, random: np.random.Generator) -> SmoothedMotion:
    """One example of the motion of a record, measured and rebuilt once more.

    Parameters
    ----------
    estimate : FrictionEstimate
        Of the record.
    random : numpy Generator
        Decides origin and noise.
    """
    motion = estimate.motion
    if motion.resolution:
        position = motion.resolution * np.floor(motion.seen / motion.resolution + random.random())
    else:
        held = motion.held
        fresh = motion.seen[held] + motion.noise * random.standard_normal(len(held))
        runs = np.diff(np.append(held, len(motion.seen)))
        position = np.concatenate([np.full(held[0], fresh[0]), np.repeat(fresh, runs)])
    return smooth_motion(position, motion.step, motion.later, estimate.from_rest, motion)

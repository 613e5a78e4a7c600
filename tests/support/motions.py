"""Motions for friction laws."""

import numpy as np


def pieces(*legs):
    """Times and velocities of legs (velocity, duration), with jumps between them."""
    times, velocities = [0.0], [legs[0][0]]
    for velocity, duration in legs:
        times += [times[-1], times[-1] + duration]
        velocities += [velocity, velocity]
    return np.array(times), np.array(velocities)


def ways(*legs):
    """The same for legs (velocity, distance)."""
    return pieces(*((velocity, distance / abs(velocity)) for velocity, distance in legs))

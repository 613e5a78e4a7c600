"""Effects that are not in the catalogue."""

from __future__ import annotations

import math

import numpy as np

from worlds import layout as at
from worlds.effects import Draw, Effect, Setting


def burst_disturbance(rng: np.random.Generator, s: Setting) -> Effect:
    """Short pushes from outside at random times."""
    force = s.size(rng, 0.1, 3.0) * float(s.double[at.FC])
    return Effect("burst_disturbance", "half_sines", bursts=force)


def detent_notch(rng: np.random.Generator, s: Setting) -> Effect:
    """A position that holds the block."""
    changes = {
        at.DETENT: s.size(rng, 0.1, 2.0) * float(s.double[at.FC]),
        at.DETENT_PLACE: float(rng.uniform(-0.5, 0.5)) * s.reach,
        at.DETENT_WIDTH: float(rng.uniform(0.01, 0.05)) * s.reach,
    }
    return Effect("detent_notch", "gaussian_well", changes)


def reversal_memory(rng: np.random.Generator, s: Setting) -> Effect:
    """Dry friction is larger for some distance after each reversal."""
    changes = {
        at.MEMORY: s.size(rng, 0.05, 1.0),
        at.MEMORY_WAY: float(rng.uniform(0.02, 0.1)) * s.reach,
    }
    return Effect("reversal_memory", "exponential_in_way", changes)


def scale_error(rng: np.random.Generator, s: Setting) -> Effect:
    """The scale's reading is bent along the travel."""
    wave = rng.uniform() < 0.5
    changes = {
        at.SCALE_ERROR: s.size(rng, 0.0002, 0.05) * s.reach,
        at.SCALE_FORM: float(wave),
        at.TRAVEL: s.reach,
    }
    return Effect("scale_error", "wave" if wave else "bow", changes)


def mains_ripple(rng: np.random.Generator, s: Setting) -> Effect:
    """Mains ripple on the amplifier's voltage."""
    frequency = float(rng.choice([50.0, 100.0]))
    changes = {at.MAINS: s.size(rng, 0.0003, 0.2) * s.peak, at.MAINS_FREQUENCY: frequency}
    return Effect("mains_ripple", f"{frequency:.0f}_hz", changes)


def dwell_ageing(rng: np.random.Generator, s: Setting) -> Effect:
    """Dry friction grows with the time at rest, and decreases again in sliding."""
    changes = {
        at.AGEING: s.size(rng, 0.05, 1.0),
        at.AGEING_WAY: float(rng.uniform(0.005, 0.05)) * s.reach,
    }
    return Effect("dwell_ageing", "logarithmic", changes)


def second_resonance(rng: np.random.Generator, s: Setting) -> Effect:
    """A body on the block oscillates on a spring."""
    block = float(s.double[at.BLOCK_MASS])
    mass = s.size(rng, 0.02, 0.6) * block
    angular = 2 * math.pi * float(np.exp(rng.uniform(np.log(4.0), np.log(80.0))))
    changes = {
        at.RESONATOR: mass,
        at.RESONATOR_SPRING: mass * angular**2,
        at.RESONATOR_DAMPING: float(rng.uniform(0.005, 0.05)) * 2 * mass * angular,
        at.BLOCK_MASS: block - mass,  # the static mass is as believed
    }
    return Effect("second_resonance", "appended_mass", changes)


def other_bristles(rng: np.random.Generator, s: Setting) -> Effect:
    """Bristles of a law that differs from the believed one, which has bristles, too."""
    form = str(rng.choice(["elasto_plastic", "maxwell", "dahl"]))
    if form == "dahl":
        return Effect("other_bristles", form, {at.SIGMA1: 0.0})
    law = at.ELASTO_PLASTIC if form == "elasto_plastic" else at.MAXWELL
    stiffness = float(s.double[at.SIGMA0]) * s.size(rng, 0.3, 3.0)
    return Effect("other_bristles", form, {at.LAW: float(law), at.SIGMA0: stiffness})


OUTSIDE: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        burst_disturbance,
        detent_notch,
        reversal_memory,
        scale_error,
        mains_ripple,
        dwell_ageing,
        second_resonance,
        other_bristles,
    )
}

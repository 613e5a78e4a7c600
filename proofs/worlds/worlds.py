"""Named distributions over machines, noise, instruments and motions: the worlds.

They differ in many assumptions, so that a result valid in all of them does not depend on a single
one.

- `fast_screw`: the thesis' axis, no rotor inertia, drive faster than the sampling, quantized
  positions, a good ammeter or none, very little noise; open loop.
- `heavy_screw`: a rotor of sixteen times the block's mass, known to the user; friction noise fixed
  to the position or slow; interpolating encoders; open and closed loop.
- `linear_drive`: a force on a slide, no armature; Coulomb friction, set-valued or of stiff
  bristles; closed loop, 200 Hz to 1 kHz, filtered positions.
- `industrial`: a machine tool's axis, drive slower than the sampling; commands averaged over PWM
  periods by a faster controller; encoders that floor; imperfect currents; friction noise that grows
  with speed.
- `simulated`: output of another program: 2 to 10 kHz, positions without counts, ramped or held
  commands, no noise or very little.
- those of `machines`, each for a property of real machines and their records.
- `wrong_scales`: the first or the fourth of these, with one wrong scale in the record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from worlds import layout as at
from worlds.axes import BALL_SCREW, DRIVE, Axis
from worlds.conditions import Conditions, log_uniform, pick, scattered
from worlds.effects import CATALOGUE
from worlds.machines import MACHINES, NO_MOTOR
from worlds.outside import OUTSIDE
from worlds.signals import SIGNALS

THESIS = {
    "kt": 37.4e-3,
    "ke": 0.0374482,
    "R": 21.4,
    "L": 0.953e-3,
    "p": 1000.0,
    "m": 1.0,
    "Jm": 0.0,
    "sigma0": 66967.231,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.13975e-3,
}


def fast_screw(rng: np.random.Generator) -> Conditions:
    """The thesis' axis without rotor inertia, faster than its record."""
    values = (
        THESIS
        if rng.uniform() < 0.3
        else THESIS
        | scattered(rng, m=1.0, sigma0=66967.0, sigma1=344.0, sigma2=173.0, Fc=1.284, Vs=1.14e-3)
    )
    values = values | {"Fs": values["Fc"] * (2.35 / 1.284)}
    formulation = int(rng.choice([at.MODIFIED_LUGRE, at.LUGRE]))
    return Conditions(
        axis=Axis(BALL_SCREW, "lugre", values, formulation, 0.3, 36.0, 0.1),
        sampling=float(rng.choice([5e-4, 1e-3, 1e-3, 2e-3])),
        faster=1,
        substep=2e-5,
        duration=float(rng.uniform(10, 20)),
        loop="open",
        excitation=pick(rng, steps=1, ramps=1, multisine=1, chirp=1),
        bandwidth=0.0,
        command=pick(rng, held=3, ramped=1),
        encoders={"round": 3, "floor": 1},
        currents={"good": 1, "none": 1},
        resolution=1e-3 / (512 * float(rng.choice([1, 4]))),
        interpolation=0.0,
        noise=pick(rng, none=3, white=1),
        noise_size=log_uniform(rng, 0.002, 0.05),
        exact=0.4,
        finest=0.2,
    )


def heavy_screw(rng: np.random.Generator) -> Conditions:
    """A rotor with more inertia than the block, and friction that depends on position."""
    values = THESIS | {"Jm": 4.2e-7 * log_uniform(rng, 0.5, 3.0)}
    values |= scattered(
        rng, m=1.0, sigma0=66967.0, sigma1=344.0, sigma2=173.0, Fc=1.284, Vs=1.14e-3
    )
    values["Fs"] = values["Fc"] * float(rng.uniform(1.05, 2.0))
    loop = pick(rng, open=1, cascade=1, pid=1)
    open_ = loop == "open"
    return Conditions(
        axis=Axis(BALL_SCREW, "lugre", values, at.LUGRE, 0.25, 36.0, 0.08),
        sampling=float(rng.choice([2e-4, 5e-4, 1e-3])),
        faster=1,
        substep=2e-5,
        duration=float(rng.uniform(8, 20)),
        loop=loop,
        excitation=pick(rng, steps=1, ramps=1, multisine=1, chirp=1)
        if open_
        else pick(rng, laps=1, points=1, sines=1, sweep=1),
        bandwidth=log_uniform(rng, 8, 25),
        command="held",
        encoders={"interpolated": 2, "round": 1},
        currents={"good": 2, "filtered": 1, "none": 1},
        resolution=log_uniform(rng, 0.02e-6, 1e-6),
        interpolation=log_uniform(rng, 0.02e-6, 0.5e-6),
        noise=pick(rng, texture_repeating=2, texture_not_repeating=1, slow=2, white=1),
        noise_size=log_uniform(rng, 0.005, 0.1),
        exact=0.25,
    )


def linear_drive(rng: np.random.Generator) -> Conditions:
    """A slide driven by a force, with filtered positions."""
    mass = log_uniform(rng, 5.0, 150.0)
    coulomb = mass * log_uniform(rng, 0.1, 0.5)
    fastest = log_uniform(rng, 0.1, 0.6)
    values = {
        "m": mass,
        "gain": log_uniform(rng, 10.0, 60.0),
        "sigma2": coulomb / fastest * log_uniform(rng, 0.3, 3.0),
        "Fc": coulomb,
        "Fs": coulomb * float(rng.choice([1.0, rng.uniform(1.05, 1.6)])),
        "Vs": 0.02 * fastest * log_uniform(rng, 0.5, 3.0),
        "offset": coulomb * float(rng.uniform(-0.2, 0.2)),
    }
    accelerating = 4.0 * mass * fastest / 0.1 + 3 * (coulomb + values["sigma2"] * fastest)
    formulation = int(rng.choice([at.SET_VALUED, at.SET_VALUED, at.LUGRE, at.MAXWELL]))
    return Conditions(
        axis=Axis(
            DRIVE,
            "classical",
            values,
            formulation,
            0.3,
            accelerating / values["gain"],
            fastest,
        ),
        sampling=float(rng.choice([1e-3, 1e-3, 2e-3, 5e-3])),
        faster=1,
        substep=2.5e-5,
        duration=float(rng.uniform(12, 30)),
        loop=pick(rng, cascade=2, pid=1),
        excitation=pick(rng, laps=2, points=1, sines=1, sweep=1),
        bandwidth=log_uniform(rng, 4, 10),
        command="held",
        encoders={"filtered": 2, "round": 1, "interpolated": 1},
        currents={"none": 1},
        resolution=log_uniform(rng, 0.1e-6, 3e-6),
        interpolation=log_uniform(rng, 0.05e-6, 1e-6),
        noise=pick(rng, slow=3, white=1, texture_repeating=1, none=1),
        noise_size=log_uniform(rng, 0.003, 0.08),
        exact=0.25,
    )


def industrial(rng: np.random.Generator) -> Conditions:
    """A machine tool's axis with a drive amplifier and its usual components."""
    lead = float(rng.choice([5e-3, 10e-3, 20e-3]))
    turn = 2 * np.pi / lead
    mass = log_uniform(rng, 20.0, 200.0)
    coulomb = mass * log_uniform(rng, 0.3, 1.5)
    fastest = log_uniform(rng, 0.1, 0.4)
    torque = log_uniform(rng, 0.3, 0.8)
    values = {
        "kt": torque,
        "ke": torque * float(rng.uniform(0.97, 1.03)),
        "R": log_uniform(rng, 0.6, 3.0),
        "L": log_uniform(rng, 3e-3, 12e-3),
        "p": 1 / lead,
        "m": mass,
        "Jm": mass / turn**2 * log_uniform(rng, 0.3, 3.0),
        "sigma2": coulomb / fastest * log_uniform(rng, 0.3, 2.0),
        "Fc": coulomb,
        "Fs": coulomb * float(rng.uniform(1.0, 1.5)),
        "Vs": 0.02 * fastest * log_uniform(rng, 0.5, 3.0),
    }
    law = pick(rng, lugre=1, classical=1)
    if law == "lugre":
        values["sigma0"] = values["Fs"] / log_uniform(rng, 2e-6, 30e-6)
        whole = mass + values["Jm"] * turn**2
        values["sigma1"] = float(rng.uniform(0.2, 1.0)) * 2 * np.sqrt(values["sigma0"] * whole)
        formulation = at.LUGRE
    else:
        formulation = int(rng.choice([at.SET_VALUED, at.MAXWELL]))
    volts = values["ke"] * turn * fastest + values["R"] * 6 * coulomb / (torque * turn)
    return Conditions(
        axis=Axis(BALL_SCREW, law, values, formulation, 0.25, 1.5 * volts, fastest),
        sampling=float(rng.choice([2.5e-4, 5e-4, 1e-3])),
        faster=int(rng.choice([2, 4])),
        substep=2.5e-5,
        duration=float(rng.uniform(8, 16)),
        loop=pick(rng, cascade=3, pid=1),
        excitation=pick(rng, laps=2, points=2, sines=1, sweep=1),
        bandwidth=log_uniform(rng, 8, 25),
        command="averaged",
        encoders={"floor": 3, "interpolated": 1},
        currents={"offset_and_gain": 2, "filtered": 1, "coarse": 1, "none": 1},
        resolution=log_uniform(rng, 0.1e-6, 5e-6),
        interpolation=log_uniform(rng, 0.05e-6, 1e-6),
        noise=pick(rng, growing_with_speed=3, slow=1, texture_not_repeating=1),
        noise_size=log_uniform(rng, 0.003, 0.05),
        exact=0.2,
    )


def simulated(rng: np.random.Generator) -> Conditions:
    """Output of another program: no counts, very little noise, much faster than a recorder."""
    rotor = 4.2e-7 * float(rng.choice([0.0, 1.0]))
    values = THESIS | {"Jm": rotor} | scattered(rng, m=1.0, sigma2=173.0, Fc=1.284)
    values["Fs"] = values["Fc"] * float(rng.uniform(1.0, 1.9))
    law = pick(rng, lugre=3, classical=1)
    if law == "classical":
        values = {n: v for n, v in values.items() if n not in ("sigma0", "sigma1")}
    formulation = at.SET_VALUED if law == "classical" else at.MODIFIED_LUGRE
    loop = pick(rng, open=2, cascade=1)
    return Conditions(
        axis=Axis(BALL_SCREW, law, values, formulation, 0.3, 36.0, 0.1),
        sampling=float(rng.choice([1e-4, 2e-4, 5e-4])),
        faster=1,
        substep=1e-5,
        duration=float(rng.uniform(8, 10)),
        loop=loop,
        excitation=pick(rng, steps=1, ramps=1, multisine=1, chirp=1)
        if loop == "open"
        else pick(rng, points=1, sines=1, sweep=1),
        bandwidth=log_uniform(rng, 10, 40),
        command=pick(rng, held=1, ramped=1) if loop == "open" else "held",
        encoders={"exact": 3, "interpolated": 1},
        currents={"good": 1, "none": 1},
        resolution=1e-9,
        interpolation=2e-9,
        noise=pick(rng, none=2, white=1, slow=1),
        noise_size=log_uniform(rng, 1e-4, 0.01),
        exact=0.5,
        finest=0.03,
    )


def wrong_scales(rng: np.random.Generator) -> Conditions:
    """A known axis with a record that was converted to SI by hand."""
    conditions = industrial(rng) if rng.uniform() < 0.6 else fast_screw(rng)
    return replace(conditions, currents=conditions.currents | {"none": 0.3}, finest=1.0)


WORLDS: dict[str, Callable[[np.random.Generator], Conditions]] = {
    draw.__name__: draw for draw in (fast_screw, heavy_screw, linear_drive, industrial, simulated)
}
WORLDS |= MACHINES | {wrong_scales.__name__: wrong_scales}
# a slide driven by a force has no resistance and no current
# and other bristles than the law's exist only if the law always has bristles
LACKING = {
    "linear_drive": {"resistance_drift", "other_bristles", "scale_of_i"},
    "industrial": {"other_bristles"},
    "simulated": {"other_bristles"},
    **{name: {"other_bristles"} for name in MACHINES},
    **{name: {"resistance_drift", "other_bristles", "scale_of_i"} for name in NO_MOTOR},
}
# causes that look like a wrong scale and must be distinguished from it
LIKE_A_SCALE = ("direction_asymmetry", "load_bias", "unmodelled_inertia", "input_delay",
                "parameter_error")  # fmt: skip


def effects_of(world: str) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Names of the causes, outside effects and wrong signals that a world can have."""
    lacking = LACKING.get(world, set())
    if world == wrong_scales.__name__:
        return LIKE_A_SCALE, (), tuple(SIGNALS)
    causes, outside, signals = (
        tuple(n for n in names if n not in lacking) for names in (CATALOGUE, OUTSIDE, SIGNALS)
    )
    return causes, outside, signals

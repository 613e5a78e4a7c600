"""The worlds: distributions over machines, motions, instruments and noise.

They differ in many assumptions, so that a result valid in all of them does not depend on a single
one. Each draws a machine, and then its `Conditions` from a table of ranges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from worlds.axis import BALL_SCREW, DRIVE, LUGRE, MAXWELL, MODIFIED_LUGRE, SET_VALUED, Axis

ROUNDED = 0.1  # time in which a reference reaches its speed, s
STIFF = 1.5  # dry friction over mass above which invisible bristles are too stiff, m/s^2
LEADS = [5e-3, 10e-3, 20e-3]  # m
Rng = np.random.Generator
ANY_OPEN = {"steps": 1, "ramps": 1, "multisine": 1, "chirp": 1}  # odds, as below
TRAVELS = {"laps": 2, "points": 2, "sines": 1}
OFTEN_CASCADE = {"cascade": 2, "pid": 1}
MOSTLY_CASCADE = {"cascade": 3, "pid": 1}


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """One draw of a world: everything about a record except the effect."""

    axis: Axis
    sampling: float  # period of the record, s
    faster: int = 1  # control periods in a sampling period
    substep: float = 4e-5  # largest substep, s
    duration: float  # s
    loop: str  # open, cascade or pid
    excitation: str
    bandwidth: float  # of a closed loop's velocity, Hz
    command: str = "held"  # course between samples, and form in the record
    encoders: dict[str, float]  # odds of each kind, also below
    currents: dict[str, float]  # none of a drive
    resolution: float  # of the encoder, m
    interpolation: float = 0.0  # its error within a signal period, m
    noise: str  # kind of friction noise
    noise_size: float  # share of the dry friction
    exact: float = 0.25  # share of records in which no believed value is off
    finest: float = 1.0  # factor on the smallest effects
    correlation_time: float = 0.0  # of slow friction noise, s; 0: random
    current_noise: float = 1.0  # factor on the ammeter's noise
    jitter: float = 0.0  # standard deviation of the time stamps, share of the sampling period
    resampled: float = 0.0  # original period of a resampled record, share of the new one
    lead_in: float = 0.0  # time in which the axis moves to its start position before the record, s
    # unknown properties that are reduced until they are invisible, by name
    tolerated: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.sampling / self.faster

    def periods(self, time: float) -> int:
        """Number of control periods in a time, in whole samples."""
        return int(time / self.sampling) * self.faster


def by_name(*functions: Callable[..., Any]) -> dict[str, Callable[..., Any]]:
    return {function.__name__: function for function in functions}


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def log_uniforms(rng: Rng, *ranges: tuple[float, float]) -> list[float]:
    return [log_uniform(rng, *ends) for ends in ranges]


def pick(rng: Rng, odds: dict[str, float]) -> str:
    weights = np.array(list(odds.values()))
    return str(rng.choice(list(odds), p=weights / weights.sum()))


def drawn(rng: Rng, axis: Axis, **table: Any) -> Conditions:
    """Conditions of a table, drawn in the order of their fields.

    A tuple is a range of which the logarithm is drawn (of the duration, itself), a list is a choice
    of equally probable values, and a dict has the odds of names.
    """
    table = {"loop": OFTEN_CASCADE, "excitation": TRAVELS, "bandwidth": (4, 10)} | table
    if axis.plant == DRIVE:
        table["currents"] = {"none": 1}
    found: dict[str, Any] = {"axis": axis}
    for name in (f.name for f in fields(Conditions) if f.name in table):
        said = table[name]
        if isinstance(said, tuple):
            said = float(rng.uniform(*said)) if name == "duration" else log_uniform(rng, *said)
        elif isinstance(said, list):
            said = rng.choice(said).item()
        elif isinstance(said, dict) and name in ("loop", "excitation", "command", "noise"):
            said = pick(rng, said)
        found[name] = said
    return Conditions(**found)


THESIS = {
    "kt": 37.4e-3, "ke": 0.0374482, "R": 21.4, "L": 0.953e-3, "p": 1000.0, "m": 1.0, "Jm": 0.0,
    "sigma0": 66967.231, "sigma1": 344.56, "sigma2": 173.0, "Fc": 1.284, "Fs": 2.35,
    "Vs": 1.13975e-3,
}  # fmt: skip
SCATTERED = {
    "m": 1.0, "sigma0": 66967.0, "sigma1": 344.0, "sigma2": 173.0, "Fc": 1.284, "Vs": 1.14e-3,
}  # fmt: skip


def _near_thesis(rng: Rng, names: Any = SCATTERED) -> dict[str, float]:
    """The thesis' values, changed at random by up to a third."""
    return {name: SCATTERED[name] * log_uniform(rng, 0.75, 1.33) for name in names}


def _slide(
    rng: Rng, mass: float, coulomb: float, fastest: float, travel=0.3, viscous=(0.2, 1.5), peak=1.5
) -> Axis:
    """A slide driven by a force: dry friction, set-valued or of stiff bristles."""
    values = {
        "m": mass,
        "gain": log_uniform(rng, 10.0, 60.0),
        "sigma2": coulomb / fastest * log_uniform(rng, *viscous),
        "Fc": coulomb,
        "Fs": coulomb * float(rng.choice([1.0, rng.uniform(1.05, peak)])),
        "Vs": 0.02 * fastest * log_uniform(rng, 0.5, 3.0),
        "offset": coulomb * float(rng.uniform(-0.2, 0.2)),
    }
    most = 4 * mass * fastest / ROUNDED + 3 * (coulomb + values["sigma2"] * fastest)
    formulation = int(rng.choice([SET_VALUED, SET_VALUED, LUGRE, MAXWELL]))
    if coulomb > STIFF * mass:
        formulation = SET_VALUED
    return Axis(DRIVE, "classical", values, formulation, travel, most / values["gain"], fastest)


def _screw(rng: Rng, lead: float, mass: float, coulomb: float, fastest: float) -> Axis:
    """A ball screw with a motor sized for its friction and its speed."""
    turn = 2 * np.pi / lead
    torque = log_uniform(rng, 0.05, 0.5)
    rated = 2 * coulomb / (torque * turn)  # A
    resistance = torque * turn * fastest / rated * log_uniform(rng, 0.1, 0.5)
    values = {"kt": torque, "ke": torque * float(rng.uniform(0.97, 1.03)), "R": resistance}
    values["L"] = resistance * log_uniform(rng, 1e-3, 6e-3)
    values |= _block(rng, lead, mass, coulomb, fastest, 1.5)
    law, formulation = "classical", int(rng.choice([SET_VALUED, MAXWELL]))
    if coulomb > STIFF * mass:
        formulation = SET_VALUED
    if rng.uniform() < 0.5:
        law, formulation = "lugre", LUGRE
        values |= _bristles(rng, values, turn)
    accelerating = 4 * (mass + values["Jm"] * turn**2) * fastest / ROUNDED
    force = accelerating + 3 * (coulomb + values["sigma2"] * fastest)
    most = torque * turn * fastest + resistance * force / (torque * turn)
    return Axis(BALL_SCREW, law, values, formulation, 0.2, 1.3 * most, fastest)


def _block(
    rng: Rng, lead: float, mass: float, coulomb: float, fastest: float, most: float
) -> dict[str, float]:
    """Screw, masses and friction; `most` is the largest viscous friction, share of the dry one."""
    return {
        "p": 1 / lead,
        "m": mass,
        "Jm": mass / (2 * np.pi / lead) ** 2 * log_uniform(rng, 0.3, 3.0),
        "sigma2": coulomb / fastest * log_uniform(rng, 0.3, most),
        "Fc": coulomb,
        "Fs": coulomb * float(rng.uniform(1.0, 1.5)),
        "Vs": 0.02 * fastest * log_uniform(rng, 0.5, 3.0),
    }


def _bristles(rng: Rng, values: dict[str, float], turn: float) -> dict[str, float]:
    """Stiffness and damping of bristles, by a presliding distance of 2 to 30 um."""
    stiffness = values["Fs"] / log_uniform(rng, 2e-6, 30e-6)
    whole = values["m"] + values["Jm"] * turn**2
    damping = float(rng.uniform(0.2, 1.0)) * 2 * np.sqrt(stiffness * whole)
    return {"sigma0": stiffness, "sigma1": damping}


def fast_screw(rng: Rng) -> Conditions:
    """The thesis' axis without rotor inertia, a drive faster than the sampling; open loop."""
    values = THESIS if rng.uniform() < 0.3 else THESIS | _near_thesis(rng)
    values = values | {"Fs": values["Fc"] * (2.35 / 1.284)}
    formulation = int(rng.choice([MODIFIED_LUGRE, LUGRE]))
    return drawn(
        rng, Axis(BALL_SCREW, "lugre", values, formulation, 0.3, 36.0, 0.1),
        sampling=[5e-4, 1e-3, 1e-3, 2e-3], substep=2e-5, duration=(10, 20), loop="open",
        excitation=ANY_OPEN, bandwidth=0.0, command={"held": 3, "ramped": 1},
        encoders={"round": 3, "floor": 1}, currents={"good": 1, "none": 1},
        resolution=[1e-3 / 512, 1e-3 / 2048], noise={"none": 3, "white": 1},
        noise_size=(0.002, 0.05), exact=0.4, finest=0.2,
    )  # fmt: skip


def heavy_screw(rng: Rng) -> Conditions:
    """A rotor of many times the block's mass, and friction that depends on position."""
    values = THESIS | {"Jm": 4.2e-7 * log_uniform(rng, 0.5, 3.0)} | _near_thesis(rng)
    values["Fs"] = values["Fc"] * float(rng.uniform(1.05, 2.0))
    loop = pick(rng, {"open": 1, "cascade": 1, "pid": 1})
    return drawn(
        rng, Axis(BALL_SCREW, "lugre", values, LUGRE, 0.25, 36.0, 0.08),
        sampling=[2e-4, 5e-4, 1e-3], substep=2e-5, duration=(8, 20), loop=loop,
        excitation=ANY_OPEN if loop == "open" else {"laps": 1, "points": 1, "sines": 1, "sweep": 1},
        bandwidth=(8, 25), encoders={"interpolated": 2, "round": 1},
        currents={"good": 2, "filtered": 1, "none": 1}, resolution=(0.02e-6, 1e-6),
        interpolation=(0.02e-6, 0.5e-6),
        noise={"texture_repeating": 2, "texture_not_repeating": 1, "slow": 2, "white": 1},
        noise_size=(0.005, 0.1),
    )  # fmt: skip


def linear_drive(rng: Rng) -> Conditions:
    """A slide driven by a force, no armature, 200 Hz to 1 kHz, with filtered positions."""
    mass, share, fastest = log_uniforms(rng, (5, 150), (0.1, 0.5), (0.1, 0.6))
    return drawn(
        rng, _slide(rng, mass, mass * share, fastest, viscous=(0.3, 3.0), peak=1.6),
        sampling=[1e-3, 1e-3, 2e-3, 5e-3], substep=2.5e-5, duration=(12, 30),
        excitation={"laps": 2, "points": 1, "sines": 1, "sweep": 1},
        encoders={"filtered": 2, "round": 1, "interpolated": 1}, resolution=(0.1e-6, 3e-6),
        interpolation=(0.05e-6, 1e-6),
        noise={"slow": 3, "white": 1, "texture_repeating": 1, "none": 1}, noise_size=(0.003, 0.08),
    )  # fmt: skip


def industrial(rng: Rng) -> Conditions:
    """A machine tool's axis, its drive slower than the sampling, with a faster controller."""
    lead = float(rng.choice(LEADS))
    turn = 2 * np.pi / lead
    ranges = (20, 200), (0.3, 1.5), (0.1, 0.4), (0.3, 0.8)
    mass, share, fastest, torque = log_uniforms(rng, *ranges)
    coulomb = mass * share
    values = {"kt": torque, "ke": torque * float(rng.uniform(0.97, 1.03))}
    values["R"], values["L"] = log_uniforms(rng, (0.6, 3.0), (3e-3, 12e-3))
    values |= _block(rng, lead, mass, coulomb, fastest, 2.0)
    law = pick(rng, {"lugre": 1, "classical": 1})
    if law == "lugre":
        values |= _bristles(rng, values, turn)
    formulation = LUGRE if law == "lugre" else int(rng.choice([SET_VALUED, MAXWELL]))
    volts = values["ke"] * turn * fastest + values["R"] * 6 * coulomb / (torque * turn)
    return drawn(
        rng, Axis(BALL_SCREW, law, values, formulation, 0.25, 1.5 * volts, fastest),
        sampling=[2.5e-4, 5e-4, 1e-3], faster=[2, 4], substep=2.5e-5, duration=(8, 16),
        loop=MOSTLY_CASCADE, excitation=TRAVELS | {"sweep": 1}, bandwidth=(8, 25),
        command="averaged", encoders={"floor": 3, "interpolated": 1},
        currents={"offset_and_gain": 2, "filtered": 1, "coarse": 1, "none": 1},
        resolution=(0.1e-6, 5e-6), interpolation=(0.05e-6, 1e-6),
        noise={"growing_with_speed": 3, "slow": 1, "texture_not_repeating": 1},
        noise_size=(0.003, 0.05), exact=0.2,
    )  # fmt: skip


def simulated(rng: Rng) -> Conditions:
    """Output of another program: no counts, very little noise, much faster than a recorder."""
    rotor = 4.2e-7 * float(rng.choice([0.0, 1.0]))
    values = THESIS | {"Jm": rotor} | _near_thesis(rng, ("m", "sigma2", "Fc"))
    values["Fs"] = values["Fc"] * float(rng.uniform(1.0, 1.9))
    law, formulation = pick(rng, {"lugre": 3, "classical": 1}), MODIFIED_LUGRE
    if law == "classical":
        values = {n: v for n, v in values.items() if n not in ("sigma0", "sigma1")}
        formulation = SET_VALUED
    loop = pick(rng, {"open": 2, "cascade": 1})
    return drawn(
        rng, Axis(BALL_SCREW, law, values, formulation, 0.3, 36.0, 0.1),
        sampling=[1e-4, 2e-4, 5e-4], substep=1e-5, duration=(8, 10), loop=loop,
        excitation=ANY_OPEN if loop == "open" else {"points": 1, "sines": 1, "sweep": 1},
        bandwidth=(10, 40), command={"held": 1, "ramped": 1} if loop == "open" else "held",
        encoders={"exact": 3, "interpolated": 1}, currents={"good": 1, "none": 1}, resolution=1e-9,
        interpolation=2e-9, noise={"none": 2, "white": 1, "slow": 1}, noise_size=(1e-4, 0.01),
        exact=0.5, finest=0.03,
    )  # fmt: skip


def heavy_friction(rng: Rng) -> Conditions:
    """Friction of seals and preload, 10 to 60 times the inertial force."""
    mass, fastest, share = log_uniforms(rng, (5, 50), (0.03, 0.2), (6, 40))
    coulomb = share * mass * fastest / ROUNDED  # most speeds are lower
    return drawn(
        rng, _slide(rng, mass, coulomb, fastest), sampling=[1e-3, 2e-3, 5e-3], duration=(12, 22),
        encoders={"round": 2, "interpolated": 1, "filtered": 1}, resolution=(0.1e-6, 3e-6),
        interpolation=(0.05e-6, 1e-6), noise="white", noise_size=(0.02, 0.05),
    )  # fmt: skip


def slow_noise(rng: Rng) -> Conditions:
    """Friction that varies slowly, over 80 ms to a second, as from lubricant and balls."""
    fastest, mass, share = log_uniforms(rng, (0.08, 0.4), (10, 150), (0.3, 2.0))
    body, drive = (mass, mass * share, fastest), rng.uniform() < 0.5
    lead = float(rng.choice(LEADS))
    return drawn(
        rng, _slide(rng, *body) if drive else _screw(rng, lead, *body), sampling=[1e-3, 1e-3, 2e-3],
        duration=(12, 20), excitation=TRAVELS | {"sweep": 1}, bandwidth=(5, 15),
        encoders={"round": 2, "interpolated": 1, "floor": 1},
        currents={"good": 2, "offset_and_gain": 1, "none": 1}, resolution=(0.1e-6, 2e-6),
        interpolation=(0.05e-6, 0.5e-6), noise="slow", noise_size=(0.03, 0.10),
        correlation_time=(0.08, 1.0),
    )  # fmt: skip


def jittered(rng: Rng) -> Conditions:
    """Time stamps of a busy computer; some records are resampled to an equidistant grid."""
    fastest, mass, share = log_uniforms(rng, (0.05, 0.4), (5, 100), (0.2, 1.5))
    body, drive = (mass, mass * share, fastest), rng.uniform() < 0.5
    even = rng.uniform() < 0.4
    return drawn(
        rng, _slide(rng, *body) if drive else _screw(rng, 0.01, *body), sampling=[2e-3, 4e-3, 5e-3],
        faster=[2, 4], duration=(12, 20), excitation=TRAVELS | {"sweep": 1}, command="averaged",
        encoders={"round": 2, "floor": 1}, currents={"good": 1, "offset_and_gain": 1, "none": 1},
        resolution=(0.1e-6, 5e-6), noise={"white": 1, "slow": 2, "texture_repeating": 1},
        noise_size=(0.005, 0.05), jitter=0.0 if even else (0.02, 0.15),
        resampled=[0.5, 0.8, 1.25, 4 / 3] if even else 0.0,
    )  # fmt: skip


def one_way(rng: Rng) -> Conditions:
    """A press or a feed: forwards in one record, backwards in the other, the same force in both."""
    fastest, mass, share = log_uniforms(rng, (0.1, 0.3), (5, 150), (0.3, 3.0))
    axis = _slide(rng, mass, mass * share, fastest, travel=0.25)
    coulomb = axis.values["Fc"]
    offset = coulomb * float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.6))
    axis.values["offset"] = offset
    off = coulomb * float(rng.uniform(-0.05, 0.05))  # more would be `load_bias`
    return drawn(
        rng, axis, sampling=[1e-3, 2e-3, 5e-3], duration=(8, 12), excitation="one_way",
        encoders={"round": 2, "interpolated": 1, "filtered": 1}, resolution=(0.1e-6, 3e-6),
        interpolation=(0.05e-6, 1e-6), noise={"white": 1, "slow": 2}, noise_size=(0.01, 0.06),
        lead_in=0.5 + 1.5 * axis.travel / fastest, tolerated={"load_bias": {"load": offset + off}},
    )  # fmt: skip


def geared_joint(rng: Rng) -> Conditions:
    """An arm's joint, slow and viscous, as a mass on the circle of its tool, most of it a rotor."""
    ranges = (0.1, 0.4), (50, 160), (2e-5, 2e-4), (1.1, 1.6)
    radius, ratio, rotor, whole = log_uniforms(rng, *ranges)  # m, 1, kg*m^2, 1
    mass = rotor * (ratio / radius) ** 2 * whole
    travel = radius * float(rng.uniform(0.3, 0.6))  # m, up to a third of a turn
    fastest = radius * log_uniform(rng, 0.15, 0.6)
    axis = _slide(rng, mass, mass * fastest / ROUNDED * log_uniform(rng, 0.5, 3.0), fastest, travel)
    coulomb = axis.values["Fc"]
    axis.values["sigma2"] = coulomb / fastest * log_uniform(rng, 1.0, 3.0)
    axis.values["offset"] = weight = coulomb * float(rng.uniform(-0.6, 0.6))
    slope = 0.2 * weight / travel  # of its lever arm, and so of the load of the gear
    return drawn(
        rng, axis, sampling=[1e-3, 2e-3, 4e-3], duration=(12, 20), loop=MOSTLY_CASCADE,
        excitation={"laps": 1, "points": 2, "sines": 2}, encoders={"round": 3, "filtered": 1},
        resolution=[2 * np.pi * radius / ratio / counts for counts in (4096.0, 8192.0, 65536.0)],
        noise={"white": 1, "slow": 2, "texture_repeating": 1}, noise_size=(0.01, 0.06), exact=0.2,
        tolerated={"gravity": {"load_slope": slope}, "load_dependence": {"trend": 0.05}},
    )  # fmt: skip


def low_sampling(rng: Rng) -> Conditions:
    """A slow machine recorded by a PLC, at 50 to 100 Hz."""
    fastest, mass, share = log_uniforms(rng, (0.02, 0.15), (10, 200), (0.3, 2.0))
    body, drive = (mass, mass * share, fastest), rng.uniform() < 0.5
    return drawn(
        rng, _slide(rng, *body, 0.2) if drive else _screw(rng, 5e-3, *body),
        sampling=[0.01, 0.0125, 0.02], faster=10, substep=5e-5, duration=(25, 50), bandwidth=(2, 6),
        command="averaged", encoders={"round": 2, "floor": 1},
        currents={"filtered": 1, "offset_and_gain": 1, "none": 1}, resolution=(0.2e-6, 5e-6),
        noise={"white": 1, "slow": 2}, noise_size=(0.005, 0.05),
    )  # fmt: skip


def warming(rng: Rng) -> Conditions:
    """A machine that starts cold: its friction falls, by less than its noise."""
    fastest, mass = log_uniforms(rng, (0.08, 0.3), (10, 150))
    duration = float(rng.uniform(14, 22))
    drift = {"drift": -float(rng.uniform(0.03, 0.10)), "drift_form": 1.0}
    drift["drift_time"] = float(rng.uniform(0.2, 0.6)) * duration
    lead = float(rng.choice(LEADS))
    return drawn(
        rng, _screw(rng, lead, mass, mass * log_uniform(rng, 0.4, 2.0), fastest),
        sampling=[1e-3, 2e-3], duration=duration, loop=MOSTLY_CASCADE, bandwidth=(5, 15),
        encoders={"round": 2, "interpolated": 1},
        currents={"good": 2, "offset_and_gain": 1, "filtered": 1}, resolution=(0.1e-6, 2e-6),
        interpolation=(0.05e-6, 0.5e-6), noise="slow", noise_size=(0.06, 0.12),
        correlation_time=(0.7, 3.0), tolerated={"friction_drift": drift},
    )  # fmt: skip


def held_back_lead_screw(rng: Rng) -> Conditions:
    """A trapezoidal thread: self-locking, and breaks away abruptly."""
    lead = float(rng.choice([2e-3, 3e-3, 4e-3]))
    fastest, mass, share = log_uniforms(rng, (0.01, 0.04), (3, 40), (3, 15))
    axis = _screw(rng, lead, mass, mass * share, fastest)
    values = axis.values
    values["Fs"] = values["Fc"] * float(rng.uniform(1.4, 2.2))
    values["Vs"] = fastest * log_uniform(rng, 0.05, 0.2)
    return drawn(
        rng, axis, sampling=[5e-4, 1e-3, 2e-3], duration=(12, 20),
        excitation={"laps": 1, "points": 2, "sines": 1}, bandwidth=(5, 15),
        encoders={"round": 3, "floor": 1}, currents={"offset_and_gain": 2, "coarse": 1},
        resolution=[lead / 1000.0, lead / 4096.0, lead / 10000.0],
        noise={"white": 1, "slow": 1, "texture_repeating": 1}, noise_size=(0.01, 0.06),
        current_noise=(2.0, 10.0),
    )  # fmt: skip


def held_back_gantry(rng: Rng) -> Conditions:
    """A heavy bridge on rails, driven by belt or rack: little friction for its weight."""
    fastest, mass, share = log_uniforms(rng, (0.3, 1.0), (80, 600), (0.05, 0.2))
    return drawn(
        rng, _slide(rng, mass, mass * share, fastest, 1.0),
        sampling=[5e-3, 8e-3, 10e-3], faster=5, substep=5e-5, duration=(20, 40),
        loop=MOSTLY_CASCADE, bandwidth=(2, 5), command="averaged", encoders={"filtered": 1},
        resolution=(2e-6, 50e-6), noise="slow", noise_size=(0.02, 0.10), exact=0.2,
        correlation_time=(0.05, 0.8),
    )  # fmt: skip


def wrong_scales(rng: Rng) -> Conditions:
    """A known axis with a record that was converted to SI by hand, with one wrong scale."""
    conditions = industrial(rng) if rng.uniform() < 0.6 else fast_screw(rng)
    return replace(conditions, currents=conditions.currents | {"none": 0.3}, finest=1.0)


WORLDS: dict[str, Callable[[Rng], Conditions]] = by_name(
    fast_screw, heavy_screw, linear_drive, industrial, simulated, heavy_friction, slow_noise,
    jittered, one_way, geared_joint, low_sampling, warming, held_back_lead_screw,
    held_back_gantry, wrong_scales,
)  # fmt: skip
# not to be used to fit, tune or choose anything
HELD_BACK = ("held_back_lead_screw", "held_back_gantry")

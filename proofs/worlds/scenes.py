"""A world's draw ready for simulation: reference motion, noise and instruments, for variants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from worlds import layout as at
from worlds.axes import breakaway_command, double_of, rated_command
from worlds.conditions import Conditions
from worlds.controllers import (
    CASCADE,
    FEEDFORWARD,
    FILTER,
    GAIN_D,
    GAIN_I,
    GAIN_P,
    KIND,
    MOST,
    NUMBERS,
    PID,
    POSITION_GAIN,
)
from worlds.excitations import lead_in, one_way, open_loop, reference
from worlds.friction_noise import FLAT, draw_correlation_time, draw_noise
from worlds.instruments import Instruments, draw_instruments
from worlds.layout import Vector
from worlds.simulator import BURST, Motion, Run, Texture, simulate

LOGGED_AT_LEAST = 5e-4  # longest logging period, s
SHOWN_WITHIN = 0.01  # motion of less than the encoder's error in this time is rest, s
UNSEEN_WAY = 0.02e-6  # bristles with a shorter presliding distance have no effect, m

Columns = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A world's draw, ready for simulation: reference motion, noise, instruments.

    `tolerated` are invisible properties of the noisy axis.
    """

    conditions: Conditions
    instruments: Instruments
    double: Vector
    faultless: Vector
    controller: Vector
    wanted: Columns
    noise: Columns
    texture: Texture
    rng: np.random.Generator
    correlation_time: float
    tolerated: dict[int, float] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.conditions.sampling / self.conditions.faster

    @property
    def logged(self) -> int:
        """Number of logging periods in a control period."""
        return int(np.ceil(self.period / LOGGED_AT_LEAST - 1e-9))

    @property
    def per_sample(self) -> int:
        """Number of logging periods in a sampling period."""
        return self.logged * self.conditions.faster

    @property
    def skipped(self) -> int:
        """Number of control periods before the record begins."""
        return int(self.conditions.lead_in / self.conditions.sampling) * self.conditions.faster

    def run(self, changes: dict[int, float], bursts: float, *, clean: bool) -> Motion:
        """Simulate the axis with changes, with or without its noise."""
        axis = self.faultless.copy()
        for place, value in (changes if clean else self.tolerated | changes).items():
            axis[place] = value
        noise = np.zeros_like(self.noise) if clean else self.noise.copy()
        if bursts:
            noise[:, BURST] = self._bursts(bursts)
        if clean:
            axis[at.RESOLUTION] = axis[at.INTERPOLATION] = 0.0
        substeps = int(np.ceil(self.period / self.logged / self.conditions.substep - 1e-9))
        motion = simulate(
            Run(
                axis=axis,
                double=self.double,
                controller=self.controller,
                wanted=self.wanted,
                noise=noise,
                texture=FLAT if clean else self.texture,
                substeps=substeps * self.logged,
                periods_logged=self.logged,
                period=self.period,
            )
        )
        skipped = self.skipped
        return Motion(motion.log[skipped * self.logged :], motion.commands[skipped:])

    def _bursts(self, force: float) -> Columns:
        """Half sines of 5 to 50 ms; the same ones for the same scene."""
        rng = np.random.default_rng(int(1e6 * self.conditions.duration))
        line = np.zeros(len(self.noise))
        for _ in range(int(rng.integers(3, 12))):
            long = int(rng.uniform(0.005, 0.05) / self.period) + 2
            start = int(rng.integers(0, max(line.size - long, 1)))
            shape = np.sin(np.linspace(0, np.pi, long))[: line.size - start]
            line[start : start + shape.size] += rng.choice([-1, 1]) * force * shape
        return line


def make_scenes(
    conditions: Conditions, rng: np.random.Generator, *, bare: bool
) -> tuple[Scene, ...]:
    """Motion, noise and instruments of every record; `bare` is without bristles in the law."""
    first = make_scene(conditions, rng, bare=bare)
    if conditions.excitation != "one_way":
        return (first,)
    return first, asked(first, -first.wanted, rng)


def asked(scene: Scene, wanted: Columns, rng: np.random.Generator) -> Scene:
    """The same machine with another reference motion and new friction noise."""
    c = scene.conditions
    noise, _, _ = draw_noise(
        rng, c.noise, c.noise_size, scene.double, wanted.size, scene.period, scene.correlation_time
    )
    return replace(scene, wanted=wanted, noise=noise)


def commanded(scene: Scene, command: Mapping[str, Columns], rng: np.random.Generator) -> Scene:
    """The same machine driven by positions `x_d` [m] or a command `u` [V] over `time` [s].

    Raises
    ------
    ValueError
        If neither or both are given, or the time does not increase.
    """
    if len({"x_d", "u"} & set(command)) != 1 or "time" not in command:
        raise ValueError(f"columns {', '.join(command)}, expected time and either x_d or u")
    stamps = np.asarray(command["time"], dtype=float)
    if stamps.size < 2 or not np.all(np.diff(stamps) > 0):
        raise ValueError("time of a command has to grow")
    closed, c = "x_d" in command, scene.conditions
    values = np.asarray(command["x_d" if closed else "u"], dtype=float)
    long = float(stamps[-1] - stamps[0])
    # from rest in the middle to the start of the motion
    away = abs(values[0]) if closed else 0.0
    lead = 0.5 + 1.5 * away / c.axis.fastest if away > 0 else 0.0
    held = c.loop if c.loop != "open" else "cascade"
    c = replace(
        c,
        duration=long,
        lead_in=lead,
        loop=held if closed else "open",
        bandwidth=c.bandwidth or 15.0,
        excitation="commanded",
    )
    count = int(long / c.sampling + 1e-9) * c.faster
    time = np.arange(count) * scene.period
    if closed or scene.double[at.RAMPED]:
        wanted = np.interp(time, stamps - stamps[0], values)
    else:
        now = np.searchsorted(stamps - stamps[0], time + 1e-9, side="right") - 1
        wanted = values[now]
    double, faultless = scene.double.copy(), scene.faultless.copy()
    if closed:  # a controller holds its command
        double[at.RAMPED] = faultless[at.RAMPED] = 0.0
    scene = replace(
        scene,
        conditions=c,
        double=double,
        faultless=faultless,
        controller=_controller(c, double),
    )
    return asked(scene, _led_in(scene, wanted), rng)


def _led_in(scene: Scene, wanted: Columns) -> Columns:
    """The motion, after a motion to its start."""
    if not scene.skipped:
        return wanted
    time = np.arange(scene.skipped) * scene.period
    return np.concatenate([lead_in(wanted[0], time), wanted])


def make_scene(conditions: Conditions, rng: np.random.Generator, *, bare: bool) -> Scene:
    """Motion, noise and instruments of the first record."""
    axis = conditions.axis
    if bare:
        values = {n: v for n, v in axis.values.items() if n not in ("sigma0", "sigma1")}
        axis = replace(axis, law="classical", values=values, formulation=at.SET_VALUED)
        conditions = replace(conditions, axis=axis)
    instruments = draw_instruments(
        rng, conditions.encoders, conditions.currents, conditions.command
    )
    louder = conditions.current_noise * instruments.current_noise
    instruments = replace(instruments, current_noise=louder)
    double = double_of(axis, conditions.duration)
    shown = conditions.resolution + conditions.interpolation
    double[at.LEAST_SPEED] = shown / SHOWN_WITHIN
    double[at.RAMPED] = float(conditions.command == "ramped")
    faultless = double.copy()
    faultless[at.LAW] = axis.formulation
    if axis.law == "classical" and axis.formulation != at.SET_VALUED:
        # invisibly stiff bristles: a user would choose the classical law
        faultless[at.SIGMA0] = axis.values["Fs"] / UNSEEN_WAY
        mass = faultless[at.MOTOR_MASS] + faultless[at.BLOCK_MASS]
        faultless[at.SIGMA1] = np.sqrt(faultless[at.SIGMA0] * mass)
    if instruments.encoder != "exact":
        faultless[at.RESOLUTION] = conditions.resolution
    faultless[at.FLOORS] = float(instruments.encoder == "floor")
    if instruments.encoder == "interpolated":
        faultless[at.INTERPOLATION] = conditions.interpolation
        faultless[at.SIGNAL_PERIOD] = 20e-6
    period = conditions.sampling / conditions.faster
    count = int(conditions.duration / conditions.sampling) * conditions.faster
    skipped = int(conditions.lead_in / conditions.sampling) * conditions.faster
    correlation_time = draw_correlation_time(rng)
    correlation_time = conditions.correlation_time or correlation_time
    noise, texture, growth = draw_noise(
        rng,
        conditions.noise,
        conditions.noise_size,
        double,
        count + skipped,
        period,
        correlation_time,
    )
    faultless[at.NOISE_GROWTH] = growth
    time = np.arange(count) * period
    if conditions.loop == "open":
        least = breakaway_command(axis)
        way = 0.25 * axis.travel / axis.fastest * rated_command(axis, axis.fastest)
        most = axis.most * float(np.exp(rng.uniform(np.log(0.3), 0.0)))
        wanted = open_loop(rng, conditions.excitation, time, most, least, way)
    else:
        fastest = axis.fastest * float(np.exp(rng.uniform(np.log(0.4), 0.0)))
        half = 0.7 * axis.travel * float(rng.uniform(0.3, 1.0))
        if conditions.excitation == "one_way":
            wanted = one_way(rng, time, half, fastest)
        else:
            wanted = reference(rng, conditions.excitation, time, half, fastest)
    controller = _controller(conditions, double)
    scene = Scene(
        conditions, instruments, double, faultless, controller, wanted, noise, texture, rng,
        correlation_time,
    )  # fmt: skip
    return replace(scene, wanted=_led_in(scene, wanted))


def _controller(conditions: Conditions, par: Vector) -> Vector:
    """Gains from the axis' first-order response and the bandwidth of its velocity."""
    numbers = np.zeros(NUMBERS)
    if conditions.loop == "open":
        return numbers
    mass = par[at.MOTOR_MASS] + par[at.BLOCK_MASS]
    if par[at.IS_DRIVE]:
        per_speed, per_acceleration = par[at.SIGMA2] / par[at.GAIN], mass / par[at.GAIN]
    else:
        per_speed = par[at.KE] + par[at.R] * par[at.SIGMA2] / par[at.KT]
        per_acceleration = par[at.R] * mass / par[at.KT]
    angular = 2 * np.pi * min(conditions.bandwidth, 0.04 / conditions.sampling)
    gain = angular * per_acceleration
    integral = max(angular * per_speed, 0.25 * angular * gain)
    outer = angular / 5
    numbers[MOST], numbers[FILTER] = conditions.axis.most, 0.15 / angular
    numbers[POSITION_GAIN], numbers[FEEDFORWARD] = outer, 1.0
    if conditions.loop == "cascade":
        numbers[KIND], numbers[GAIN_P], numbers[GAIN_I] = CASCADE, gain, integral
    else:
        numbers[KIND], numbers[GAIN_D] = PID, gain
        numbers[GAIN_P], numbers[GAIN_I] = gain * outer + integral, integral * outer
    return numbers

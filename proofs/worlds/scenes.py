"""A world's draw made ready: the motion asked for, noise and instruments, to be run in variants."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from worlds import layout as at
from worlds.axes import breakaway_command, double_of, rated_command
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
from worlds.excitations import open_loop, reference
from worlds.friction_noise import FLAT, draw_noise
from worlds.instruments import Instruments, draw_instruments
from worlds.layout import Vector
from worlds.simulator import BURST, Motion, Run, Texture, simulate
from worlds.worlds import Conditions

LOGGED_AT_LEAST = 5e-4  # s
SHOWN_WITHIN = 0.01  # s: a motion by less than the encoder's error in this time is rest
UNSEEN_WAY = 0.02e-6  # m: bristles that break away so soon are as good as none

Columns = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A world's draw, ready to be simulated: motion asked for, noise, instruments."""

    conditions: Conditions
    instruments: Instruments
    double: Vector
    faultless: Vector
    controller: Vector
    wanted: Columns
    noise: Columns
    texture: Texture
    rng: np.random.Generator

    @property
    def period(self) -> float:
        """Of control, s."""
        return self.conditions.sampling / self.conditions.faster

    @property
    def logged(self) -> int:
        """Logging periods in a control period."""
        return int(np.ceil(self.period / LOGGED_AT_LEAST - 1e-9))

    @property
    def per_sample(self) -> int:
        """Logging periods in a sampling period."""
        return self.logged * self.conditions.faster

    def run(self, changes: dict[int, float], bursts: float, *, clean: bool) -> Motion:
        """The axis with changes, with its noise or without."""
        axis = self.faultless.copy()
        for place, value in changes.items():
            axis[place] = value
        noise = np.zeros_like(self.noise) if clean else self.noise.copy()
        if bursts:
            noise[:, BURST] = self._bursts(bursts)
        if clean:
            axis[at.RESOLUTION] = axis[at.INTERPOLATION] = 0.0
        substeps = int(np.ceil(self.period / self.logged / self.conditions.substep - 1e-9))
        return simulate(
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


def make_scene(conditions: Conditions, rng: np.random.Generator, *, bare: bool) -> Scene:
    """Motion, noise and instruments for conditions; `bare` is without bristles in the law."""
    axis = conditions.axis
    if bare:
        values = {n: v for n, v in axis.values.items() if n not in ("sigma0", "sigma1")}
        axis = replace(axis, law="classical", values=values, formulation=at.SET_VALUED)
        conditions = replace(conditions, axis=axis)
    instruments = draw_instruments(
        rng, conditions.encoders, conditions.currents, conditions.command
    )
    double = double_of(axis, conditions.duration)
    shown = conditions.resolution + conditions.interpolation
    double[at.LEAST_SPEED] = shown / SHOWN_WITHIN
    double[at.RAMPED] = float(conditions.command == "ramped")
    faultless = double.copy()
    faultless[at.LAW] = axis.formulation
    if axis.law == "classical" and axis.formulation != at.SET_VALUED:
        # bristles too stiff to be seen, as a user of the classical law would say
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
    noise, texture, growth = draw_noise(
        rng, conditions.noise, conditions.noise_size, double, count, period
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
        wanted = reference(rng, conditions.excitation, time, half, fastest)
    controller = _controller(conditions, double)
    return Scene(
        conditions, instruments, double, faultless, controller, wanted, noise, texture, rng
    )


def _controller(conditions: Conditions, par: Vector) -> Vector:
    """Gains from the axis' first-order answer and the bandwidth wanted of its velocity."""
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

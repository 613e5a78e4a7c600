"""What drives the axis while an effect hides: voltages, or set-points under a controller.

The controllers' printed gains are the project's; how they run at 1 kHz is in `effects`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.controllers.nctf import nctf
from ballscrew.controllers.pid import simc
from hidden.effects import IOL, NCTF, NOMINAL, OPEN, PID, SAMPLE, SAMPLES, Array

EXCITATIONS = ("steps", "multisine", "ramps", "closed_pid", "closed_nctf", "closed_iol")


@dataclass
class Excitation:
    """What drives the axis."""

    name: str
    given: Array
    controller: int = OPEN
    gains: tuple[float, ...] = ()


def draw_excitation(random: np.random.Generator) -> Excitation:
    """One of `EXCITATIONS`, with its numbers."""
    name = EXCITATIONS[random.integers(len(EXCITATIONS))]
    time = np.arange(SAMPLES + 1) * SAMPLE
    if name == "steps":
        return Excitation(name, _steps(random, time))
    if name == "multisine":
        return Excitation(name, _multisine(random, time))
    if name == "ramps":
        peak, period = random.uniform(0.5, 3.0), random.uniform(3.0, 8.0)
        triangle = 2 / math.pi * np.arcsin(np.sin(2 * math.pi * time / period))
        return Excitation(name, random.choice([-1.0, 1.0]) * peak * triangle)
    reference = _moves(random, time)
    if name == "closed_pid":
        g = simc({"Jm": NOMINAL["Jm"]})
        return Excitation(name, reference, PID, (g.proportional, g.integral, g.derivative))
    if name == "closed_nctf":
        gains = {p.name: p.default for p in nctf().parameters}
        return Excitation(name, reference, NCTF, tuple(gains[n] for n in ("h", "c", "Kp", "Ki")))
    return Excitation(name, reference, IOL, (6.0 * 7.0, 6.0 + 7.0))


def _steps(random: np.random.Generator, time: Array) -> Array:
    u, begin, sign, place = np.zeros_like(time), 0.0, 1.0, 0.0
    while begin < time[-1]:
        end = begin + random.uniform(0.3, 1.5)
        sign = -sign if random.random() < 0.7 or place * sign > 0.08 else sign
        level = sign * random.uniform(0.5, 8.0)
        u[(time >= begin) & (time < end)] = level
        place += 0.004 * level * (end - begin)
        begin = end
    return u


def _multisine(random: np.random.Generator, time: Array) -> Array:
    count = int(random.integers(5, 9))
    frequencies = np.exp(random.uniform(math.log(0.1), math.log(5.0), count))
    phases = random.uniform(0, 2 * math.pi, count)
    shares = random.uniform(0.3, 1.0, count)
    u = shares @ np.sin(2 * math.pi * frequencies[:, None] * time + phases[:, None])
    speed = random.uniform(0.01, 0.04)
    return np.asarray(u * speed / 0.004 / np.abs(u).max())


def _moves(random: np.random.Generator, time: Array) -> Array:
    smooth = random.random() < 0.5
    reference, begin, here = np.zeros_like(time), 0.0, 0.0
    while begin < time[-1]:
        length, wait = random.uniform(0.005, 0.04), random.uniform(1.5, 4.0)
        sign = -np.sign(here) if abs(here) > 0.02 else random.choice([-1.0, 1.0])
        moving = random.uniform(0.5, 1.2) if smooth else SAMPLE
        s = np.clip((time - begin) / moving, 0.0, 1.0)
        shape = s**3 * (10 - 15 * s + 6 * s**2) if smooth else (s > 0).astype(float)
        reference += sign * length * shape
        here += sign * length
        begin += wait
    return reference

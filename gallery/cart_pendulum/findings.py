"""Hunting of a balanced pendulum on a cart with friction, in simulation and theory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

import ballscrew

from ..drawing import COLOURS, drawing, part
from ..finding import Finding, exponents
from ..finding import motion as run_of

CART, DRY, LUGRE = (part(__file__, name) for name in ("cart", "dry_cart", "lugre_cart"))
BALANCE = part(__file__, "balance")
M, BOB, ROD, G = 0.5, 0.2, 0.5, 9.81
WEIGHTS, EFFORT = (10.0, 1.0, 10.0, 1.0), 0.1
FRICTION = 0.1  # [N]
SHOWN = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # [N]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


def upright() -> tuple[Matrix, Vector]:
    """Rates of (x, v, th, w) near the upright pendulum, and the effect of a force on the cart."""
    rates = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, -BOB * G / M, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, (M + BOB) * G / (M * ROD), 0.0],
        ]
    )
    return rates, np.array([0.0, 1.0, 0.0, -1.0 / ROD]) / M


@cache
def designed() -> Vector:
    """The gains of the linear-quadratic design."""
    rates, force = upright()
    cost = solve_continuous_are(rates, force[:, None], np.diag(WEIGHTS), [[EFFORT]])
    return np.asarray(force @ cost / EFFORT)


def closed(viscous: float = 0.0) -> Matrix:
    """Rates of (x, v, th, w) in the loop, with viscous friction at the cart [N*s/m]."""
    rates, force = upright()
    return np.asarray(rates - np.outer(force, designed() + np.array([0.0, viscous, 0.0, 0.0])))


@dataclass(frozen=True)
class Swing:
    """A cycle by the describing function, per newton of Coulomb friction.

    Attributes
    ----------
    frequency : float
        Angular frequency [rad/s].
    cart : float
        Amplitude of the cart [m/N].
    third : float
        Amplitude of the velocity's neglected third harmonic over that of the first.
    """

    frequency: float
    cart: float
    third: float


@cache
def predicted() -> Swing:
    """The cycle of the describing function.

    For a velocity of amplitude V, Coulomb friction acts as a viscous friction of 4 Fc/(pi V). A
    cycle exists if the loop with this viscous friction has an imaginary eigenvalue.
    """
    viscous = float(brentq(lambda d: np.linalg.eigvals(closed(d)).real.max(), 1e-3, 1e3))
    values = np.linalg.eigvals(closed(viscous))
    frequency = float(abs(values[np.argmax(values.real)].imag))
    third = abs(mobility(3j * frequency) / mobility(1j * frequency)) / 3.0
    return Swing(frequency, 4.0 / (math.pi * viscous * frequency), third)


def mobility(s: complex) -> complex:
    """Velocity of the cart per force on it, in the loop [m/(N*s)]."""
    return complex(np.linalg.solve(s * np.eye(4) - closed(), upright()[1])[1])


def motion(plant: str, stop: float, step: float, angle: float = 0.05) -> Any:
    """The loop's motion from a tilted pendulum with the cart at rest."""
    return run_of(plant, stop, step, {"th_start": angle, "q_start": 0.0}, BALANCE, 0.0)


def becomes(plant: str, friction: float | None = None) -> Any:
    """Long-term motion of the loop, with these values of Coulomb and static friction [N]."""
    values = {"Fc": friction, "Fs": friction} if friction else {}
    return exponents(plant, 30.0, values, BALANCE, 0.0).motion


def swing_of(run: Any, since: float) -> float:
    """Half the range of the cart from a time on [m]."""
    return float(0.5 * np.ptp(run.outputs["x"][run.time >= since]))


def findings() -> list[Finding]:
    theory, free, dry = predicted(), becomes(CART), becomes(DRY)
    slowest = float(np.linalg.eigvals(closed()).real.max())
    gains = {p.name: p.default for p in ballscrew.component(BALANCE).parameters}
    design = "linear-quadratic design by SciPy: solve_continuous_are"
    left_out = "describing function of Coulomb friction; the share of the neglected third " + (
        f"harmonic, {theory.third:.2g}, is its tolerance"
    )
    sticks = "the cart stands still for most of the period, unlike a sine"
    pieces = "a cycle of pieces that are linear, solved for exactly, gives the same to 1e-4"
    eigenvalue, closed_rate = "eigenvalue of the linear loop", float(free.limit[0])
    scales = (
        "the linear loop with Coulomb friction scales with it; the square of the angle, "
        "1e-3, is neglected"
    )
    swing, at = dry.amplitude["plant_x"], "Fc = 0.1 N"
    larger = becomes(DRY, 1.0).amplitude["plant_x"] / swing
    size, frequency = theory.cart * FRICTION, theory.frequency
    bristles = swing_of(motion(LUGRE, 60.0, 0.02), 40.0)
    bend = (
        "bristles bend by Fc/sigma0 = 10 µm instead of sticking; LSODA of SciPy gives the same "
        "to 1e-3"
    )
    third, ours = theory.third, 2.0 * math.pi / dry.period
    slow, times = (
        "slowest exponent without friction [nats/s]",
        "swing with 1 N over that with 0.1 N",
    )
    lugre = "swing of the cart with LuGre friction of 0.1 N"
    return [
        *(
            Finding(f"gain {name}", gains[name], "1", design, float(theirs), 1e-4)
            for name, theirs in zip(gains, designed(), strict=True)
        ),
        Finding(slow, closed_rate, "1/s", eigenvalue, slowest, 1e-4),
        Finding(f"swing of the cart, {at}", swing, "m", left_out, size, third * size),
        Finding(f"frequency, {at}", ours, "rad/s", left_out, frequency, third * frequency, sticks),
        Finding(f"period, {at}", dry.period, "s", pieces),
        Finding(f"second exponent, {at} [nats/s]", float(dry.limit[1]), "1/s", pieces),
        Finding(times, larger, "1", scales, 10.0, 1e-2),
        Finding(lugre, bristles, "m", bend),
    ]


def picture() -> Any:
    with drawing(2, height=3.4) as (figure, (orbit, size)):
        for k, angle in enumerate((0.001, 0.05)):
            run = motion(DRY, 45.0, 0.02, angle)
            style = {"color": COLOURS[k], "lw": 1.2, "label": f"from {1e3 * angle:g} mrad"}
            orbit.plot(1e3 * run.outputs["x"], 1e3 * run.outputs["th"], **style)
        orbit.set(xlabel="cart [mm]", ylabel="rod [mrad]", xlim=(-14.0, 14.0), ylim=(-5.0, 5.0))
        orbit.set_title("Small and large motions meet in one cycle")
        orbit.legend(loc="upper right", fontsize=9)
        theory, loads = predicted(), np.geomspace(0.02, 15.0, 2)
        swings = 1e3 * theory.cart * loads
        size.loglog(loads, swings, color=COLOURS[1], label="describing function")
        style = {"color": COLOURS[1], "alpha": 0.2, "lw": 0, "label": "its third harmonic"}
        size.fill_between(loads, *(swings * (1.0 + s * theory.third) for s in (-1, 1)), **style)
        found = [1e3 * becomes(DRY, load).amplitude["plant_x"] for load in SHOWN]
        size.loglog(SHOWN, found, "o", color=COLOURS[0], label="motion")
        size.set(xlabel="friction [N]", ylabel="swing of the cart [mm]", xlim=(0.02, 15.0))
        size.set_title("Twice the friction swings twice as far")
        size.legend(loc="upper left")
    return figure

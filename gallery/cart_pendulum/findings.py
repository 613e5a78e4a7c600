"""Hunting of a balanced pendulum on a cart with friction, in simulation and theory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

import ballscrew

from ..drawing import COLOURS, drawing, part
from ..finding import Finding

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


@cache
def motion(plant: str, stop: float, step: float, angle: float = 0.05) -> Any:
    """The loop's motion from a tilted pendulum with the cart at rest."""
    return ballscrew.run(
        BALANCE,
        plant,
        reference=0.0,
        stop=stop,
        step=step,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values={"th_start": angle, "q_start": 0.0},
    ).run


@cache
def becomes(plant: str, friction: float | None = None) -> Any:
    """Long-term motion of the loop, with these values of Coulomb and static friction [N]."""
    values: Mapping[str, float] = {"Fc": friction, "Fs": friction} if friction else {}
    return ballscrew.lyapunov(BALANCE, plant, stop=30.0, reference=0.0, plant_values=values).motion


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
    return [
        *(
            Finding(f"gain {name}", gains[name], "1", design, float(theirs), 1e-4)
            for name, theirs in zip(gains, designed(), strict=True)
        ),
        Finding(
            "slowest exponent without friction [nats/s]",
            float(free.limit[0]),
            "1/s",
            "eigenvalue of the linear loop",
            slowest,
            1e-4,
        ),
        Finding(
            "swing of the cart, Fc = 0.1 N",
            dry.amplitude["plant_x"],
            "m",
            left_out,
            theory.cart * FRICTION,
            theory.third * theory.cart * FRICTION,
        ),
        Finding(
            "frequency, Fc = 0.1 N",
            2.0 * math.pi / dry.period,
            "rad/s",
            left_out,
            theory.frequency,
            theory.third * theory.frequency,
            sticks,
        ),
        Finding("period, Fc = 0.1 N", dry.period, "s", pieces),
        Finding("second exponent, Fc = 0.1 N [nats/s]", float(dry.limit[1]), "1/s", pieces),
        Finding(
            "swing with 1 N over that with 0.1 N",
            becomes(DRY, 1.0).amplitude["plant_x"] / dry.amplitude["plant_x"],
            "1",
            "the linear loop with Coulomb friction scales with it; the square of the angle, "
            "1e-3, is neglected",
            10.0,
            1e-2,
        ),
        Finding(
            "swing of the cart with LuGre friction of 0.1 N",
            swing_of(motion(LUGRE, 60.0, 0.02), 40.0),
            "m",
            "bristles bend by Fc/sigma0 = 10 µm instead of sticking; LSODA of SciPy gives the same "
            "to 1e-3",
        ),
    ]


def picture() -> Any:
    with drawing(2, 2, height=3.4) as (figure, (course, orbit, force, size)):
        for k, (plant, label) in enumerate(((CART, "no friction"), (DRY, "0.1 N of friction"))):
            run = motion(plant, 45.0, 0.02)
            course.plot(
                run.time,
                1e3 * run.outputs["x"],
                **{"color": COLOURS[k], "ls": ("--", "-")[k], "lw": 1.5, "label": label},
            )
        course.set(xlabel="time [s]", ylabel="cart [mm]", xlim=(0.0, 30.0), ylim=(-15.0, 40.0))
        course.set_title("With friction it never comes to rest")
        course.legend(loc="upper right")
        for k, angle in enumerate((0.001, 0.05)):
            run = motion(DRY, 45.0, 0.02, angle)
            orbit.plot(
                1e3 * run.outputs["x"],
                1e3 * run.outputs["th"],
                **{"color": COLOURS[k], "lw": 1.2, "label": f"from {1e3 * angle:g} mrad"},
            )
        orbit.set(xlabel="cart [mm]", ylabel="rod [mrad]", xlim=(-14.0, 14.0), ylim=(-5.0, 5.0))
        orbit.set_title("Small and large motions meet in one cycle")
        orbit.legend(loc="upper right", fontsize=9)
        run = motion(DRY, 45.0, 0.02)
        late = run.time > 30.0
        time, stuck = run.time[late] - 30.0, run.outputs["stuck"][late] > 0.5
        shade = {"color": "#bbbbbb", "alpha": 0.5, "lw": 0}
        force.fill_between(time, -0.12, 0.12, where=stuck, label="sticks", **shade)
        force.plot(time, run.outputs["friction"][late], color=COLOURS[1], label="friction [N]")
        force.plot(
            time,
            10.0 * run.outputs["v"][late],
            **{"color": COLOURS[0], "ls": "--", "label": "cart [0.1 m/s]"},
        )
        force.set(xlabel="time [s]", xlim=(0.0, 15.0), ylim=(-0.28, 0.36))
        force.set_title("It waits until the falling rod breaks it away")
        force.legend(loc="upper center", ncols=3, fontsize=9, columnspacing=1.0)
        theory, loads = predicted(), np.geomspace(0.02, 15.0, 2)
        size.loglog(
            loads,
            1e3 * theory.cart * loads,
            **{"color": COLOURS[1], "label": "describing function"},
        )
        size.fill_between(
            loads,
            *(1e3 * theory.cart * loads * (1.0 + s * theory.third) for s in (-1, 1)),
            **{"color": COLOURS[1], "alpha": 0.2, "lw": 0, "label": "its third harmonic"},
        )
        swings = [1e3 * becomes(DRY, load).amplitude["plant_x"] for load in SHOWN]
        size.loglog(SHOWN, swings, "o", color=COLOURS[0], label="motion")
        size.set(xlabel="friction [N]", ylabel="swing of the cart [mm]", xlim=(0.02, 15.0))
        size.set_title("Twice the friction swings twice as far")
        size.legend(loc="upper left")
    return figure

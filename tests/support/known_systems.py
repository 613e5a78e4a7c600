"""Small systems with known Lyapunov exponents: exact, from a map, or from the literature.

Entries of the linear system are parameters, so that a focus, a line of equilibria, a centre and all
random matrices need only one compiled module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import numpy.typing as npt
import sympy as sp

from ballscrew import TIME, Component, Event, Input, Mode, Output, Parameter, State, connect, symbol
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Kernel, Model

Matrix = npt.NDArray[np.float64]

x, v, y, z = (symbol(name) for name in "xvyz")

LORENZ = {"sigma": 10.0, "rho": 28.0, "beta": 8.0 / 3.0}
BELT_SPEED, FALLING = 0.2, 3.0  # m/s; s/m
TABLE_FREQUENCY, RESTITUTION, GRAVITY = 2.0 * np.pi, 0.5, 1.0
DRY = {"w": 2.0, "F": 1.0, "mu": 0.1, "damping": 0.05}
RELAY_LEVEL = 0.1


def _kernel(
    name: str,
    equations: Mapping[str, tuple[sp.Expr, float]],
    parameters: Mapping[str, float] | None = None,
    modes: tuple[Mode, ...] = (),
) -> Kernel:
    """States by their rates and start values, with parameters."""
    component = Component(
        name,
        "a system with known exponents",
        parameters=tuple(
            Parameter(k, value, "1", k, "made up") for k, value in (parameters or {}).items()
        ),
        states=tuple(State(n, "1", n, rate, start=start) for n, (rate, start) in equations.items()),
        outputs=tuple(Output(n, "1", n, symbol(n)) for n in equations),
        modes=modes,
    )
    return generate(component)


@cache
def linear() -> Kernel:
    """Three states, x' = A x; the entries of A are the parameters a00 to a22."""
    names = "xyz"
    entries = {f"a{i}{j}": -1.0 * (i == j) for i in range(3) for j in range(3)}
    rates = [sum(symbol(f"a{i}{j}") * symbol(names[j]) for j in range(3)) for i in range(3)]
    return _kernel("linear", {n: (rates[i], 1.0) for i, n in enumerate(names)}, entries)


def entries(matrix: npt.ArrayLike) -> dict[str, float]:
    """Parameters of `linear` from a matrix, shape (3, 3)."""
    a = np.asarray(matrix, dtype=float)
    return {f"a{i}{j}": float(a[i, j]) for i in range(3) for j in range(3)}


@cache
def lorenz() -> Kernel:
    sigma, rho, beta = (symbol(n) for n in LORENZ)
    rates = {
        "x": (sigma * (y - x), 1.0),
        "y": (x * (rho - z) - y, 1.0),
        "z": (x * y - beta * z, 20.0),
    }
    return _kernel("lorenz", rates, LORENZ)


@cache
def van_der_pol() -> Kernel:
    mu = symbol("mu")
    return _kernel("van_der_pol", {"x": (v, 2.0), "v": (mu * (1 - x**2) * v - x, 0.0)}, {"mu": 1.0})


@cache
def two_circles() -> Kernel:
    """Two circles, cos t and cos w t: a torus in closed form, exponents 0, 0, -2 and -2."""
    a, b, c, d, w = (symbol(n) for n in "abcdw")
    first, second = 1 - a**2 - b**2, 1 - c**2 - d**2
    return _kernel(
        "two_circles",
        {
            "a": (a * first - b, 1.0),
            "b": (b * first + a, 0.0),
            "c": (c * second - w * d, 1.0),
            "d": (d * second + w * c, 0.0),
        },
        {"w": float(np.sqrt(2.0))},
    )


HARMONICS = 6


@cache
def many_passes() -> Kernel:
    """A cycle of period 2 pi in closed form: y is h1 cos t + ... + h6 cos 6t, exponents 0, -2.

    A disturbance of y rotates with w and decays with k, however small: two exponents of -k.
    """
    a, b, y, z, k, w = (symbol(n) for n in ("a", "b", "y", "z", "k", "w"))
    names = [f"h{n}" for n in range(1, HARMONICS + 1)]
    course = sum(symbol(n) * sp.chebyshevt(j + 1, a) for j, n in enumerate(names))
    ring, off = 1 - a**2 - b**2, y - course
    rate = a * ring - b
    return _kernel(
        "many_passes",
        {
            "a": (rate, 1.0),
            "b": (b * ring + a, 0.0),
            "y": (sp.diff(course, a) * rate - k * off - w * z, 3.0),
            "z": (w * off - k * z, 0.0),
        },
        dict.fromkeys(names, 0.0) | {"k": 0.1, "w": 0.0},
    )


@cache
def belt(beside: bool = False) -> Kernel:
    """A unit mass on a unit spring on a belt; friction falls with the sliding speed.

    Sticking ends when the spring force reaches the largest friction, 1. With `beside` there is one
    more state, which fades alone.
    """
    vb = symbol("vb")
    friction = 1 / (1 + FALLING * (vb - v))
    sticks = Event("sticks", v - vb, direction=1, reset={"v": vb}, next_mode="stick")
    slips = Event("slips", x - 1, direction=1, next_mode="slip")
    modes = (
        Mode("slip", events=(sticks,)),
        Mode("stick", derivatives={"x": vb, "v": sp.Integer(0)}, events=(slips,)),
    )
    rates = {"x": (v, 0.0), "v": (-x + friction, 0.0)}
    rates |= {"w": (-2 * symbol("w"), 1.0)} if beside else {}
    return _kernel("belt", rates, {"vb": BELT_SPEED}, modes)


@cache
def bouncing_ball() -> Kernel:
    """A ball on a table with the motion (G g / w^2) sin(w t), w = 2 pi and g = 1.

    Both the surface and the reset depend on time.
    """
    shake = symbol("shake")
    w, e, g = sp.Float(TABLE_FREQUENCY), sp.Float(RESTITUTION), sp.Float(GRAVITY)
    height = shake * g / w**2 * sp.sin(w * TIME)
    speed = shake * g / w * sp.cos(w * TIME)
    hit = Event("hit", x - height, direction=-1, reset={"v": -e * v + (1 + e) * speed})
    rates = {"x": (v, 0.0), "v": (-g, 0.5)}
    return _kernel("bouncing_ball", rates, {"shake": 1.2}, (Mode("flight", events=(hit,)),))


@cache
def elastic_ball() -> Kernel:
    """A ball that falls with g = 1 from a height of 1/2, without losses at the floor.

    An impact is a separate mode of zero duration.
    """
    hits = Event("hits", x, direction=-1, reset={"x": sp.Integer(0)}, next_mode="impact")
    leaves = Event("leaves", -v, direction=1, reset={"v": -v}, next_mode="flight")
    modes = (Mode("flight", events=(hits,)), Mode("impact", events=(leaves,)))
    rates = {"x": (v, 0.5), "v": (sp.Integer(-1), 0.0)}
    return _kernel("elastic_ball", rates, modes=modes)


@cache
def dry_friction() -> Kernel:
    """A unit mass on a unit spring, driven, with viscous and Coulomb friction; it never sticks.

    J. P. Den Hartog, Trans. ASME 53 (1931) 107; its stability: S. W. Shaw, J. Sound
    Vib. 108 (1986) 305.
    """
    w, force, mu, damping = (symbol(n) for n in DRY)
    smooth = force * sp.cos(w * TIME) - x - damping * v
    modes = (
        Mode(
            "right",
            derivatives={"v": smooth - mu},
            events=(Event("turns_left", v, direction=-1, next_mode="left"),),
        ),
        Mode(
            "left",
            derivatives={"v": smooth + mu},
            events=(Event("turns_right", v, direction=1, next_mode="right"),),
        ),
    )
    return _kernel("dry_friction", {"x": (v, 0.0), "v": (smooth, 0.5)}, DRY, modes)


RELAY_PLANT = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -3.0]])
RELAY_INPUT = np.array([0.0, 0.0, 3.0])
RELAY_SEEN = np.array([1.0, 0.0, 0.0])


@cache
def relay_loop() -> Kernel:
    """An integrator with two lags, and a relay with hysteresis in another component."""
    names, u = ("x", "v", "q"), symbol("u")
    rates = [
        sum(float(RELAY_PLANT[i, j]) * symbol(names[j]) for j in range(3))
        + float(RELAY_INPUT[i]) * u
        for i in range(3)
    ]
    plant = Component(
        "lagging",
        "an integrator with two lags",
        inputs=(Input("u", "1", "command"),),
        states=tuple(
            State(n, "1", n, rates[i], start=0.05 * (i == 0)) for i, n in enumerate(names)
        ),
        outputs=(Output("x", "1", "position", x),),
    )
    relay = Component(
        "relay",
        "full command one way or the other",
        inputs=(Input("x", "1", "position", role="measurement"),),
        outputs=(Output("u", "1", "command", sp.Integer(1)),),
        modes=(
            Mode(
                "up",
                outputs={"u": sp.Integer(1)},
                events=(Event("high", x - RELAY_LEVEL, direction=1, next_mode="down"),),
            ),
            Mode(
                "down",
                outputs={"u": sp.Integer(-1)},
                events=(Event("low", x + RELAY_LEVEL, direction=-1, next_mode="up"),),
            ),
        ),
    )
    return generate(connect(plant, relay))


def maker(kernel: Kernel, values: Mapping[str, float] | None = None) -> Callable[[float], Model]:
    """The function for `lyapunov`: the model, at its start, for a tolerance."""
    return lambda tolerance: Model(kernel, values, tolerance)


def stretched(
    matrix: npt.ArrayLike, stop: float, frame: Matrix | None = None, parts: int = 1
) -> Matrix:
    """Exact finite-time exponents of x' = A x, by QR of its exponentials [nats/s].

    There is a QR after each of so many `parts` of the time, enough to keep the fast directions.
    """
    from scipy.linalg import expm

    a = np.asarray(matrix, dtype=float)
    step = expm(a * stop / parts)
    q = np.eye(len(a)) if frame is None else np.asarray(frame, dtype=float).T
    logs = np.zeros(q.shape[1])
    for _ in range(parts):
        q, r = np.linalg.qr(step @ q)
        logs += np.log(np.abs(np.diag(r)))
    return logs / stop

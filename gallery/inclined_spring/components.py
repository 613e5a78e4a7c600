"""A mass with rate-and-state friction, pulled at constant velocity over an inclined spring.

All states are zero in steady sliding: the spring's stretch along the surface less that of steady
sliding, the logarithm of the velocity over that of the pull, and the logarithm of the contacts' age
over that of steady sliding. So no logarithm of zero occurs, and the velocity remains positive.
"""

import sympy as sp

from ballscrew import Component, Output, Parameter, State, symbol

SOURCE = "made for the gallery"


def _mass(name: str, law: str, evolution: sp.Expr) -> Component:
    """The mass; `evolution` is the law's rate of w while the normal force is constant."""
    x, u, w = map(symbol, ("x", "u", "w"))
    m, k, psi, weight, v0 = map(symbol, ("m", "k", "psi", "W", "v0"))
    mu0, a, b, alpha = map(symbol, ("mu0", "a", "b", "alpha"))
    v = v0 * sp.exp(u)
    pull = mu0 * weight / (sp.cos(psi) + mu0 * sp.sin(psi)) + k * sp.cos(psi) * x
    normal = weight - pull * sp.sin(psi)
    loading = -k * sp.cos(psi) * sp.sin(psi) * (v0 - v)  # rate of the normal force
    mu = mu0 + a * u + b * w
    return Component(
        name=name,
        description=f"A mass pulled over an inclined spring, with the {law} law of friction",
        parameters=(
            Parameter("m", 1.0, "kg", "mass", SOURCE, minimum=1e-9),
            Parameter("k", 5000.0, "N/m", "stiffness of the spring", SOURCE, minimum=0.0),
            Parameter("psi", 0.0, "rad", "angle of the spring; above 0 it lifts", SOURCE),
            Parameter("W", 10.0, "N", "force that presses the mass on the surface", SOURCE),
            Parameter("v0", 5e-4, "m/s", "velocity of the pull", SOURCE, minimum=1e-12),
            Parameter("mu0", 0.6, "1", "friction coefficient of steady sliding", SOURCE),
            Parameter("a", 0.01, "1", "direct effect of the velocity", SOURCE, minimum=1e-9),
            Parameter("b", 0.015, "1", "effect of the contacts' age", SOURCE, minimum=1e-9),
            Parameter("L", 1e-5, "m", "distance over which contacts renew", SOURCE, minimum=1e-12),
            Parameter(
                "alpha",
                0.0,
                "1",
                "how far contacts lose age as the load on them grows",
                SOURCE,
                minimum=0.0,
            ),
        ),
        states=(
            State("x", "m", "stretch along the surface, beyond steady sliding", v0 - v, 0.0, 1e-6),
            State(
                "u",
                "1",
                "logarithm of the velocity over v0",
                (pull * sp.cos(psi) - normal * mu) / (m * v),
                start=0.01,
            ),
            State(
                "w",
                "1",
                "logarithm of the contacts' age over L/v0",
                evolution - alpha / b * loading / normal,
            ),
        ),
        outputs=(
            Output("v", "m/s", "velocity of the mass", v, nominal=1e-3),
            Output("F", "N", "force of the spring", pull),
            Output("N", "N", "normal force", normal),
            Output("mu", "1", "friction coefficient", mu),
        ),
    )


def ageing() -> Component:
    """The ageing law: contacts age at rest, and are renewed by sliding."""
    u, w, v0, length = map(symbol, ("u", "w", "v0", "L"))
    return _mass("ageing", "ageing", v0 / length * (sp.exp(-w) - sp.exp(u)))


def slip() -> Component:
    """The slip law: contacts change only by sliding."""
    u, w, v0, length = map(symbol, ("u", "w", "v0", "L"))
    return _mass("slip", "slip", -v0 / length * sp.exp(u) * (u + w))

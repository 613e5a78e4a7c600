"""Classical friction: sticking and sliding as modes of their own, after the thesis' Eq. 1.1.

Sliding, friction is a function of velocity that opposes it, F = s (g(|v|) + sigma2 |v|) with the
Stribeck curve g of Eq. 1.8. Sticking, it is whatever keeps the body at rest, up to the break-away
force. No deflection, no regularization: the change between the two is an event.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, ContractError, Event, ForceTerm, Mode, Output, symbol
from .law import Claims
from .lugre import PARAMETERS, stribeck

STUCK, FORWARD, BACKWARD = "stuck", "forward", "backward"
_USED = ("sigma2", "Fc", "Fs", "Vs")


def classical(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]; needs `with_sticking`."""
    force = _sliding(velocity, sp.sign(velocity))
    return ForceTerm(
        name="friction",
        force=-force,
        meaning="classical friction, opposing motion",
        parameters=tuple(p for p in PARAMETERS if p.name in _USED),
        outputs=(
            Output("friction", "N", "friction force, opposing motion", force, nominal=1.0),
            Output("stuck", "1", "one while the body sticks, else zero", sp.Integer(0)),
        ),
    )


def _sliding(velocity: sp.Expr, direction: sp.Expr) -> sp.Expr:
    return direction * stribeck(velocity) + symbol("sigma2") * velocity


CLAIMS = Claims(steady_state=_sliding(symbol("v"), sp.sign(symbol("v"))), stiffness=None)


def with_sticking(component: Component, velocity: str = "v", position: str = "x") -> Component:
    """The component with the modes stuck, forward and backward around its friction term.

    Parameters
    ----------
    component : Component
        Has a force balance of `velocity` with the term of `classical` in it.
    velocity : str
        The state that is zero where the body sticks: its speed relative to what it slides on.
    position : str
        The state that moves with `velocity`, and goes on as it does where that is zero.

    Raises
    ------
    ContractError
        If it has no such balance or term, or has modes already.
    """
    balance = next((b for b in component.balances if b.state == velocity), None)
    names = [t.name for t in balance.terms] if balance else []
    if balance is None or "friction" not in names or component.modes:
        raise ContractError(
            f"{component.name}: sticking needs a force balance of {velocity!r} with a term "
            f"'friction', and no modes; it has the terms {', '.join(names) or 'none'}"
        )
    v = symbol(velocity)
    applied = sp.Add(*[t.force for t in balance.terms if t.name != "friction"])
    held = applied.xreplace({v: sp.Integer(0)})
    stop = {velocity: sp.Integer(0)}

    def sliding(name: str, direction: int) -> Mode:
        force = _sliding(v, sp.Integer(direction))
        return Mode(
            name,
            derivatives={velocity: (applied - force) / balance.inertia},
            outputs={"friction": force},
            events=(Event("stops", v, direction=-direction, reset=stop, next_mode=STUCK),),
        )

    stuck = Mode(
        STUCK,
        derivatives={
            velocity: sp.Integer(0),
            position: component.derivative(position).xreplace({v: sp.Integer(0)}),
        },
        outputs={"friction": held, "stuck": sp.Integer(1)},
        events=(
            # a body that starts in motion, or is set in motion, does not stick
            Event("moves forward", v, direction=1, next_mode=FORWARD),
            Event("moves backward", v, direction=-1, next_mode=BACKWARD),
            Event("breaks away forward", held - symbol("Fs"), direction=1, next_mode=FORWARD),
            Event("breaks away backward", held + symbol("Fs"), direction=-1, next_mode=BACKWARD),
        ),
    )
    return replace(component, modes=(stuck, sliding(FORWARD, 1), sliding(BACKWARD, -1)))

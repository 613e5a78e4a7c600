"""Classical friction: sticking and sliding are separate modes, after Eq. 1.1 of the thesis.

Sliding, friction is a function of velocity that opposes it, F = s (g(|v|) + sigma2 |v|) with the
Stribeck curve g of Eq. 1.8. In sticking, it is the force that keeps the body at rest, up to the
break-away force. There is no deflection and no regularization: the change between the two is an
event.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, Event, ForceTerm, Mode, Output, Parameter, symbol
from ..solver.errors import ContractError
from .law import Claims, Estimation
from .lugre import PARAMETERS, stribeck

STUCK, FORWARD, BACKWARD = "stuck", "forward", "backward"
USED = ("sigma2", "Fc", "Fs", "Vs")


def classical(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]; needs `with_sticking`."""
    used = tuple(p for p in PARAMETERS if p.name in USED)
    return sticking_term("classical friction", sliding(velocity, sp.sign(velocity)), used)


def sticking_term(kind: str, force: sp.Expr, parameters: tuple[Parameter, ...]) -> ForceTerm:
    """The term of a law that sticks, whose `force` [N] is positive if it opposes motion in +x."""
    return with_outputs(
        ForceTerm("friction", -force, f"{kind}, opposing motion", parameters=parameters)
    )


def with_outputs(term: ForceTerm) -> ForceTerm:
    """A term of friction that sticks, with the outputs of its modes."""
    friction = Output("friction", "N", "friction force, opposing motion", -term.force, nominal=1.0)
    stuck = Output("stuck", "1", "one while the body sticks, else zero", sp.Integer(0))
    return replace(term, outputs=(*term.outputs, friction, stuck))


def sliding(velocity: sp.Expr, direction: sp.Expr) -> sp.Expr:
    return direction * stribeck(velocity) + symbol("sigma2") * velocity


CLAIMS = Claims(
    steady_state=sliding(symbol("v"), sp.sign(symbol("v"))),
    stiffness=None,
    estimation=Estimation("dry", lambda _: [{}], of_sliding=("Fs",)),
)


def able_to_stick(component: Component) -> Component:
    """The component, with the modes of sticking if that is what its friction law needs."""
    sticks = any(o.name == STUCK for o in component.all_outputs)
    return with_sticking(component) if sticks else component


def with_sticking(
    component: Component, velocity: str = "v", position: str = "x", breakaway: sp.Expr | None = None
) -> Component:
    """The component with the modes stuck, forward and backward around its friction term.

    It has a force balance of `velocity` with a term ``friction``, which opposes motion by the sign
    of that state. While it sticks, `velocity`, which is relative to the surface, is zero, and the
    derivative of `position` is the one at zero velocity. It sticks up to the force `breakaway` [N];
    default: the friction of each direction at zero velocity. All forces have the mode's sign.

    Raises `ContractError` if it has no such balance or term, or has modes already.
    """
    v = symbol(velocity)
    balance = next((b for b in component.balances if b.state == velocity), None)
    terms = {t.name: t for t in balance.terms} if balance else {}
    term = terms.get("friction")
    if balance is None or term is None or component.modes:
        raise ContractError(
            f"{component.name}: sticking needs a force balance of {velocity!r} with a term "
            f"'friction', and no modes; it has the terms {', '.join(terms) or 'none'}"
        )
    if not term.force.has(sp.sign(v)):
        raise ContractError(
            f"{component.name}: the term 'friction' has no sign({velocity}), which it "
            "needs to oppose sliding"
        )

    def one_way(force: sp.Expr, direction: int) -> sp.Expr:
        return force.xreplace({sp.sign(v): sp.Integer(direction), sp.Abs(v): direction * v})

    def at_rest(expression: sp.Expr) -> sp.Expr:
        return expression.xreplace({v: sp.Integer(0)})

    applied = sp.Add(*[t.force for t in balance.terms if t is not term])
    pushed, pulled = (at_rest(one_way(applied, direction)) for direction in (1, -1))
    forwards, backwards = breakaway, breakaway
    if breakaway is None:
        forwards, backwards = at_rest(one_way(-term.force, 1)), at_rest(one_way(term.force, -1))

    def mode(name: str, direction: int) -> Mode:
        force = one_way(-term.force, direction)
        stop = {velocity: sp.Integer(0)}
        return Mode(
            name,
            derivatives={velocity: (one_way(applied, direction) - force) / balance.inertia},
            outputs={"friction": force},
            events=(Event("stops", v, direction=-direction, reset=stop, next_mode=STUCK),),
            signs={velocity: direction},
        )

    stuck = Mode(
        STUCK,
        derivatives={velocity: sp.Integer(0), position: at_rest(component.derivative(position))},
        outputs={"friction": at_rest(applied), "stuck": sp.Integer(1)},
        events=(
            # a body that starts or is set in motion does not stick
            Event("moves forward", v, direction=1, next_mode=FORWARD),
            Event("moves backward", v, direction=-1, next_mode=BACKWARD),
            Event("breaks away forward", pushed - forwards, direction=1, next_mode=FORWARD),
            Event("breaks away backward", pulled + backwards, direction=-1, next_mode=BACKWARD),
        ),
        signs={velocity: 0},
    )
    return replace(component, modes=(stuck, mode(FORWARD, 1), mode(BACKWARD, -1)))

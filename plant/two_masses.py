"""A plant with two bodies: the encoder's side, and the block with its friction.

Between them is a spring, a gap, or both. The sides of a gap are stiff and damped, and only push:
their damping increases over a depth of some nanometres instead of switching. The implicit solver
needs as many steps for this as for one body. With contacts as events the same motion, equal to
6 nm, took five times as long, and a law that sticks would have three times as many modes.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import (
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    replaced,
    symbol,
)
from ..solver.errors import ContractError

ENCODER_SIDE = ("motor", "drive", "offset", "torque_ripple")
"""Forces on the encoder's side; all others act on the block."""

_FOUND = "found in measured data"
STIFFNESS = Parameter(
    "stiffness", 1e8, "N/m", "of what lies between encoder and block", _FOUND, minimum=1e-3
)
GAP = Parameter("gap", 0.0, "m", "backlash of the block, from side to side", _FOUND, minimum=0.0)
SIDES = Parameter(
    "contact_stiffness", 1e8, "N/m", "of the gap's sides", "typical of a ball nut", minimum=1e3
)
_LEAST_ROTOR = 1e-12  # kg*m^2
_DEPTH = sp.Float("1e-8")  # depth over which the damping of a side increases [m]
SPRING_DAMPING = sp.Rational(1, 10)  # share of critical
_CONTACT_DAMPING = sp.Integer(1)  # the same


def with_spring(plant: Component) -> Component:
    """The plant with a spring between encoder and block; damping one tenth of critical.

    The plant has one force balance, of `v`, and no sticking modes yet; or comes from `with_gap`,
    whose sides then have the stiffness of the spring. The block's position and velocity are states
    `xb` [m] and `vb` [m/s]; sticking refers to these. Raises `ContractError` if the encoder's side
    has no inertia.
    """
    return _joined(plant, spring=True, gap=_has(plant, GAP))


def with_gap(plant: Component) -> Component:
    """The plant with a gap between encoder and block; it starts in the middle of the gap.

    Parameters and errors are those of `with_spring`.
    """
    return _joined(plant, spring=_has(plant, STIFFNESS), gap=True)


def _has(plant: Component, parameter: Parameter) -> bool:
    return parameter.name in [p.name for p in plant.all_parameters]


def _joined(plant: Component, spring: bool, gap: bool) -> Component:
    apart = plant if "xb" in [s.name for s in plant.states] else _parted(plant)
    block = next(b.inertia for b in apart.balances if b.state == "vb")
    pull = joint_force(block, spring, gap)
    joint = {
        "v": ForceTerm("joint", -pull, "what joins the two, on the encoder's side"),
        "vb": ForceTerm("joint", pull, "what joins the two, on the block"),
    }
    there = {STIFFNESS: spring, GAP: gap, SIDES: gap and not spring}
    others = [p for p in apart.parameters if p.name not in {own.name for own in there}]
    parameters = (*others, *(p for p, wanted in there.items() if wanted))
    terms = {b.state: [t for t in b.terms if t.name != "joint"] for b in apart.balances}
    balances = [replace(b, terms=(*terms[b.state], joint[b.state])) for b in apart.balances]
    return replace(apart, parameters=parameters, balances=tuple(balances))


def joint_force(block: sp.Expr, spring: bool, gap: bool) -> sp.Expr:
    """Force of the joint on the block [N]."""
    longer = symbol("x") - symbol("xb")
    faster = symbol("v") - symbol("vb")
    stiffness = symbol(STIFFNESS.name if spring else SIDES.name)
    share = SPRING_DAMPING if spring else _CONTACT_DAMPING
    damping = 2 * share * sp.sqrt(stiffness * block)
    if not gap:
        return stiffness * longer + damping * faster

    def side(depth: sp.Expr, rate: sp.Expr) -> sp.Expr:
        push = stiffness * depth + damping * rate * depth / (sp.Abs(depth) + _DEPTH)
        return sp.Piecewise((0, depth <= 0), (0, push <= 0), (push, True))

    half = symbol(GAP.name) / 2
    return side(longer - half, faster) - side(-longer - half, -faster)


def _parted(plant: Component) -> Component:
    """The plant as two bodies without a joint."""
    if [b.state for b in plant.balances] != ["v"] or plant.modes:
        raise ContractError(
            f"{plant.name}: only a plant with one force balance, of 'v', and without modes can be "
            "divided into two bodies; do this before adding sticking"
        )
    (whole,) = plant.balances
    plant, block = _shares(plant)
    moved = {symbol("x"): symbol("xb"), symbol("v"): symbol("vb")}
    near = tuple(t for t in whole.terms if t.name in ENCODER_SIDE)
    far = tuple(replaced(t, moved) for t in whole.terms if t.name not in ENCODER_SIDE)
    where = "of the block behind the joint"
    position = State("xb", "m", f"position {where}", symbol("vb"), nominal=1e-3)
    velocity = State("vb", "m/s", f"velocity {where}", nominal=1e-3)
    shown = Output("xb", "m", f"position {where}", symbol("xb"), nominal=0.1)
    return replace(
        plant,
        description=f"{plant.description}, in two bodies",
        states=(*plant.states, position, velocity),
        outputs=(*plant.outputs, shown),
        balances=(
            ForceBalance("v", sp.expand(whole.inertia - block), near),
            ForceBalance("vb", block, far),
        ),
    )


def _shares(plant: Component) -> tuple[Component, sp.Expr]:
    """The plant, whose rotor inertia must now be positive, and the mass of the block."""
    rotor = next((p for p in plant.parameters if p.name == "Jm"), None)
    if rotor is None:
        return plant, block_of(plant)
    if rotor.default < _LEAST_ROTOR:
        raise ContractError(
            f"Jm is {rotor.default:g} kg*m^2: a spring or a gap before the block needs a "
            "rotor with inertia on the other side; give its inertia, Table 2.1 has 4.2e-7 kg*m^2"
        )
    parameters = tuple(
        replace(p, minimum=_LEAST_ROTOR) if p is rotor else p for p in plant.parameters
    )
    return replace(plant, parameters=parameters), block_of(plant)


def block_of(plant: Component) -> sp.Expr:
    """Mass on which friction acts; half of the total if the distribution is not known [kg]."""
    return symbol("m") if any(p.name == "Jm" for p in plant.parameters) else symbol("m") / 2

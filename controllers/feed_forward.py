"""Any controller with feed-forward of the set-point's velocity and acceleration, and of friction.

The voltage that the axis needs for the desired motion is added to the command,

    u_ff = Kvff v_d + Kaff a_d + Kfff S(v_d),    S(v) = v/sqrt(v^2 + Vff^2),

the inverse of the rigid axis with Coulomb friction, whose sign is smooth (M. Tomizuka, "Zero phase
error tracking algorithm for digital control", Journal of Dynamic Systems, Measurement, and Control
109, 65 (1987), for why a plant's inverse leaves no error; H. Olsson, K. J. Astrom, C. Canudas de
Wit, M. Gafvert and P. Lischinsky, "Friction models and friction compensation", European Journal of
Control 4, 176 (1998), for the friction). It is added within the law's own limit,
so that anti-windup and observers use the whole command.

A law with damping by the measured velocity would act against the desired motion. How v_d is
used depends on the law's model of the axis:

- a law without a model (`pid`, `lqi`, `nctf`, `fuzzy_pd_i`, `sliding_mode`,
  `super_twisting`) measures the velocity error ``v - v_d`` in place of ``v``;
- a law with states in addition to its integral (`pid_dob`, `pid_lugre`, `adaptive_friction`) needs
  the true velocity for its model; each term ``-K v`` of its command, where ``K`` is a parameter,
  becomes ``-K (v - v_d)``;
- `p_pi` has v_d in its velocity loop already;
- the linearizing laws (`iol`, `iol_true_acceleration`, `iol_observed`) cancel the axis' own forces,
  and an inverse of the axis would count them twice. Their demand ``-k2 a - k1 v - k0 (x - x_d)``
  gets ``k2 a_d + k1 v_d``, and nothing else: no parameter is added.

A law with two levels (`relay`) has no command to which a voltage could be added.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ..solver.component import Component, Input, Parameter, symbol
from ..solver.errors import ContractError
from .limited import limit
from .rigid_axis import nominal, rigid_axis

REFERENCES = (
    Input("v_d", "m/s", "velocity of the set-point", nominal=0.1, role="reference_derivative"),
    Input(
        "a_d", "m/s^2", "acceleration of the set-point", nominal=1.0, role="reference_derivative"
    ),
)
TUNABLE = {"Kvff": (50.0, 1000.0), "Kaff": (0.01, 1.0), "Kfff": (0.0, 0.5)}

_V, _W, _X_D, _V_D, _A_D = map(symbol, ("v", "w", "x_d", "v_d", "a_d"))
_DEMAND = ("k0", "k1", "k2")
_COMMAND = (
    symbol("Kvff") * _V_D
    + symbol("Kaff") * _A_D
    + symbol("Kfff") * _V_D / sp.sqrt(_V_D**2 + symbol("Vff") ** 2)
)


def acceleration_forward() -> float:
    """Voltage per acceleration of the nominal axis [V*s^2/m], for mass, friction and inductance."""
    plant, sigma2 = rigid_axis(), nominal("sigma2")
    return (plant.inertia + sigma2 * plant.electrical_time) / plant.force_per_volt


def feed_forward_parameters() -> tuple[Parameter, ...]:
    """Kvff, Kaff, Kfff and Vff; defaults are those of the nominal axis."""
    plant = rigid_axis()
    inverse, of_coulomb = "inverse of the nominal axis", "the nominal axis: Fc R/(kt 2 pi p)"
    coulomb = nominal("Fc") / plant.force_per_volt
    meaning = "desired speed at which the feed-forward of friction is 0.71 of Kfff"
    source = "the Stribeck velocity Vs: below this speed the bristles determine friction"
    return (
        Parameter("Kvff", 1 / plant.speed_per_volt, "V*s/m", "velocity feed-forward", inverse),
        Parameter("Kaff", acceleration_forward(), "V*s^2/m", "acceleration feed-forward", inverse),
        Parameter("Kfff", coulomb, "V", "feed-forward of Coulomb friction", of_coulomb),
        Parameter("Vff", nominal("Vs"), "m/s", meaning, source, minimum=1e-9),
    )


def with_feed_forward(law: Component) -> Component:
    """The controller with feed-forward, called ``<name>_feed_forward``.

    It has the inputs v_d and a_d, and the parameters of `feed_forward_parameters`, except for a
    linearizing law; the law's states keep their names. Raises `ContractError` for a law without
    set-point x_d, with several outputs or with modes, or one that has parameters of these names.
    """
    if "x_d" not in [i.name for i in law.inputs] or len(law.outputs) != 1 or law.modes:
        raise ContractError(
            f"{law.name} cannot have feed-forward; expected a controller with a set-point x_d, one "
            "command and no modes"
        )
    known = {i.name for i in law.inputs}
    linearizing = is_linearizing(law)
    law = replace(
        law,
        name=f"{law.name}_feed_forward",
        description=f"{law.description}; with feed-forward",
        parameters=(*law.parameters, *(() if linearizing else feed_forward_parameters())),
        inputs=(*law.inputs, *(i for i in REFERENCES if i.name not in known)),
    )
    if not linearizing:
        return _with_added_command(law, acts_on_error="v_d" in known)
    k0, k1, k2 = map(symbol, _DEMAND)
    return law.substituted({_X_D: _X_D + (k1 * _V_D + k2 * _A_D) / k0})


def is_linearizing(law: Component) -> bool:
    """Whether it has the linear demand of `linearization`, with the gains k0, k1 and k2."""
    return {*_DEMAND} <= {p.name for p in law.parameters}


def _with_added_command(law: Component, acts_on_error: bool) -> Component:
    """The law, which has all symbols of `_COMMAND`, with it added to its command.

    `acts_on_error`: whether its velocity feedback already uses v - v_d.
    """
    (output,) = law.outputs
    held = {symbol(d.name): d for d in law.discrete}.get(sp.sympify(output.value))
    command, limited = _within_limit(sp.sympify(held.update if held else output.value))
    added = _COMMAND
    errors: dict[sp.Symbol, sp.Expr] = {}
    if not acts_on_error and {s.name for s in law.all_states} <= {_W.name}:
        errors = {_V: _V - _V_D}
    elif not acts_on_error:
        gains = {-symbol(p.name) * _V: symbol(p.name) for p in law.parameters}
        added += _V_D * sum(gains.get(term, 0) for term in sp.Add.make_args(command))
    if limited and sp.diff(command, _W) == 1:  # in the command and in its anti-windup
        return law.substituted({**errors, _W: _W + added})
    whole = limit(command + added) if limited else command + added
    if held:
        discrete = tuple(replace(d, update=whole) if d is held else d for d in law.discrete)
        return replace(law, discrete=discrete).substituted(errors)
    return replace(law, outputs=(replace(output, value=whole),)).substituted(errors)


def _within_limit(value: sp.Expr) -> tuple[sp.Expr, bool]:
    """A command before its limit, and whether it has one."""
    if isinstance(value, sp.Piecewise):
        inner = value.args[-1].args[0]
        if value == limit(inner):
            return inner, True
    return value, False

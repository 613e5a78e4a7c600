"""Input-output linearization with an encoder only: all states are observed.

The observer has the plant's own equations with the controller's estimates, driven by the
command after the limit; the measured position corrects the observed one (D. G. Luenberger, "An
introduction to observers", IEEE Transactions on Automatic Control 16, 596 (1971)):

    dx_hat/dt = v_hat + l (x - x_hat),

and velocity, bristles and current follow their own equations. Friction and back-EMF damp the
velocity of the axis, so their errors decay by themselves: in sliding with the plant's own two fast
poles, -3184 and -19 440 1/s, and that of the position with ``-l``. A correction of the velocity
would be possible and is left out on purpose: it adds the position error to the terms that the law
cancels, which are five hundred times as large as their difference; if friction differs by a tenth,
that loop does not come to rest.
"""

from __future__ import annotations

from ..plant.ball_screw import ball_screw
from ..solver.component import Component, Parameter, State, symbol
from .limited import U_MAX, limit, voltage_law
from .linearization import TUNABLE as IOL_TUNABLE
from .linearization import estimates_of, input_output_linearization

POLE = 100.0
"""Decay of the observed position's error [1/s]: fourteen times as fast as the loop's fastest
pole."""

TUNABLE = {**IOL_TUNABLE, "l": (10.0, 1e4)}


def iol_observed() -> Component:
    """`u` [V] from x and x_d."""
    known, plant = input_output_linearization(), ball_screw()
    hats, *_ = estimates_of(next(t for t in plant.terms if t.name == "friction"))
    observed = {symbol(s.name): symbol(s.name + "_hat") for s in plant.all_states}
    command = known.output("u").value.xreplace(observed)
    believed = {**hats, **observed, symbol("u"): limit(command)}
    rates = {s.name: plant.derivative(s.name).xreplace(believed) for s in plant.all_states}
    rates["x"] += symbol("l") * (symbol("x") - symbol("x_hat"))
    meaning = "correction of the observed position by the measured one"
    correction = Parameter(
        "l", POLE, "1/s", meaning, f"observer pole at {-POLE:g} 1/s", minimum=0.0
    )
    return voltage_law(
        "iol_observed",
        "Input-output linearization with an observer, on the position alone",
        (*known.parameters, correction, U_MAX),
        command,
        tuple(
            State(
                f"{s.name}_hat", s.unit, f"observed {s.meaning}", rates[s.name], nominal=s.nominal
            )
            for s in plant.all_states
        ),
    )

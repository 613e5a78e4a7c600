"""Load of a machine on its axis: a force over time, and a payload that is picked up."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from ...solver.component import TIME, Component, ForceTerm, Output, Parameter, symbol

_PROFILE = (
    Parameter("load_force", 0.0, "N", "force that is reached", "none unless given"),
    Parameter("load_time", 0.1, "s", "when it begins to rise", "example value", minimum=0.0),
    Parameter("load_rise", 1e-3, "s", "how long it rises", "example value: nearly a step", 1e-9),
    Parameter("load_amplitude", 0.0, "N", "amplitude of a sine beside", "none unless given", 0.0),
    Parameter("load_frequency", 10.0, "1/s", "its frequency", "example value", minimum=0.0),
    Parameter("load_phase", 0.0, "rad", "its phase at t = 0", "example value"),
)
_PAYLOAD = (
    Parameter("payload", 0.0, "kg", "mass that is picked up", "none unless given", minimum=0.0),
    Parameter("payload_time", 0.1, "s", "when it is picked up", "example value", minimum=0.0),
)


def with_load(plant: Component, balance: str = "v") -> Component:
    """The plant with a force over time, and with more mass from a given time.

    The force is a ramp that starts at `load_time`, lasts `load_rise` and ends at the constant
    `load_force`, plus a sine. It is positive along the position and is the output ``load``. The
    payload already has the speed of the plant: speed does not jump, and the momentum grows by that
    of the payload.

    Raises `ContractError` if there is no force balance of this state, or modes have their own
    equations for it; for a plant that sticks (`plant.classical`), add the load before the modes.
    """
    force, begin, rise = symbol("load_force"), symbol("load_time"), symbol("load_rise")
    share = sp.Piecewise(
        (0, begin > TIME), (1, begin + rise <= TIME), ((TIME - begin) / rise, True)
    )
    turn = 2 * sp.pi * symbol("load_frequency") * TIME + symbol("load_phase")
    load = force * share + symbol("load_amplitude") * sp.sin(turn)
    meaning = "force of the machine on the axis"
    shown = Output("load", "N", meaning, load)
    term = ForceTerm("load", load, meaning, parameters=_PROFILE, outputs=(shown,))
    loaded = plant.with_force(term, balance)
    more = sp.Piecewise((0, symbol("payload_time") > TIME), (symbol("payload"), True))
    heavier = [
        replace(b, inertia=b.inertia + more) if b.state == balance else b for b in loaded.balances
    ]
    parameters = (*loaded.parameters, *_PAYLOAD)
    return replace(loaded, parameters=parameters, balances=tuple(heavier))

"""A forced oscillator next to a rigid stop, x'' + 2 zeta x' + x = F cos(omega t), x <= gap.

At the stop it rebounds with a share of its speed. Impacts in ever shorter intervals end, as with a
bouncing ball, if the mass would leave slower than `v_min`. It then stays at the stop until the
force pulls it away.
"""

import sympy as sp

from ballscrew import TIME, Component, Event, Mode, Output, Parameter, State, symbol

SOURCE = "made for the gallery"


def oscillator() -> Component:
    """The oscillator, in units of its natural frequency and of the gap."""
    x, v, zeta, force, omega, gap, r, v_min, ramp, ramp_end = (
        symbol(n)
        for n in ("x", "v", "zeta", "force", "omega", "gap", "r", "v_min", "ramp", "ramp_end")
    )
    amplitude = force + ramp * sp.Min(TIME, ramp_end)
    pull = amplitude * sp.cos(omega * TIME) - x
    hits = Event("hits", x - gap, direction=1, reset={"x": gap, "v": -r * v}, next_mode="impact")
    leaves = Event("leaves", v + v_min, direction=-1, next_mode="free")
    stays = Event("stays", v + v_min, direction=1, reset={"v": 0}, next_mode="pressed")
    pulled_away = Event("pulled away", pull, direction=-1, next_mode="free")
    return Component(
        name="impact_oscillator",
        description="A forced oscillator that strikes a rigid stop",
        parameters=(
            Parameter("zeta", 0.1, "1", "damping ratio", SOURCE, minimum=0.0),
            Parameter("force", 10.0, "1/s^2", "amplitude of the force", SOURCE, minimum=0.0),
            Parameter("ramp", 0.0, "1/s^3", "by which the amplitude grows, slowly", SOURCE),
            Parameter("ramp_end", 0.0, "s", "until when it grows", SOURCE, minimum=0.0),
            Parameter("omega", 2.5, "rad/s", "frequency of the force", SOURCE, minimum=0.0),
            Parameter("gap", 1.0, "1", "distance of the stop", SOURCE),
            Parameter(
                "r",
                0.5,
                "1",
                "share of the speed that an impact leaves",
                SOURCE,
                minimum=0.0,
                maximum=1.0,
            ),
            Parameter(
                "v_min",
                1e-6,
                "1/s",
                "slower than this no impact throws it back",
                SOURCE,
                minimum=0.0,
            ),
        ),
        states=(
            State("x", "1", "displacement, towards the stop", v),
            State("v", "1/s", "velocity", pull - 2 * zeta * v),
        ),
        outputs=(
            Output("x", "1", "displacement, towards the stop", x),
            Output("v", "1/s", "velocity", v),
        ),
        modes=(
            Mode("free", events=(hits,)),
            Mode("impact", events=(leaves, stays)),
            Mode("pressed", derivatives={"x": 0, "v": 0}, events=(pulled_away,)),
        ),
    )

"""A ball that falls on a rigid floor, x'' = -g, and leaves it with a share of its speed.

Its end rule is that of the Reference-FMUs: if a bounce would leave the floor slower than `v_min`,
the ball rests.
"""

from ballscrew import Component, Event, Mode, Output, Parameter, State, symbol

SOURCE = "Reference-FMUs"


def ball() -> Component:
    """The ball; its height x is called h in the Reference-FMUs."""
    x, v, g, e, v_min = (symbol(n) for n in ("x", "v", "g", "e", "v_min"))
    # An impact has zero duration and is a separate mode, because the next mode depends on the speed
    # after it. The height is set to zero, because an event is located slightly after its crossing.
    hits = Event("hits", x, direction=-1, reset={"x": 0, "v": -e * v}, next_mode="impact")
    ends = Event("ends", v - v_min, direction=-1, reset={"v": 0}, next_mode="rest")
    leaves = Event("leaves", v - v_min, direction=1, next_mode="flight")
    return Component(
        name="bouncing_ball",
        description="A ball that bounces on a rigid floor until it rests",
        parameters=(
            Parameter("g", 9.81, "m/s^2", "gravitational acceleration", SOURCE, minimum=0.0),
            Parameter(
                "e",
                0.7,
                "1",
                "share of the speed that an impact leaves",
                SOURCE,
                minimum=0.0,
                maximum=1.0,
            ),
            Parameter(
                "v_min", 0.1, "m/s", "a bounce slower than this is the last", SOURCE, minimum=0.0
            ),
        ),
        states=(
            State("x", "m", "height above the floor", v, start=1.0, nominal=0.01),
            State("v", "m/s", "velocity, upwards", -g, nominal=0.1),
        ),
        outputs=(
            Output("x", "m", "height above the floor", x),
            Output("v", "m/s", "velocity, upwards", v),
        ),
        modes=(
            Mode("flight", events=(hits,)),
            Mode("impact", events=(ends, leaves)),
            Mode("rest", derivatives={"x": 0, "v": 0}),
        ),
    )

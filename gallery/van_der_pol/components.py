"""Van der Pol's oscillator, x'' - mu (1 - x^2) x' + x = 0."""

from ballscrew import Component, Output, Parameter, State, symbol


def van_der_pol() -> Component:
    """The oscillator, with the initial state of the Reference-FMUs."""
    x, v, mu = symbol("x"), symbol("v"), symbol("mu")
    return Component(
        name="van_der_pol",
        description="Van der Pol's oscillator",
        parameters=(
            Parameter("mu", 1.0, "1", "strength of the damping", "Reference-FMUs", minimum=0.0),
        ),
        states=(
            State("x", "1", "first state", v, start=2.0),
            State("v", "1/s", "second state", mu * (1 - x**2) * v - x),
        ),
        outputs=(
            Output("x", "1", "first state", x),
            Output("v", "1/s", "second state", v),
        ),
    )

"""An inverted pendulum on a cart, without and with friction, and the law that balances it.

The pendulum's equation across the rod contains no force of the cart: with the speed of the bob
across the rod, q = l th' + v cos(th), it is q' = g sin(th) - v th' sin(th). So friction is only in
the balance of the cart, for any law.
"""

import sympy as sp

from ballscrew import (
    Component,
    ForceBalance,
    ForceTerm,
    Input,
    Output,
    Parameter,
    State,
    symbol,
    with_friction,
)

SOURCE = "made for the gallery"


def cart() -> Component:
    """Cart and pendulum without friction; the pendulum is upright at th = 0."""
    x, v, th, q, big, m, length, g = (symbol(n) for n in ("x", "v", "th", "q", "M", "m", "l", "g"))
    turning = (q - v * sp.cos(th)) / length
    rod = m * sp.sin(th) * (length * turning**2 - g * sp.cos(th))
    return Component(
        name="cart_pendulum",
        description="An inverted pendulum on a cart",
        parameters=(
            Parameter("M", 0.5, "kg", "mass of the cart", SOURCE, minimum=1e-6),
            Parameter("m", 0.2, "kg", "mass of the bob", SOURCE, minimum=0.0),
            Parameter("l", 0.5, "m", "length of the rod", SOURCE, minimum=1e-6),
            Parameter("g", 9.81, "m/s^2", "gravitational acceleration", "rounded standard value"),
        ),
        inputs=(Input("u", "N", "force on the cart", nominal=1.0, law=("x", "v", "th", "w")),),
        states=(
            State("x", "m", "position of the cart", v, nominal=1e-2),
            State("v", "m/s", "velocity of the cart", nominal=1e-2),
            State("th", "rad", "angle of the rod", turning, start=0.05, nominal=1e-2),
            State(
                "q",
                "m/s",
                "speed of the bob across the rod",
                g * sp.sin(th) - v * turning * sp.sin(th),
                nominal=1e-2,
            ),
        ),
        outputs=(
            Output("x", "m", "position of the cart", x, nominal=1e-2),
            Output("v", "m/s", "velocity of the cart", v, nominal=1e-2),
            Output("th", "rad", "angle of the rod", th, nominal=1e-2),
            Output("w", "rad/s", "rate of the angle", turning, nominal=1e-2),
        ),
        balances=(
            ForceBalance(
                "v",
                big + m * sp.sin(th) ** 2,
                (
                    ForceTerm("drive", symbol("u"), "drive"),
                    ForceTerm("rod", rod, "pull of the rod"),
                ),
            ),
        ),
    )


def dry_cart() -> Component:
    """The cart with Coulomb friction, which sticks and slides."""
    return with_friction(cart(), "classical", {"Fc": 0.1, "Fs": 0.1, "sigma2": 0.0})


def lugre_cart() -> Component:
    """The cart with LuGre friction, whose bristles bend."""
    values = {"Fc": 0.1, "Fs": 0.1, "sigma0": 1e4, "sigma1": 50.0, "sigma2": 0.0}
    return with_friction(cart(), "lugre", values)


def balance() -> Component:
    """State feedback, from a linear-quadratic design."""
    gains = {
        "kx": (-10.0, "N/m", "x", "m", "position of the cart"),
        "kv": (-9.73597, "N*s/m", "v", "m/s", "velocity of the cart"),
        "kth": (-48.4561, "N/rad", "th", "rad", "angle of the rod"),
        "kw": (-10.71846, "N*s/rad", "w", "rad/s", "rate of the angle"),
    }
    design = "linear-quadratic, weights 10, 1, 10, 1 of x, v, th, w, and 0.1 of u"
    error = {"x": symbol("x") - symbol("x_d")}
    return Component(
        name="balance",
        description="State feedback that balances the pendulum",
        parameters=tuple(
            Parameter(name, value, unit, f"gain on the {meaning}", design)
            for name, (value, unit, _, _, meaning) in gains.items()
        ),
        inputs=(
            *(
                Input(signal, unit, meaning, nominal=1e-2, role="measurement")
                for _, _, signal, unit, meaning in gains.values()
            ),
            Input("x_d", "m", "desired position", nominal=1e-2, role="reference"),
        ),
        outputs=(
            Output(
                "u",
                "N",
                "force on the cart",
                -sp.Add(
                    *(symbol(k) * error.get(s, symbol(s)) for k, (_, _, s, _, _) in gains.items())
                ),
                nominal=1.0,
            ),
        ),
    )

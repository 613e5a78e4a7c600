"""A DC motor with dry friction, and three laws of position control: P, PD and PID."""

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

THESIS = "the motor of the thesis' axis, Tables 2.1 and 3.1"
FRICTION = {"Fc": 1e-3, "Fs": 1.5e-3, "Vs": 1.0, "sigma2": 2e-5}
BRISTLES = {"sigma0": 1.0, "sigma1": 2e-5}


def _motor() -> Component:
    x, v, i, u = map(symbol, ("x", "v", "i", "u"))
    kt, ke, resistance, inductance = map(symbol, ("kt", "ke", "R", "L"))
    return Component(
        name="motor",
        description="A DC motor with friction, moved by a voltage",
        parameters=(
            Parameter("kt", 37.4e-3, "N*m/A", "torque constant", THESIS, minimum=1e-9),
            Parameter("ke", 0.0374482, "V*s/rad", "back-EMF constant", THESIS, minimum=0.0),
            Parameter("R", 21.4, "ohm", "resistance of the armature", THESIS, minimum=1e-9),
            Parameter("L", 0.953e-3, "H", "inductance of the armature", THESIS, minimum=1e-12),
            Parameter("J", 4.2e-7, "kg*m^2", "inertia", THESIS, minimum=1e-15),
        ),
        inputs=(Input("u", "V", "voltage of the armature", nominal=10.0, law=("x", "v")),),
        states=(
            State("x", "rad", "angle", v, nominal=0.1),
            State("v", "rad/s", "angular velocity", nominal=1.0),
            State("i", "A", "current", (u - resistance * i - ke * v) / inductance, nominal=0.1),
        ),
        outputs=(
            Output("x", "rad", "angle", x, nominal=1.0),
            Output("v", "rad/s", "angular velocity", v, nominal=10.0),
            Output("i", "A", "current", i, nominal=0.1),
        ),
        balances=(
            ForceBalance("v", symbol("J"), (ForceTerm("drive", kt * i, "torque of the current"),)),
        ),
    )


def motor() -> Component:
    """The motor with classical friction: it sticks and slides as modes."""
    return with_friction(_motor(), "classical", FRICTION)


def motor_lugre() -> Component:
    """The motor with LuGre friction: it sticks by bending bristles."""
    return with_friction(_motor(), "lugre", FRICTION | BRISTLES)


def _law(
    name: str, description: str, derivative: bool = False, integral: bool = False
) -> Component:
    x, v, x_d, w = map(symbol, ("x", "v", "x_d", "w"))
    error, example = x_d - x, "example value"
    command = symbol("Kp") * error
    gains = [Parameter("Kp", 10.0, "V/rad", "proportional gain", example, minimum=0.0)]
    if derivative:
        command -= symbol("Kd") * v
        gains.append(Parameter("Kd", 0.05, "V*s/rad", "gain on the speed", example, minimum=0.0))
    if integral:
        command += symbol("Ki") * w
        gains.append(Parameter("Ki", 1000.0, "V/(rad*s)", "integral gain", example, minimum=0.0))
    return Component(
        name=name,
        description=description,
        parameters=tuple(gains),
        inputs=(
            Input("x", "rad", "measured angle", nominal=1.0, role="measurement"),
            Input("v", "rad/s", "measured speed", nominal=10.0, role="measurement"),
            Input("x_d", "rad", "desired angle", nominal=1.0, role="reference"),
        ),
        states=(State("w", "rad*s", "integral of the error", error, nominal=1e-3),)
        if integral
        else (),
        outputs=(Output("u", "V", "voltage of the armature", command, nominal=10.0),),
    )


def p_law() -> Component:
    return _law("p_law", "P controller of the angle")


def pd_law() -> Component:
    return _law("pd_law", "PD controller of the angle", derivative=True)


def pid_law() -> Component:
    return _law("pid_law", "PID controller of the angle", derivative=True, integral=True)

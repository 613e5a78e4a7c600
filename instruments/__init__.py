"""Instruments, each a separate component and FMU.

Those of the rig (Section 2.2 and Table 2.1) have their noise as an input, so that a seed outside
determines it; if the thesis gives no value, the parameter's source says what was assumed. The
instruments in `INSTRUMENTS` can be connected between any plant and controller: their input has the
name of the plant's signal, their output that name with `solver.set_point.MEASURED` added.
"""

UNLIMITED = 1e6
NOMINAL_VOLTAGE = 36.0  # of the axis' amplifier, Table 2.1 [V]

INSTRUMENTS = {
    "position_encoder": "ballscrew.instruments.encoder:position_encoder",
    "velocity_estimate": "ballscrew.instruments.velocity_estimate:velocity_estimate",
    "current_sensor": "ballscrew.instruments.current_sensor:current_sensor",
}
"""The instruments that are exported by name. To add one, add a file and a line here."""


def without_instruments(part: str) -> tuple[str, tuple[str, ...]]:
    """The controller and the instruments of ``controller+instrument+...``, in their order."""
    names = part.split("+")
    first = len(names)
    while first > 1 and names[first - 1] in INSTRUMENTS:
        first -= 1
    return "+".join(names[:first]), (*names[first:],)


SAMPLED = "sampled"
"""Suffix of a controller's name: it reads at sample instants and holds its commands."""


def without_sampling(controller: str) -> tuple[str, bool]:
    """The controller of ``controller+sampled``, and whether it is one."""
    name = controller.removesuffix(f"+{SAMPLED}")
    return name, name != controller


UNITS = {
    "rotary": {"m": "rad", "N": "N*m", "kg": "kg*m^2"},
    "current": {"V": "A"},
    "force": {"V": "N"},
    "torque": {"V": "N*m"},
}
"""Suffix of the name of a drive or a controller: other names for the units of its equations."""


def without_units(part: str) -> tuple[str, str]:
    """The part of ``part+rotary+torque``, and its suffixes from `UNITS`, with their signs."""
    names = part.split("+")
    first = len(names)
    while first > 1 and names[first - 1] in UNITS:
        first -= 1
    name = "+".join(names[:first])
    return name, part[len(name) :]


FEED_FORWARD = "feed_forward"
"""Suffix of a controller's name: it uses the derivatives of the set-point."""


def without_feed_forward(controller: str) -> tuple[str, bool]:
    """The controller of ``controller+feed_forward``, and whether it is one."""
    name = controller.removesuffix(f"+{FEED_FORWARD}")
    return name, name != controller


def bare(part: str) -> str:
    """The part alone of ``part+feed_forward+sampled+instrument+...+force``."""
    plain = without_instruments(without_units(part)[0])[0]
    return without_feed_forward(without_sampling(plain)[0])[0]

"""The compiled rig: the plant with its limits, and the program of instruments and controller.

The thesis' axis includes the inertia of its rotor, as in the real rig: reflected through the screw
it is sixteen times the mass of the block. The drive is rigid, as in the thesis; friction acts only
between block and table. In a drive of another kind, the total mass is behind the load cell and the
constant force is before it.

At each sample instant the program's parts run in the order of the signals, each with the new values
of the parts before it. Then the plant is solved to the next instant with the resulting command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, TypeVar

import sympy as sp

from ...plant import LAWS
from ...plant.ball_screw import ball_screw
from ...plant.direct_drive import direct_drive, with_command_limit
from ...plant.instruments import NOMINAL_VOLTAGE
from ...plant.instruments.acquisition import acquisition, load_cell, low_pass
from ...plant.instruments.amplifier import with_amplifier
from ...plant.instruments.capacitance_sensor import capacitance_sensor
from ...plant.instruments.encoder import encoder
from ...plant.rotary_drive import turned
from ...solver.component import Component, ForceTerm, Output, symbol
from ...solver.errors import UnknownName
from ...solver.interconnect import interconnect
from ...solver.kernel import Kernel
from ...solver.stored import stored_kernel
from .regulators import CUTOFF, ROTOR_INERTIA, force_pid, velocity_pid
from .trials import FORCE, VELOCITY, VOLTAGE

T = TypeVar("T")
PLANT, COMMAND = "plant", "u"
DEVICES = (
    *("encoder", "load_cell", "acquisition", "position_filter", "force_filter"),
    *("capacitance_sensor", "velocity_pid", "force_pid"),
)
"""Parts of the program; a parameter is ``part.name``, and ``part_name`` in the program."""
REFERENCE = {VELOCITY: "v_ref", FORCE: "force_ref", VOLTAGE: "u_ref"}
"""Name of the reference of each kind of trial."""
_DEFAULTS: dict[str, dict[str, Any]] = {  # of the axis of the thesis on the rig
    "Jm": {
        "default": ROTOR_INERTIA,
        "source": "Table 2.1; in ballscrew run, swap, lyapunov, map and diagnose it is 0 unless a "
        "parameter file or --set gives another value",
    },
    "voltage_limit": {
        "default": NOMINAL_VOLTAGE,
        "source": "Table 2.1: nominal voltage of the motor",
    },
    "current_limit": {"default": 5.0, "source": "Maxon ADS 50/5: 5 A continuous"},
}


def of_part(part: str, table: Mapping[str, T]) -> dict[str, T]:
    """The entries ``part.name`` of a table, by their names within the part."""
    head = f"{part}."
    return {n.removeprefix(head): v for n, v in table.items() if n.startswith(head)}


def rig_plant(friction: Callable[[sp.Expr], ForceTerm], name: str, kind: str) -> Component:
    """The rig's moving part, from the command `u` [V] to the inputs of the instruments.

    Outputs are those of the plant of this kind, and `force` [N] of the drive on the block, and
    `voltage` [V], the limited command. Friction is a law of `plant/`.
    """
    axis = (ball_screw if kind == "ball_screw" else direct_drive)(friction, name)
    inertia = symbol("m")
    meaning = "force of the drive on the block: friction + m dv/dt"
    force = axis.output("friction").value + inertia * axis.derivative("v")
    in_mode = (m.outputs["friction"] + inertia * m.derivatives["v"] for m in axis.modes)
    modes = (
        replace(m, outputs={**m.outputs, "force": own})
        for m, own in zip(axis.modes, in_mode, strict=True)
    )
    plant = replace(
        axis,
        # A converter holds its commands, so no feedback law acts within a step.
        inputs=tuple(replace(i, law=()) for i in axis.inputs),
        outputs=(
            *axis.outputs,
            Output("force", "N", meaning, force),
            Output("voltage", "V", "command within its limit", symbol("u"), nominal=10.0),
        ),
        modes=tuple(modes),
    )
    if kind != "ball_screw":
        limited = with_command_limit(plant)
        return turned(limited) if kind == "rotary_drive" else limited
    limited = with_amplifier(plant)
    parameters = (replace(p, **_DEFAULTS.get(p.name, {})) for p in limited.parameters)
    return replace(limited, parameters=tuple(parameters))


def program(control: str, plates: bool, name: str) -> Component:
    """Instruments and controller of a kind of trial as one component that acts at sample instants.

    Inputs are the plant's outputs as ``plant_name``, noise and reference. Outputs are the columns
    of the record and, if there is a controller, the command `u`.
    """
    parts = {
        "encoder": encoder(),
        "load_cell": load_cell(),
        "acquisition": acquisition(),
        **{
            f"{which}_filter": low_pass(
                f"{which}_filter", unit, f"{which} by the {by}", CUTOFF, "not printed: 20 Hz"
            )
            for which, unit, by in (("position", "m", "encoder"), ("force", "N", "load cell"))
        },
    }
    connections = {
        "encoder.x": "plant_x",
        "load_cell.force": "plant_force",
        "load_cell.noise": "force_noise",
        "acquisition.x_counted": "encoder.x_counted",
        "acquisition.force_read": "load_cell.force_read",
        "position_filter.signal": "acquisition.x",
        "force_filter.signal": "acquisition.force",
    }
    outputs = {
        "x": "acquisition.x",
        "force": "acquisition.force",
        "x_filtered": "position_filter.filtered",
        "force_filtered": "force_filter.filtered",
    }
    if control == FORCE and plates:
        parts["capacitance_sensor"] = capacitance_sensor()
        connections["capacitance_sensor.x"] = "plant_x"
        connections["capacitance_sensor.noise"] = "capacitance_noise"
        outputs["x_fine"] = "capacitance_sensor.x_fine"
    if control == FORCE:
        parts["force_pid"] = force_pid()
        connections["force_pid.force"] = "force_filter.filtered"
        connections["force_pid.force_ref"] = REFERENCE[FORCE]
        outputs[COMMAND] = "force_pid.u"
    if control == VELOCITY:
        parts["velocity_pid"] = velocity_pid()
        connections["velocity_pid.x"] = "position_filter.filtered"
        connections["velocity_pid.v_ref"] = REFERENCE[VELOCITY]
        outputs[COMMAND] = "velocity_pid.u"
    outside = dict.fromkeys(source for source in connections.values() if "." not in source)
    about = "The rig's instruments and controller as one program"
    return interconnect(parts, connections, list(outside), outputs, name, about)


@cache
def plant_kernel(law: str, kind: str = "ball_screw") -> Kernel:
    """The compiled plant of this kind with a friction law; `u` is in volts. Raises UnknownName."""
    if law not in LAWS:
        raise UnknownName(f"no friction law {law!r}; there are {', '.join(LAWS)}")
    name = f"rig_plant_{law}" if kind == "ball_screw" else f"rig_{kind}_{law}"

    def make() -> Component:
        from ...plant import law as laws

        return rig_plant(laws.law(law), name, kind)

    return stored_kernel(name, make, __name__, LAWS[law].partition(":")[0])


@cache
def program_kernel(control: str, plates: bool = True) -> Kernel:
    """The compiled instruments and controller for one kind of trial."""
    suffix = "" if plates or control != FORCE else "_no_plates"
    name = f"rig_{control}_program{suffix}"
    return stored_kernel(name, lambda: program(control, plates, name), __name__)

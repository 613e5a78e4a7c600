"""Connections of the rig's parts for the compiled program.

The parts are in the order of the signals. At each sample instant every part uses the new values of
the parts before it. Then the plant, which is not one of these parts, is solved to the next instant
with the resulting command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...plant.instruments.acquisition import acquisition, load_cell, low_pass
from ...plant.instruments.capacitance_sensor import capacitance_sensor
from ...plant.instruments.encoder import encoder
from ...solver.component import Component
from ...solver.interconnect import interconnect
from . import regulators
from .rig_trials import FORCE, VELOCITY, VOLTAGE

PLANT = "plant"
COMMAND = "u"


@dataclass(frozen=True)
class ProgramPart:
    """One component of the rig's program.

    Attributes
    ----------
    name : str
        Also the prefix of its parameters, as in ``encoder.counts``.
    make : function without arguments
        Returns the component.
    feeds : dict of str to str
        Source of each input: ``part.output``, ``plant.output``, or a plain name for an external
        signal: noise, reference.
    """

    name: str
    make: Callable[[], Component]
    feeds: dict[str, str]


@dataclass(frozen=True)
class Wiring:
    """All parts of a trial's program, and the sources of its signals.

    Attributes
    ----------
    parts : tuple of ProgramPart
        In the order of the signals.
    command : str
        Source of the plant's input `u`: ``part.output``, or a plain name for an external signal.
    taps : dict of str to str
        Columns of the record and their sources.
    """

    parts: tuple[ProgramPart, ...]
    command: str
    taps: dict[str, str]


def _position_filter() -> Component:
    return low_pass(
        "position_filter",
        "m",
        "position by the encoder",
        regulators.POSITION_CUTOFF,
        "not printed: 20 Hz",
    )


def _force_filter() -> Component:
    return low_pass(
        "force_filter",
        "N",
        "force by the load cell",
        regulators.FORCE_CUTOFF,
        "not printed: 20 Hz",
    )


_MEASURING = (
    ProgramPart("encoder", encoder, {"x": "plant.x"}),
    ProgramPart("load_cell", load_cell, {"force": "plant.force", "noise": "force_noise"}),
    ProgramPart(
        "acquisition",
        acquisition,
        {"x_counted": "encoder.x_counted", "force_read": "load_cell.force_read"},
    ),
    ProgramPart("position_filter", _position_filter, {"signal": "acquisition.x"}),
    ProgramPart("force_filter", _force_filter, {"signal": "acquisition.force"}),
)
_FINE = ProgramPart(
    "capacitance_sensor",
    capacitance_sensor,
    {"x": "plant.x", "noise": "capacitance_noise"},
)
_TAPS = {
    "x": "acquisition.x",
    "force": "acquisition.force",
    "x_filtered": "position_filter.filtered",
    "force_filtered": "force_filter.filtered",
}

REFERENCE = {VELOCITY: "v_ref", FORCE: "force_ref", VOLTAGE: "u_ref"}
"""Name of the reference of each kind of trial."""

WIRINGS = {
    VELOCITY: Wiring(
        (
            *_MEASURING,
            ProgramPart(
                "velocity_pid",
                regulators.velocity_pid,
                {"x": "position_filter.filtered", "v_ref": "v_ref"},
            ),
        ),
        "velocity_pid.u",
        _TAPS,
    ),
    FORCE: Wiring(
        (
            *_MEASURING,
            _FINE,
            ProgramPart(
                "force_pid",
                regulators.force_pid,
                {"force": "force_filter.filtered", "force_ref": "force_ref"},
            ),
        ),
        "force_pid.u",
        _TAPS | {"x_fine": "capacitance_sensor.x_fine"},
    ),
    VOLTAGE: Wiring(_MEASURING, "u_ref", _TAPS),
}
_WITHOUT_PLATES = WIRINGS | {
    FORCE: Wiring(
        tuple(part for part in WIRINGS[FORCE].parts if part is not _FINE),
        WIRINGS[FORCE].command,
        _TAPS,
    )
}


def wirings(plates: bool = True) -> dict[str, Wiring]:
    """The wiring of each kind of trial, with or without the capacitance sensor."""
    return WIRINGS if plates else _WITHOUT_PLATES


def program(wiring: Wiring, name: str) -> Component:
    """All parts of a wiring as one component that acts at sample instants.

    Parameters and discrete states are named ``part_name``; the parts share one ``sample_time``.
    Inputs are the plant's outputs as ``plant_name`` and the external signals with their own names.
    Outputs are the wiring's taps, with their names, and the command `u`.

    Raises
    ------
    ContractError
        If the source of an input does not exist.
    """
    connections = {
        f"{part.name}.{port}": source.replace(f"{PLANT}.", f"{PLANT}_")
        for part in wiring.parts
        for port, source in part.feeds.items()
    }
    outside = dict.fromkeys(source for source in connections.values() if "." not in source)
    return interconnect(
        {part.name: part.make() for part in wiring.parts},
        connections,
        list(outside),
        wiring.taps | ({COMMAND: wiring.command} if "." in wiring.command else {}),
        name,
        "The rig's instruments and controller as one program",
    )

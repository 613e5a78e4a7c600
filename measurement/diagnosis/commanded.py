"""Kind of a record's command: a voltage, or the current of a motor that is not modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...plant.direct_drive import bare_direct_drive
from ...plant.law import law
from ...solver.errors import BadRecord
from ..records.record import CURRENT, FORCE, TORQUE, VOLTAGE, Record
from .drive import Drive


def commanded(records: Sequence[Record], model: Drive) -> tuple[list[Record], Drive, list[str]]:
    """Return records with a command that the model accepts, the model, and notes on changes.

    If only the current of a ball screw is known, it becomes a drive, see `driven_by_current`. The
    current of a drive is left out, because a drive has no equation for it.

    Raises
    ------
    BadRecord
        If the model does not accept a record's command.
    """
    if not records:
        raise BadRecord("there is no record: expected one file of measured data at least")
    currents = [r.current_alone or r.command == CURRENT for r in records]
    if model.has_motor and any(currents):
        if not all(currents):
            raise BadRecord(
                f"{records[currents.index(True)].name}: has the current as its only command, and "
                f"{records[currents.index(False)].name} does not; diagnose them separately"
            )
        drive = driven_by_current(model)
        said = (
            f"there is no voltage: the current is the command of a drive with gain = kt*2*pi*p = "
            f"{drive.values['gain']:.4g} N/A and m = {drive.values['m']:.4g} kg, the rotor in it"
        )
        known = [r for r in map(by_current, records) if r is not None]
        return known, drive, [f"{r.name}: {said}" for r in known]
    for record in records:
        if record.current_alone:
            raise BadRecord(
                f'{record.name}: has the current i and no command u; with kind = "drive" say '
                "map i=u unit u=A, and give gain in N/A"
            )
        if record.command != VOLTAGE and model.has_motor:
            raise BadRecord(
                f"{record.name}: u is a {record.command}, but the ball screw is driven by a "
                'voltage; use kind = "drive", whose force is gain*u'
            )
    if model.has_motor:
        return list(records), model, []
    told = model.command or records[0].command
    records = [by_torque(r) if told == TORQUE else r for r in records]
    for record in records:
        if record.command != told:
            raise BadRecord(
                f"{record.name}: u is a {record.command}, and the drive's command is a {told}; say "
                f'its unit as unit u=UNIT, or command = "{record.command}" in the parameter file '
                "with its gain"
            )
    return [_without_current(r) for r in records], replace(model, command=told), []


def driven_by_current(model: Drive) -> Drive:
    """A ball screw as a drive whose command is the motor's current.

    The gain is the motor's force per ampere, with the tolerance of `kt`. The mass is that of all
    moving bodies; its tolerance is the mean of those of block and rotor, weighted by their masses.
    """
    known = {p.name for p in bare_direct_drive(law(model.law)).all_parameters}
    values = {n: v for n, v in model.values.items() if n in known}
    values |= {"m": model.inertia, "gain": model.per_ampere, "offset": 0.0}
    given = model.tolerance
    block, rotor = model.values["m"], model.inertia - model.values["m"]
    tolerance = {n: t for n, t in given.items() if n in values}
    tolerance["gain"] = given.get("kt", 0.0)
    tolerance["m"] = (block * given.get("m", 0.0) + rotor * given.get("Jm", 0.0)) / model.inertia
    return Drive("drive", model.law, values, tolerance, CURRENT)


def by_current(record: Record) -> Record | None:
    """The record with its current as the command; None if some samples have no current."""
    told = not record.current_alone and record.command == CURRENT
    if not told and not np.isfinite(record.signals.get("i", np.array([np.nan]))).all():
        return None
    signals = {**record.signals, "u": record.u if told else record.signals["i"]}
    return _without_current(replace(record, signals=signals, command=CURRENT))


def by_torque(record: Record) -> Record:
    """A record whose command became a force by the lead of its screw, with its torque again."""
    if record.command != FORCE or record.lead is None:
        return record
    torque = record.u * record.lead / (2 * np.pi)
    return replace(record, signals={**record.signals, "u": torque}, command=TORQUE)


def _without_current(record: Record) -> Record:
    return replace(record, signals={n: s for n, s in record.signals.items() if n != "i"})

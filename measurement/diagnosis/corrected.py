"""The parameter file written by a diagnosis: corrected values, each with its source."""

from __future__ import annotations

from dataclasses import replace

from ...orchestration.loop.parameter_file import Diagnosed, ParameterFile, Value
from ...plant.instruments.amplifier import PARAMETERS as AMPLIFIER
from ...solver.component import Component, Parameter
from .diagnosis import Diagnosis
from .with_causes import FOUND, last_record, with_causes, with_law_of


def corrected(
    result: Diagnosis, plant: Component | None, told: ParameterFile | None
) -> ParameterFile:
    """The final values of a diagnosis, instead of the prior ones.

    Parameters
    ----------
    result : Diagnosis
    plant : Component or None
        With the causes, where one can be made.
    told : ParameterFile or None
        The prior model. A value that the diagnosis does not change keeps its interval and source,
        and so do values that are not part of the diagnosis: amplifier, controllers, rig. Values of
        a motor that is left out, see `commanded`, are not written.
    """
    told = told or ParameterFile()
    found = {c.name: last_record(c.parameters) for c in result.causes}
    drive = with_law_of(result.corrected, found) if plant else result.corrected
    plant = plant or with_causes(result.corrected, [])
    records = ", ".join(result.records)
    intervals: dict[str, tuple[float, float]] = {}
    for cause in result.causes:
        intervals |= last_record(cause.intervals)

    def value_of(p: Parameter) -> Value:
        before = told.plant.get(p.name)
        if p.source == FOUND:
            source = f"found by ballscrew diagnose in {records}"
            return Value(p.default, p.unit, intervals.get(p.name), source)
        if before is not None and (before.value == p.default or p.name not in result.prior.values):
            return replace(before, unit=p.unit)
        if p.default != result.prior.values.get(p.name, p.default):
            return Value(p.default, p.unit, None, f"corrected by ballscrew diagnose to {records}")
        return Value(p.default, p.unit, None, "prior")

    names = {p.name for p in (*drive.plant.all_parameters, *AMPLIFIER)}
    own = {p.name: value_of(p) for p in plant.all_parameters if p.name in names}
    apart = [p for p in plant.all_parameters if p.name not in names and p.source == FOUND]
    others = told.plant if told.kind == drive.kind else {}
    return replace(
        told,
        path=None,
        kind=drive.kind,
        command="" if drive.has_motor else drive.command,
        law=drive.law,
        plant=own | {n: v for n, v in others.items() if n not in own},
        found={p.name: value_of(p) for p in apart},
        tolerance={},
        not_identified={},
        diagnosis=Diagnosed(
            records=result.records,
            command=result.command,
            command_shift=result.command_shift,
            law=result.prior.law,
            prior=result.prior.values,
            adjusted=result.adjusted.values,
            causes=found,
        ),
    ).turning()

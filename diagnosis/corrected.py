"""The parameter file that a diagnosis leaves: the values corrected, each with its source."""

from __future__ import annotations

from dataclasses import replace

from ..orchestration.parameter_file import Diagnosed, ParameterFile, Value
from ..solver.component import Component
from .diagnosis import Diagnosis
from .extended_plant import FOUND, extended_plant, last_record, parameter_file


def corrected(
    result: Diagnosis, plant: Component | None, told: ParameterFile | None
) -> ParameterFile:
    """The values that a diagnosis ends with, in place of those that it was told.

    Parameters
    ----------
    result : Diagnosis
    plant : Component or None
        With the causes, where one can be made.
    told : ParameterFile or None
        The prior model. A value that the diagnosis leaves keeps its interval and source, and so
        do values that take no part: of the amplifier, of controllers, of the rig. A motor that is
        left out, see `commanded`, has none.
    """
    told = told or ParameterFile()
    file = parameter_file(plant or extended_plant(result.corrected, []))
    records = ", ".join(result.records)
    intervals: dict[str, tuple[float, float]] = {}
    for cause in result.causes:
        intervals |= last_record(cause.intervals)

    def with_source(name: str, value: Value) -> Value:
        before = told.plant.get(name)
        if value.source == FOUND:
            source = f"found by ballscrew diagnose in {records}"
            return replace(value, interval=intervals.get(name), source=source)
        if before is not None and (before.value == value.value or name not in result.prior.values):
            return replace(before, unit=value.unit)
        if value.value != result.prior.values.get(name, value.value):
            return replace(value, source=f"corrected by ballscrew diagnose to {records}")
        return replace(value, source="prior")

    values = {n: with_source(n, v) for n, v in file.plant.items()}
    others = told.plant if told.kind == file.kind else {}
    return replace(
        told,
        path=None,
        kind=file.kind,
        law=file.law,
        plant=values | {n: v for n, v in others.items() if n not in values},
        found={n: with_source(n, v) for n, v in file.found.items()},
        tolerance={},
        not_identified={},
        diagnosis=Diagnosed(
            records=result.records,
            command=result.command,
            command_shift=result.command_shift,
            law=result.prior.law,
            prior=result.prior.values,
            adjusted=result.adjusted.values,
            causes={c.name: last_record(c.parameters) for c in result.causes},
        ),
    )

"""Errors of a simulation of records, and their causes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..diagnosis.diagnosis import ANSWERED, Diagnosis
from .result import Result, table_of

if TYPE_CHECKING:
    from ..solver.component import Component


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Result, Diagnosis):
    """Errors of a simulation of records, and their causes; see `ballscrew.diagnose`."""

    @property
    def trusted(self) -> bool:
        """Whether all of the residual but noise is explained, confirmed on held-out data."""
        from ..diagnosis.report_words import does_not_hold

        return self.verdict in ANSWERED and not does_not_hold(self)

    def pictures(self) -> dict[str, Any]:
        from ..diagnosis.diagnosis_pictures import diagnosis_figure

        return {"diagnosis": diagnosis_figure(self)}

    def headline(self) -> str:
        from ..diagnosis.report_words import verdict_sentence

        return f"{self.verdict}: {verdict_sentence(self)}"

    def facts(self) -> Iterable[tuple[str, str]]:
        from ..diagnosis.report_words import micrometres, of_friction

        rows = (
            ("residual of the prior model, rms", self.baseline_residual),
            ("residual with adjusted values, rms", self.adjusted_residual),
            ("residual with causes, rms", self.final_residual),
            ("noise alone, rms", self.floor),
        )
        for name, level in rows:
            yield name, f"{level.force:.4g} N, {micrometres(level.position)} um"
        for cause in self.causes:
            low, high = cause.gain_interval
            yield (
                cause.name if cause.certain else f"{cause.name} (most probable, not certain)",
                f"takes {100 * cause.gain_heldout:.3g} % of the mean square on "
                f"held-out data [{100 * low:.3g}, {100 * high:.3g}]",
            )
        for suspect in self.suspects:
            told = of_friction(suspect.of_friction)
            yield (
                f"possible: {suspect.name}",
                f"probability {suspect.probability:.2f}, {suspect.force:.3g} N rms, {told}",
            )

    def extended_plant(self) -> Component:
        """The corrected plant with the named causes in it, for `run`, `lyapunov` and `export`.

        Raises
        ------
        ValueError
            If no plant can hold these causes; the message says why.
        """
        from ..diagnosis.with_causes import as_it_moves, with_causes

        return as_it_moves(with_causes(self.corrected, self.found()), self.corrected)

    def to_pandas(self) -> Any:
        """A row for each parameter of the included causes: value, interval, unit, held-out gain.

        A number that only describes a form has no interval (NaN).
        """
        unknown = (float("nan"), float("nan"))
        rows = [
            {
                "cause": c.name,
                "parameter": n,
                "value": value,
                "low": c.intervals.get(n, unknown)[0],
                "high": c.intervals.get(n, unknown)[1],
                "unit": c.units[n],
                "gain_heldout": c.gain_heldout,
            }
            for c in self.causes
            for n, value in c.parameters.items()
        ]
        columns = ("cause", "parameter", "value", "low", "high", "unit", "gain_heldout")
        return table_of({k: [row[k] for row in rows] for k in columns})

"""What a simulation of records gets wrong, and why."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..diagnosis.diagnosis import EXPLAINED, NONE, Diagnosis
from .result import Result, table_of

if TYPE_CHECKING:
    from ..solver.component import Component


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Result, Diagnosis):
    """What a simulation of records gets wrong, and why; see `ballscrew.diagnose`."""

    @property
    def trusted(self) -> bool:
        """Whether all structure is explained, or there is none, and it holds on data held out."""
        from ..diagnosis.report_words import does_not_hold

        return self.verdict in (NONE, EXPLAINED) and not does_not_hold(self)

    def pictures(self) -> dict[str, Any]:
        from ..diagnosis.diagnosis_pictures import diagnosis_figure

        return {"diagnosis": diagnosis_figure(self)}

    def headline(self) -> str:
        from ..diagnosis.report_words import verdict_sentence

        return f"{self.verdict}: {verdict_sentence(self)}"

    def facts(self) -> Iterable[tuple[str, str]]:
        rows = (
            ("residual of the prior model, rms", self.baseline_residual),
            ("residual with values adjusted, rms", self.adjusted_residual),
            ("residual with causes, rms", self.final_residual),
            ("noise alone, rms", self.floor),
        )
        for name, level in rows:
            yield name, f"{level.force:.4g} N, {1e6 * level.position:.4g} um"
        for cause in self.causes:
            low, high = cause.gain_interval
            yield (
                cause.name,
                f"takes {100 * cause.gain_heldout:.3g} % of the mean square on data held out "
                f"[{100 * low:.3g}, {100 * high:.3g}]",
            )

    def extended_plant(self) -> Component:
        """The corrected plant with the named causes in it, for `run`, `lyapunov` and `export`.

        Raises
        ------
        ValueError
            If no plant can hold these causes; the message says why.
        """
        from ..diagnosis.extended_plant import extended_plant

        return extended_plant(self.corrected, self.found())

    def to_pandas(self) -> Any:
        """A row for each named cause's parameter: value, 95 % interval, unit, gain held out."""
        rows = [
            {
                "cause": c.name,
                "parameter": n,
                "value": value,
                "low": c.intervals[n][0],
                "high": c.intervals[n][1],
                "unit": c.units[n],
                "gain_heldout": c.gain_heldout,
            }
            for c in self.causes
            for n, value in c.parameters.items()
        ]
        columns = ("cause", "parameter", "value", "low", "high", "unit", "gain_heldout")
        return table_of({k: [row[k] for row in rows] for k in columns})

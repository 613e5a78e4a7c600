"""A friction law's parameters from records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..identification.identification import Identification
from .result import Result, table_of


@dataclass(frozen=True, repr=False)
class IdentifiedLaw(Result, Identification):
    """A friction law's parameters from records; see `ballscrew.identify`."""

    def pictures(self) -> dict[str, Any]:
        from ..identification.identification_pictures import identification_figures

        return identification_figures(self)

    def headline(self) -> str:
        warnings = f"; {'; '.join(self.warnings)}" if self.warnings else ""
        return f"{self.law} from {len(self.records)} records{warnings}"

    def facts(self) -> Iterable[tuple[str, str]]:
        for name, i in self.parameters.items():
            bounds = ["-inf" if i.low is None else f"{i.low:.4g}"]
            bounds += ["inf" if i.high is None else f"{i.high:.4g}"]
            why = "" if i.identified else f", not identified: {i.because}"
            yield name, f"{i.value:.6g} {i.unit} [{bounds[0]}, {bounds[1]}]{why}"

    def to_pandas(self) -> Any:
        """A row for each parameter: value, unit, 95 % interval, whether and why not identified."""
        names = ("value", "unit", "low", "high", "identified", "because", "would_do")
        rows = [
            {"parameter": n, **{k: getattr(i, k) for k in names}}
            for n, i in self.parameters.items()
        ]
        return table_of(rows, "parameter")

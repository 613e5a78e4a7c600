"""Errors of several models on records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..diagnosis.compared import ALL, Compared, length
from .result import Result, table_of


@dataclass(frozen=True, repr=False)
class ModelComparison(Result, Compared):
    """Errors of several models on records; see `ballscrew.compare`."""

    def pictures(self) -> dict[str, Any]:
        from ..diagnosis.compare_pictures import compare_figure

        return {"compare": compare_figure(self)}

    def headline(self) -> str:
        return self.says

    def facts(self) -> Iterable[tuple[str, str]]:
        for name, parts in [*self.models.items(), ("noise alone", {ALL: self.floor})]:
            force, position = parts[ALL].force, parts[ALL].position
            yield (
                f"{name}, rms",
                f"{f'{force.value:.4g} N' if force else '-'}, "
                f"{f'{length(position.value)} within a second' if position else '-'}",
            )

    def to_pandas(self) -> Any:
        """A row for each model and part of the motion: rms of the residual."""
        rows = [
            (name, part, e and e.value, p and p.value)
            for name, parts in self.models.items()
            for part, (e, p) in ((n, (f.force, f.position)) for n, f in parts.items())
        ]
        columns = ("model", "part", "force_N", "position_m")
        return table_of(dict(zip(columns, map(list, zip(*rows, strict=True)), strict=True)))

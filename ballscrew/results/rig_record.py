"""A trial of the virtual rig."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..rig.record import TrialRecord
from .result import Result, table_of


@dataclass(frozen=True, repr=False)
class RigRecord(Result, TrialRecord):
    """What the virtual rig's instruments recorded; see `ballscrew.run_trial`."""

    @property
    def trusted(self) -> bool:
        """Whether all instruments were within their range."""
        return not self.notes

    def pictures(self) -> dict[str, Any]:
        from ..rig.record_picture import record_figure

        return {"record": record_figure(self)}

    def headline(self) -> str:
        doubt = f"; not trusted: {'; '.join(self.notes)}" if self.notes else ""
        return f"trial {self.trial.name} with {self.law}: {self.trial.asked}{doubt}"

    def facts(self) -> Iterable[tuple[str, str]]:
        yield "duration", f"{self.trial.duration:g} s"
        yield "samples", str(len(self.record["time"]))

    def to_pandas(self) -> Any:
        """What was recorded, SI units, over ``time`` [s]."""
        return table_of(self.record, "time")

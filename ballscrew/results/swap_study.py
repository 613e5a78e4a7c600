"""A controller swap study: its files, pictures and report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..orchestration.pictures import drawing, write_figure
from ..orchestration.study.comparison import ALIKE
from ..orchestration.study.lengths import length
from ..orchestration.study.result import StudyResult
from ..orchestration.study.verdict import cannot_tell, sentence, weaknesses
from ..solver.files import finite_or_null, write_atomically, write_json
from ..solver.tables import write_table
from .result import Result, table_of


@dataclass(frozen=True, repr=False)
class SwapStudy(Result, StudyResult):
    """A controller swap study; see `ballscrew study`."""

    @property
    def trusted(self) -> bool:
        """Whether no run failed, and all repeated runs over FMUs gave the same result."""
        return not self.disagreed and not any(any(a.failed.values()) for a in self.answers)

    def headline(self) -> str:
        """The best controller, then limitations, then the size of the study."""
        entrants, duties = len(self.plan.entrants), len(self.plan.judged_duties)
        runs = self.figures["rms_error"].size
        size = f"{entrants} controllers, {duties} duties, {runs} runs"
        parts = [sentence(self), *weaknesses(self), size]
        return ". ".join(part[0].upper() + part[1:] if k else part for k, part in enumerate(parts))

    def facts(self) -> Iterable[tuple[str, str]]:
        for answer in self.answers:
            if not answer.order:
                yield answer.duty, "no controller completed its runs"
                continue
            first = answer.order[0]
            text = f"{first} ({length(self.mean('rms_error', first, answer.duty))} rms)"
            if len(answer.best) > 1:
                text += f"; equal within {100 * ALIKE:g} %: {', '.join(answer.best[1:])}"
            if answer.unclear:
                text += f"; {cannot_tell(self)} it from {', '.join(answer.unclear)}"
            yield answer.duty, text
        worst = max((c.apart for c in self.checks.values() if c.apart >= 0), default=0.0)
        text = f"{len(self.checks)} runs, at most {length(worst)} apart"
        if self.not_converged:
            text += f"; the coupling of {self.not_converged} not converged"
        yield "repeated over FMUs", text

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Write ``study.json``, the table of runs and, by default, the report and its picture."""
        from ..orchestration.study.report import report

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        told = {"verdict": sentence(self), "weaknesses": weaknesses(self)}
        write_json(folder / "study.json", finite_or_null(told | self.to_dict()))
        write_table(folder, "runs", [self.rows()])
        if pictures:
            write_atomically(folder / "report.html", report(self).encode())
            with drawing():
                write_figure(self.plot(), folder, "study")

    def pictures(self) -> dict[str, Any]:
        from ..orchestration.study.pictures import effort_figure

        return {"study": effort_figure(self)}

    def to_pandas(self) -> Any:
        """A row for each run, as in the table ``runs``."""
        return table_of(self.rows())

"""Results of identifications, diagnoses, comparisons and trials on the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .measurement.diagnosis.compare import ALL, Compared, Estimate, Left
from .measurement.diagnosis.diagnosis import ANSWERED, Diagnosis
from .measurement.diagnosis.report import WORDS, diagnosis_figure, tables_of, verdict_sentence
from .measurement.identification.identification import Identification
from .measurement.identification.intervals import Interval
from .measurement.rig.record import TrialRecord
from .orchestration.loop.shown import Table, shown_unit
from .result import Result, table_of
from .solver.arrays import Vector
from .solver.component import Component
from .solver.files import write_table


@dataclass(frozen=True, repr=False)
class IdentifiedLaw(Result, Identification):
    """A friction law's parameters from records; see `ballscrew.identify`."""

    function = "ballscrew.identify"

    def pictures(self) -> dict[str, Any]:
        from .measurement.identification.identification_pictures import identification_figures

        return identification_figures(self)

    def headline(self) -> str:
        warnings = f"; {'; '.join(self.warnings)}" if self.warnings else ""
        return f"{self.law} from {len(self.records)} records{warnings}"

    def doubts(self) -> Iterable[str]:
        return [*self.unknown(), *self.notes]

    def unknown(self) -> Iterable[str]:
        """Each parameter that is not identified, with the reason and a remedy."""
        for name, i in self.parameters.items():
            if not i.identified:
                why = f"because {i.because}; {i.would_do}"
                yield f"{name} cannot be identified from these trials, {why}"

    def tables(self) -> list[Table]:
        unknown = {n: "" if i.identified else "not identified" for n, i in self.parameters.items()}
        said = {**unknown, **dict.fromkeys(self.fixed, "held")}
        rows = [
            (name, f"{i.value:.6g}", between(i), i.unit, said[name])
            for name, i in self.parameters.items()
        ]
        columns = ("parameter", "value", "95 % interval", "unit")
        tables = [Table(f"Parameters of {self.law}", (*columns, ""), rows)]
        if self.per_direction:
            sides = [
                (side, name, f"{i.value:.5g}", between(i), i.unit)
                for side, table in self.per_direction.items()
                for name, i in table.items()
            ]
            tables.append(Table("In each direction", ("direction", *columns), sides))
        force = [
            ("noise of the load cell", f"{self.fit.noise:.3g} N"),
            ("unexplained", f"{self.unexplained:.3g} N"),
        ]
        if self.time_shift:
            shift = self.time_shift.times(1e3)
            force.append(("later than the motion by", f"{shift.value:.3g} ms ({between(shift)})"))
        force.append(("fit on data held out", f"{self.held_out:.3g} %"))
        records = Table("Records", ("record",), [(r.name,) for r in self.records])
        return [*tables, Table("The force", ("", ""), force), records]

    def to_pandas(self) -> Any:
        """A row for each parameter: value, unit, 95 % interval, whether and why not identified."""
        names = ("value", "unit", "low", "high", "identified", "because", "would_do")
        rows = ((n, *(getattr(i, k) for k in names)) for n, i in self.parameters.items())
        return table_of(rows, "parameter", ["parameter", *names])


def between(i: Interval) -> str:
    """The ends of an interval as text."""
    low = "..." if i.low is None else f"{i.low:.5g}"
    high = "..." if i.high is None else f"{i.high:.5g}"
    return f"{low} .. {high}"


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Result, Diagnosis):
    """Errors of a simulation of records, and their causes; see `ballscrew.diagnose`."""

    function = "ballscrew.diagnose"

    @property
    def trusted(self) -> bool:
        """Whether all of the residual but noise is explained, confirmed on held-out data."""
        return self.verdict in ANSWERED and self.confirmed

    @property
    def badge(self) -> str:
        return WORDS[self.verdict]

    def pictures(self) -> dict[str, Any]:
        return {"diagnosis": diagnosis_figure(self)}

    def headline(self) -> str:
        return f"{self.badge}: {verdict_sentence(self)}"

    def write(self, folder: Path) -> None:
        """Write ``diagnosis.json``, the table ``curves``, and the next experiment's commands."""
        write_table(folder, "curves", [asdict(self.curves)])
        Diagnosis.save(self, folder)

    def tables(self) -> list[Table]:
        return tables_of(self)

    def extended_plant(self) -> Component:
        """The corrected plant with the named causes in it, for `run`, `lyapunov` and `export`.

        A ValueError says why no plant can hold these causes.
        """
        from .measurement.diagnosis.corrected import as_it_moves, with_causes

        return as_it_moves(with_causes(self.corrected, self.found()), self.corrected)

    def to_pandas(self) -> Any:
        """A row for each parameter of the included causes: value, interval, unit, held-out gain.

        A number that only describes a form has no interval (NaN).
        """
        unknown = (float("nan"), float("nan"))
        rows = (
            (c.name, n, value, *c.intervals.get(n, unknown), c.units[n], c.gain_heldout)
            for c in self.causes
            for n, value in c.parameters.items()
        )
        return table_of(rows, columns="cause parameter value low high unit gain_heldout".split())


@dataclass(frozen=True, repr=False)
class ModelComparison(Result, Compared):
    """Errors of several models on records; see `ballscrew.compare`."""

    function = "ballscrew.compare"
    badge = "compared"

    def pictures(self) -> dict[str, Any]:
        from .measurement.diagnosis.report import compare_figure

        return {"compare": compare_figure(self)}

    def headline(self) -> str:
        return self.says

    def tables(self) -> list[Table]:
        """The residuals by part of the motion, a column for each model, and the gains."""
        positions = [p.value for m in self.models.values() for f in m.values() if (p := f.position)]
        size, unit = shown_unit(positions, "m")
        tables = [
            self._residuals("force [N]", 1.0, lambda left: left.force),
            self._residuals(f"position within 1 s [{unit}]", size, lambda left: left.position),
        ]
        if self.gains:
            rows = [
                (f"{g.model} over {g.over}", _figure(g.force, 100.0), _figure(g.position, 100.0))
                for g in self.gains
            ]
            title = "gain, in % of the mean square"
            tables.append(Table(title, (title, "force [%]", "position [%]"), rows))
        causes = ", ".join(self.causes) or "no cause"
        about = [("records", ", ".join(self.records)), ("length", f"{self.seconds:.3g} s")]
        if self.diagnosed:
            about += [("diagnosed of", ", ".join(self.diagnosed))]
            about += [("corrected", f"values, and {causes}")]
        return [*tables, Table("what was compared", ("", ""), about)]

    def _residuals(self, title: str, size: float, of: Callable[[Left], Estimate | None]) -> Table:
        models = self.models.values()
        whole = [_figure(of(left), size) for left in (*(m[ALL] for m in models), self.floor)]
        rows = [("in all", *whole)]
        for part, share in self.shares.items():
            figures = (_figure(of(m[part]), size) for m in models)
            rows.append((f"{part}, {100 * share:.2g} % of the time", *figures, ""))
        title = f"{title}, rms (95 %)"
        return Table(title, (title, *self.models, "noise alone"), rows)

    def to_pandas(self) -> Any:
        """A row for each model and part of the motion: rms of the residual."""
        rows = (
            (name, part, left.force and left.force.value, left.position and left.position.value)
            for name, parts in self.models.items()
            for part, left in parts.items()
        )
        return table_of(rows, columns=["model", "part", "force_N", "position_m"])


def _figure(found: Estimate | None, size: float) -> str:
    if found is None:
        return "-"
    value = f"{size * found.value:.3g}"
    if found.interval is None:
        return value
    low, high = (f"{size * end:.3g}" for end in found.interval)
    return f"{value} ({low} to {high})"


@dataclass(frozen=True, repr=False)
class RigRecord(Result, TrialRecord):
    """What the virtual rig's instruments recorded; see `ballscrew.run_trial`.

    ``result["force"]`` is a recorded signal, shape (m,), over ``result.time`` [s], in SI units.
    """

    function = "ballscrew.run_trial"

    @property
    def trusted(self) -> bool:
        """Whether all instruments were within their range."""
        return not self.notes

    @property
    def time(self) -> Vector:
        """Times of all signals [s], shape (m,)."""
        return self.record["time"]

    def __getitem__(self, name: str) -> Vector:
        return self.record[name]

    def pictures(self) -> dict[str, Any]:
        from .measurement.rig.record import record_figure

        return {"record": record_figure(self)}

    def headline(self) -> str:
        doubt = f"; not trusted: {'; '.join(self.notes)}" if self.notes else ""
        return f"trial {self.trial.name} with {self.law}: {self.trial.asked}{doubt}"

    def tables(self) -> list[Table]:
        about = [("duration", f"{self.trial.duration:g} s"), ("samples", str(len(self.time)))]
        values = [(name, f"{value:.6g}") for name, value in self.parameters.items()]
        return [
            Table("Trial", ("", ""), about),
            Table("Values used, in SI units", ("parameter", "value"), values),
        ]

    def to_pandas(self) -> Any:
        """What was recorded, SI units, over ``time`` [s]."""
        return table_of(self.record, "time")

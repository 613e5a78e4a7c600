"""What the public functions return: numbers, files, figures, tables, and a view for notebooks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from .diagnosis.diagnosis import EXPLAINED, NONE, Diagnosis
from .identification.identification import Identification
from .orchestration.closed_loop_result import ClosedLoopResult
from .orchestration.pictures import write_figure
from .orchestration.swap import COLUMNS, SwapResult
from .rig.record import TrialRecord
from .stability.lyapunov import LyapunovRun
from .stability.store import MapSummary

if TYPE_CHECKING:
    from .solver.component import Component

BITS = 1.0 / math.log(2.0)  # per nat


class Result:
    """What every result does besides holding its numbers."""

    @classmethod
    def of(cls, computed: Any) -> Self:
        """The result with the fields of what was computed."""
        return cls(**{f.name: getattr(computed, f.name) for f in fields(computed)})

    def pictures(self) -> dict[str, Any]:
        """Matplotlib figures by the names of their files, the most telling first."""
        raise NotImplementedError

    def headline(self) -> str:
        """The result in one sentence, with what weakens it."""
        raise NotImplementedError

    def facts(self) -> Iterable[tuple[str, str]]:
        """Named numbers, as text with units."""
        raise NotImplementedError

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Write plain files (CSV, JSON, TOML) and, by default, the figures as PNG.

        Parameters
        ----------
        folder : path-like
            Made where it is not there.
        pictures : bool
            Whether to write the figures, too.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        super().save(folder)  # type: ignore[misc]
        if pictures:
            for stem, figure in self.pictures().items():
                write_figure(figure, folder, stem)

    def plot(self) -> Any:
        """The figure that tells most, a `matplotlib.figure.Figure`."""
        return next(iter(self.pictures().values()))

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>"
            for name, value in self.facts()
        )
        return f"<p><b>{escape(self.headline())}</b></p><table>{rows}</table>"


def _frame(data: Any, index: str | None = None) -> Any:
    """A pandas table; pandas is asked for only here."""
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install pandas") from error
    table = pd.DataFrame(data)
    return table if index is None else table.set_index(index)


def _with_unit(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.6g} {unit}".rstrip()


@dataclass(frozen=True)
class RunResult(Result, ClosedLoopResult):
    """A closed-loop run; see `ballscrew.run`."""

    def pictures(self) -> dict[str, Any]:
        from .orchestration.pictures import run_figures

        return run_figures(self)

    def headline(self) -> str:
        return f"{self.study.label}, {self.run.verdict.word}: {self.run.verdict.reason}"

    def facts(self) -> Iterable[tuple[str, str]]:
        figures = self.figures()
        units = {
            "peak_voltage": "V",
            "settling_time_2pct": "s",
            "overshoot": "m",
            "steady_state_error": "m",
            "iae": "m*s",
            "coupling_residual_max": "V",
        }
        for name, unit in units.items():
            if name in figures:
                yield name.replace("_", " "), _with_unit(figures[name], unit)
        yield "communication steps", str(figures["macro_steps"])
        yield "coupling", figures["coupling"]

    def to_pandas(self) -> Any:
        """All signals in SI units, a `pandas.DataFrame` over ``time`` [s]."""
        columns = {"time": self.run.time, **self.run.outputs, **self.run.commands}
        return _frame({**columns, "x_d": self.run.reference}, "time")


@dataclass(frozen=True)
class Comparison(Result, SwapResult):
    """Several controllers on one plant; see `ballscrew.swap`."""

    def pictures(self) -> dict[str, Any]:
        from .orchestration.pictures import comparison_figure

        return {"comparison": comparison_figure(self.results)}

    def headline(self) -> str:
        doubtful = [r.study.label for r in self.results if not r.trusted]
        names = ", ".join(r.study.label for r in self.results)
        return f"{names} on one plant" + (
            f"; not to be believed: {', '.join(doubtful)}" if doubtful else ""
        )

    def facts(self) -> Iterable[tuple[str, str]]:
        for result in self.results:
            figures = result.figures()
            peak = _with_unit(figures.get("peak_voltage"), "V")
            settled = _with_unit(figures.get("settling_time_2pct"), "s")
            yield result.study.label, f"peak {peak}, settled in {settled}, {figures['verdict']}"

    def to_pandas(self) -> Any:
        """A row for each controller, with the columns of ``comparison.csv``."""
        rows = [{c: r.figures().get(c) for c in COLUMNS} for r in self.results]
        return _frame(rows, "controller")


@dataclass(frozen=True)
class Exponents(Result, LyapunovRun):
    """Lyapunov exponents of a closed loop; see `ballscrew.lyapunov`."""

    @property
    def trusted(self) -> bool:
        """Whether the loop's attractor could be classified."""
        return self.decided

    def pictures(self) -> dict[str, Any]:
        from .stability.exponent_pictures import convergence_figure

        return {"lyapunov": convergence_figure(self)}

    def headline(self) -> str:
        return f"{self.label}: {self.motion.kind.value} ({self.motion.evidence})"

    def facts(self) -> Iterable[tuple[str, str]]:
        for k, (value, error) in enumerate(zip(self.exponents, self.error, strict=True)):
            yield f"exponent {k + 1}", f"{value * BITS:.6g} +- {error * BITS:.2g} bits/s"
        off = self.sum_rule_error()
        yield "sum rule, relative error", _with_unit(off, "")

    def to_pandas(self) -> Any:
        """A row for each exponent: finite-time value, its error and the limit [bits/s]."""
        limit = self.motion.limit
        return _frame(
            {
                "exponent": self.exponents * BITS,
                "error": self.error * BITS,
                "limit": [math.nan] * len(self.exponents) if limit is None else limit * BITS,
            }
        )


@dataclass(frozen=True)
class StabilityMap(Result):
    """A map over two parameters, in its folder; see `ballscrew.stability_map`.

    Attributes
    ----------
    summary : MapSummary
    folder : Path
        Holds ``map.parquet``, ``map.json`` and, with `refine`, ``borders.csv``.
    """

    summary: MapSummary
    folder: Path

    @property
    def trusted(self) -> bool:
        """Whether no cell away from borders has another verdict at a tenth of the tolerance."""
        return self.summary.random_disagreed == 0

    def pictures(self) -> dict[str, Any]:
        from .stability.map_pictures import map_figure

        return {"map": map_figure(self.summary.study, self.folder)}

    def headline(self) -> str:
        s = self.summary
        return (
            f"{s.study.cells} loops of {s.study.controller}; at a tenth of the tolerance "
            f"{s.disagreed} of {s.checked} have another verdict"
        )

    def facts(self) -> Iterable[tuple[str, str]]:
        for verdict, count in sorted(self.summary.verdicts.items(), key=lambda row: -row[1]):
            yield verdict, f"{count} of {self.summary.study.cells}"

    def save(self, folder: Path | str, pictures: bool = True) -> None:
        """Copy the map's files to another folder, and draw it there."""
        import shutil

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("map.parquet", "map.json", "borders.csv"):
            if (self.folder / name).is_file() and folder.resolve() != self.folder.resolve():
                shutil.copyfile(self.folder / name, folder / name)
        if pictures:
            write_figure(self.plot(), folder, "map")

    def to_pandas(self) -> Any:
        """A row for each cell, as in ``map.parquet``."""
        import pyarrow.parquet as pq

        return _frame(pq.read_table(self.folder / "map.parquet").to_pydict())


@dataclass(frozen=True)
class RigRecord(Result, TrialRecord):
    """What the virtual rig's instruments recorded; see `ballscrew.run_trial`."""

    @property
    def trusted(self) -> bool:
        """Whether no instrument was past its range."""
        return not self.notes

    def pictures(self) -> dict[str, Any]:
        from .rig.record_picture import record_figure

        return {"record": record_figure(self)}

    def headline(self) -> str:
        doubt = f"; not to be believed: {'; '.join(self.notes)}" if self.notes else ""
        return f"trial {self.trial.name} with {self.law}: {self.trial.asked}{doubt}"

    def facts(self) -> Iterable[tuple[str, str]]:
        yield "duration", f"{self.trial.duration:g} s"
        yield "samples", str(len(self.record["time"]))

    def to_pandas(self) -> Any:
        """What was recorded, SI units, over ``time`` [s]."""
        return _frame(self.record, "time")


@dataclass(frozen=True)
class IdentifiedLaw(Result, Identification):
    """A friction law's parameters from records; see `ballscrew.identify`."""

    @property
    def trusted(self) -> bool:
        """Whether all parameters are identified and the law describes the records."""
        return self.believed

    def pictures(self) -> dict[str, Any]:
        from .identification.identification_pictures import identification_figures

        return identification_figures(self)

    def headline(self) -> str:
        doubts = f"; {'; '.join(self.doubts)}" if self.doubts else ""
        return f"{self.law} from {len(self.records)} records{doubts}"

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
        return _frame(rows, "parameter")


@dataclass(frozen=True)
class DiagnosisResult(Result, Diagnosis):
    """What a simulation of records gets wrong, and why; see `ballscrew.diagnose`."""

    @property
    def trusted(self) -> bool:
        """Whether all structure is explained, or there is none, and it holds on data held out."""
        from .diagnosis.report_words import does_not_hold

        return self.verdict in (NONE, EXPLAINED) and not does_not_hold(self)

    def pictures(self) -> dict[str, Any]:
        from .diagnosis.diagnosis_pictures import diagnosis_figure

        return {"diagnosis": diagnosis_figure(self)}

    def headline(self) -> str:
        from .diagnosis.report_words import verdict_sentence

        return f"{self.verdict}: {verdict_sentence(self)}"

    def facts(self) -> Iterable[tuple[str, str]]:
        rows = (
            ("residual as believed, rms", self.baseline_residual),
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
        from .diagnosis.extended_plant import extended_plant

        return extended_plant(self.mended, self.found())

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
        return _frame({k: [row[k] for row in rows] for k in columns})

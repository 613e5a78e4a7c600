"""The table of features by law, as text and as files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ballscrew.measurement.rig.program import plant_kernel
from ballscrew.orchestration.fmu.operating_system import pool
from ballscrew.plant import LAWS
from ballscrew.solver.errors import UnknownName

from .criteria import CRITERIA, FEATURES, Cell, decide_features
from .experiments import observe
from .observations import Observations
from .statements import NamedFigure, named_figures, statements


@dataclass(frozen=True)
class FeatureTable:
    """All laws' observations and decisions.

    Attributes
    ----------
    observations : dict of str to Observations
    cells : dict of str to dict of str to Cell
        By law and feature.
    """

    observations: dict[str, Observations]
    cells: dict[str, dict[str, Cell]]

    @property
    def notes(self) -> list[str]:
        """Instruments or screw out of range in a trial; such a trial is not trusted."""
        return [f"{law}: {note}" for law, seen in self.observations.items() for note in seen.notes]

    @property
    def differences(self) -> list[str]:
        """One line for each cell that differs from the thesis."""
        return [
            f"{law}, {_words(cell.feature)}: {cell.decision}, the thesis says {cell.thesis}; "
            f"{cell.difference}"
            for law, row in self.cells.items()
            for cell in row.values()
            if cell.agrees is False
        ]

    @property
    def named_figures(self) -> list[NamedFigure]:
        """The numbers of the thesis for LuGre; empty without that law."""
        if "lugre" not in self.cells:
            return []
        return named_figures(self.cells["lugre"], self.observations["lugre"])

    @property
    def statements(self) -> list[str]:
        """Statements of the thesis on its four laws, with the numbers here."""
        return statements(self.cells, self.observations)

    def text(self) -> str:
        """The table and that of the thesis, with every difference explained."""
        rows = [["law", *(_words(f) for f in FEATURES)]]
        for law, row in self.cells.items():
            rows.append([law, *(_shown(row[f]) for f in FEATURES)])
        widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
        lines = [
            "  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in rows
        ]
        lines.append("In brackets Table 2.12, - where it has no such law; * a difference.")
        differences = [f"* {line}." for line in self.differences]
        lines += ["", *(differences or ["No cell differs from the thesis'."])]
        if self.named_figures:
            lines += ["", "The thesis' largest deviations of LuGre:"]
            lines += [f"  {n.what}: {n.thesis:.1%}; {n.words}." for n in self.named_figures]
        if self.statements:
            lines += ["", "What the thesis says in words:"]
            lines += [f"  {line}." for line in self.statements]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Content of ``features.json``."""
        return {
            "criteria": CRITERIA,
            "laws": {
                law: {
                    "parameters": self.observations[law].parameters,
                    "sources_of_parameters": _sources(self.observations[law]),
                    "features": {name: _cell_dict(cell) for name, cell in row.items()},
                }
                for law, row in self.cells.items()
            },
            "differences": self.differences,
            "thesis_figures_for_lugre": [asdict(n) for n in self.named_figures],
            "statements": self.statements,
            "not_trusted": self.notes,
        }


def feature_table(
    laws: Sequence[str] | None = None,
    processes: int = 1,
    progress: Callable[[str], None] | None = None,
) -> FeatureTable:
    """Run all experiments on several laws and decide.

    Parameters
    ----------
    laws : sequence of str, optional
        Names in `plant.LAWS`; by default all.
    processes : int
        Number of processes for the laws.
    progress : function of a text, optional
        Called with the number of finished laws.

    Returns
    -------
    FeatureTable

    Raises
    ------
    UnknownName, IntegrationError
    """
    names = list(dict.fromkeys(laws or LAWS))
    unknown = [name for name in names if name not in LAWS]
    if unknown:
        raise UnknownName(f"no friction law {unknown[0]!r}; there are {', '.join(LAWS)}")
    found: list[Observations] = []

    def collect(seen: Iterable[Observations]) -> None:
        for one in seen:
            found.append(one)
            if progress:
                progress(f"{len(found)} of {len(names)} laws")

    # the last laws of the list take longest
    names.reverse()
    if processes > 1 and len(names) > 1:
        with pool(min(processes, len(names))) as workers:
            collect(workers.map(observe, names))
    else:
        collect(map(observe, names))
    found.reverse()
    return FeatureTable(
        {s.law: s for s in found},
        {s.law: decide_features(s) for s in found},
    )


def _sources(seen: Observations) -> dict[str, str]:
    nominal = {p.name: p.source for p in plant_kernel(seen.law).parameters}
    return {name: nominal[name] for name in seen.parameters}


def _words(feature: str) -> str:
    return feature.replace("_", " ").replace("breakaway", "break-away")


def _shown(cell: Cell) -> str:
    mark = " *" if cell.agrees is False else ""
    return f"{cell.decision} ({cell.thesis or '-'}){mark}"


def _cell_dict(cell: Cell) -> dict[str, Any]:
    return {
        "decision": cell.decision,
        "thesis": cell.thesis,
        "agrees": cell.agrees,
        "margin": cell.margin,
        "checks": [asdict(c) | {"met": c.met, "margin": c.margin} for c in cell.checks],
        "figures": cell.figures,
        "explanation": cell.explanation,
        "difference": cell.difference,
    }

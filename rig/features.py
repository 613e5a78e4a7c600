"""The five experiments of Section 2.4 on every friction law, and the table that comes of them.

All is decided on the trials' truth: what the instruments add says nothing of a law. Parameters are
those that were identified from records, where they are given, and otherwise the laws' nominal ones,
which the thesis identified (Tables 2.3, 2.5, 2.7, 2.9); laws that it does not have borrow theirs
from it, as their files say. Where each came from stands in ``features.json``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.end_with_parent import pool
from ..plant import LAWS
from ..plant.law import UnknownLaw
from ..solver.files import write_json
from .bench import plant_kernel, program_kernel, run_trial
from .feature_criteria import (
    CRITERIA,
    FEATURES,
    Cell,
    Course,
    ForceStep,
    NamedFigure,
    Observations,
    Peak,
    judge,
    named_figures,
    statements,
)
from .record import TrialRecord
from .regulators import loading_voltage
from .trials import FORCE, VELOCITY, VOLTAGE, Trial, trials_named
from .wiring import PLANT

Vector = npt.NDArray[np.float64]

SLOW_RATE = 0.25
"""Of the loading that shows the break-away force: the slope in Section 2.4.1's staircase [N/s]."""
LOAD_TO = 12.0
"""Quasi-static force at its end [N]: the block then slides at 4 mm/s, past the Stribeck curve."""
STEP_FORCE, STEP_TIME = 1.5, 3.0
FALL = 1e-3
"""Share by which friction has to fall for a maximum to count: over what the solver leaves."""
CYCLE = 2 * math.pi / 3.0
"""Table 2.11's [s]."""
HARMONICS = 8
"""Of the cycle, kept: the jitter from the encoder's steps is faster."""


def observe(law: str, parameters: Mapping[str, float] | None = None) -> Observations:
    """Run all experiments on one law.

    Parameters
    ----------
    law : str
        One of `plant.LAWS`.
    parameters : mapping of str to float, optional
        Values that are not nominal, as for `bench.run_trial`.

    Returns
    -------
    Observations

    Raises
    ------
    UnknownLaw, BadRig
        For names and values that make no sense.
    IntegrationError
        If a motion cannot be computed.
    """
    notes: list[str] = []
    # some fifty trials are worth a fifth of a second
    for kernel in (plant_kernel(law), *map(program_kernel, (FORCE, VELOCITY, VOLTAGE))):
        kernel.compile()

    def run(trial: Trial) -> TrialRecord:
        record = run_trial(trial, law, parameters)
        notes.extend(f"{trial.name}: {note}" for note in record.notes)
        return record

    forwards, backwards = (_peak(run(_slow_loading(d)).truth["friction"], d) for d in (1, -1))
    steps = [_force_step(run(t)) for t in trials_named("2.10")]
    steady = [_steady(run(t)) for t in trials_named("viscous")]
    cycle = _cycle(run(trials_named("2.11")[0]).truth)
    loading = [run(t) for t in trials_named("loading-rate")]
    peaks = [_peak(r.truth["friction"], 1).force for r in loading]
    staircase = run(trials_named("presliding")[0])
    step = run(_force_at_once())
    return Observations(
        law,
        _law_parameters(law, step),
        forwards,
        backwards,
        steps,
        np.array([s[0] for s in steady]),
        np.array([s[1] for s in steady]),
        *cycle,
        np.array([r.trial.level for r in loading]),
        np.array([math.nan if p is None else p for p in peaks]),
        _course(staircase),
        np.searchsorted(staircase.truth["time"], (7.0, 12.0, 17.0)) - 1,
        _course(step),
        notes,
    )


def _slow_loading(direction: int) -> Trial:
    way = "forwards" if direction > 0 else "backwards"
    return Trial(
        f"slow-loading/{way}",
        "slow-loading",
        1 if direction > 0 else 2,
        VOLTAGE,
        f"voltage ramp that loads the block {way} at {SLOW_RATE:g} N/s",
        LOAD_TO / SLOW_RATE,
        partial(_ramp, direction),
        level=direction * SLOW_RATE,
    )


def _ramp(direction: int, t: Vector) -> Vector:
    return direction * loading_voltage(SLOW_RATE, t)


def _force_at_once() -> Trial:
    """Fig. 2.19's step: the motor's force follows its voltage within 0.1 ms."""
    return Trial(
        "force-at-once/1",
        "force-at-once",
        1,
        VOLTAGE,
        f"step of the motor's force to {STEP_FORCE:g} N",
        STEP_TIME,
        _step,
        level=STEP_FORCE,
    )


def _step(t: Vector) -> Vector:
    none, all_of_it = loading_voltage(1.0, np.array([0.0, STEP_FORCE]))
    return np.where(t > 0, all_of_it - none, 0.0)


def _peak(friction: Vector, direction: int) -> Peak:
    """The largest friction before it first falls, and the least after that."""
    along = direction * friction
    highest = np.maximum.accumulate(along)
    fallen = np.flatnonzero(along < (1 - FALL) * highest)
    if not len(fallen):
        return Peak(None, float(along[-1]))
    return Peak(float(highest[fallen[0]]), float(along[fallen[0] :].min()))


def _force_step(record: TrialRecord) -> ForceStep:
    x = record.truth["x"]
    return ForceStep(record.trial.level, float(x[-1] - x[-201]))


def _steady(record: TrialRecord) -> tuple[float, float]:
    half = len(record.truth["v"]) // 2
    return float(record.truth["v"][half:].mean()), float(record.truth["friction"][half:].mean())


def _cycle(truth: Mapping[str, Vector]) -> tuple[Vector, Vector]:
    """Velocity and friction over one cycle, from the harmonics of all cycles but the first."""
    time = truth["time"]
    later = time >= CYCLE

    def basis(t: Vector) -> Vector:
        phase = 2 * np.pi / CYCLE * np.outer(t, np.arange(HARMONICS + 1))
        return np.hstack([np.cos(phase), np.sin(phase[:, 1:])])

    grid = basis(np.linspace(0.0, CYCLE, 401))
    both = np.column_stack([truth["v"][later], truth["friction"][later]])
    fitted = grid @ np.linalg.lstsq(basis(time[later]), both)[0]
    return fitted[:, 0], fitted[:, 1]


def _course(record: TrialRecord) -> Course:
    truth = record.truth
    return Course(truth["time"], truth["friction"], truth["x"])


def _law_parameters(law: str, record: TrialRecord) -> dict[str, float]:
    """Of the law alone, which come after the drive's."""
    from ..plant.ball_screw import PARAMETERS as DRIVE

    drive = {p.name for p in DRIVE} | {"voltage_limit", "current_limit"}
    names = [p.name for p in plant_kernel(law).parameters if p.name not in drive]
    return {name: record.parameters[f"{PLANT}.{name}"] for name in names}


# -- the table -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FeatureTable:
    """All laws' observations and decisions.

    Attributes
    ----------
    observations : dict of str to Observations
    cells : dict of str to dict of str to Cell
        By law and feature.
    sources : dict of str to dict of str to str
        By law and parameter: where its value comes from.
    """

    observations: dict[str, Observations]
    cells: dict[str, dict[str, Cell]]
    sources: dict[str, dict[str, str]]

    @property
    def notes(self) -> list[str]:
        """What was past its range in a trial, and makes it one not to be believed."""
        return [f"{law}: {note}" for law, seen in self.observations.items() for note in seen.notes]

    @property
    def differences(self) -> list[str]:
        """One line for each cell that is not as the thesis has it."""
        return [
            f"{law}, {_words(cell.feature)}: {cell.decision}, the thesis says {cell.thesis}; "
            f"{cell.difference}"
            for law, row in self.cells.items()
            for cell in row.values()
            if cell.agrees is False
        ]

    @property
    def named_figures(self) -> list[NamedFigure]:
        """The thesis' own figures for LuGre; empty without that law."""
        if "lugre" not in self.cells:
            return []
        return named_figures(self.cells["lugre"], self.observations["lugre"])

    @property
    def statements(self) -> list[str]:
        """What the thesis says of its four laws in words, and the numbers here."""
        return statements(self.cells, self.observations)

    def text(self) -> str:
        """The table beside the thesis', with every difference explained."""
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
        """What goes into ``features.json``."""
        return {
            "criteria": CRITERIA,
            "laws": {
                law: {
                    "parameters": self.observations[law].parameters,
                    "sources_of_parameters": self.sources[law],
                    "features": {name: _cell_dict(cell) for name, cell in row.items()},
                }
                for law, row in self.cells.items()
            },
            "differences": self.differences,
            "thesis_figures_for_lugre": [asdict(n) for n in self.named_figures],
            "statements": self.statements,
            "not_to_be_believed": self.notes,
        }

    def save(self, folder: Path | str) -> None:
        """Write ``features.json`` and Figs. 2.14 to 2.19 as PNG into `folder`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        from .feature_pictures import save_pictures

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        save_pictures(self.observations, folder)
        write_json(folder / "features.json", self.to_dict())


@dataclass(frozen=True)
class Identified:
    """Parameters of one law that were identified from records.

    Attributes
    ----------
    values : dict of str to float
        By the law's own names; those that are left out stay nominal.
    source : str
        Where they come from, in words.
    """

    values: dict[str, float]
    source: str


def feature_table(
    laws: Sequence[str] | None = None,
    processes: int = 1,
    identified: Mapping[str, Identified] | None = None,
    progress: Callable[[str], None] | None = None,
) -> FeatureTable:
    """Run all experiments on several laws and decide.

    Parameters
    ----------
    laws : sequence of str, optional
        Of `plant.LAWS`; all of them if left out.
    processes : int
        How many to share the laws among.
    identified : mapping of str to Identified, optional
        By law.
    progress : function of a text, optional
        Told how many laws are done.

    Returns
    -------
    FeatureTable

    Raises
    ------
    UnknownLaw, BadRig, IntegrationError
    """
    names = list(dict.fromkeys(laws or LAWS))
    identified = identified or {}
    unknown = [name for name in (*names, *identified) if name not in LAWS]
    if unknown:
        raise UnknownLaw(f"no friction law {unknown[0]!r}; there are {', '.join(LAWS)}")
    values = [identified[name].values if name in identified else None for name in names]
    found: list[Observations] = []

    def collect(seen: Iterable[Observations]) -> None:
        for one in seen:
            found.append(one)
            if progress:
                progress(f"{len(found)} of {len(names)} laws")

    # the last ones of the list take longest
    names.reverse()
    values.reverse()
    if processes > 1 and len(names) > 1:
        with pool(min(processes, len(names))) as workers:
            collect(workers.map(observe, names, values))
    else:
        collect(map(observe, names, values))
    found.reverse()
    return FeatureTable(
        {s.law: s for s in found},
        {s.law: judge(s) for s in found},
        {s.law: _sources(s, identified.get(s.law)) for s in found},
    )


def _sources(seen: Observations, identified: Identified | None) -> dict[str, str]:
    nominal = {p.name: p.source for p in plant_kernel(seen.law).parameters}
    own = {name: nominal[name] for name in seen.parameters}
    return own | (dict.fromkeys(identified.values, identified.source) if identified else {})


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

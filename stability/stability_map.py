"""Maps: long-term motion of a closed loop over a grid of two of its parameters.

A map is divided into chunks of cells, each computed alone and written when finished, so that an
interrupted run can continue. Cells at borders between verdicts, and a random share of the rest,
are computed again at a tenth of the tolerance; a cell whose verdict changes is undecided.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.fmu.limits import TOLERANCE_OF_MAPS, TOLERANCE_OF_MOTIONS
from ..orchestration.loop.loop import Loop, table_of
from ..orchestration.loop.run_folder import write_run
from ..orchestration.study.workers import KeptParts
from ..solver.errors import UserError
from ..solver.files import table_path, write_json, write_table
from .attractor import AGAIN as CHANGED
from .attractor import Kind, agreed
from .classify import BUDGET
from .map_plan import TABLE, Axis, Columns, MapPlan, kernel_of, read_axis, run_chunk
from .pictures import save_map_picture

if TYPE_CHECKING:
    from ..orchestration.study.workers import Workers

Progress = Callable[[int, int], None]
TIGHTER = 0.1  # share of the tolerance at which they are
AGAIN = "a tenth of the tolerance"
CHECKED = 0.05  # share of the cells away from borders that is computed again
CHUNK, LEAST_CHUNKS = 96, 40  # cells in a chunk; chunks of a small map: workers end together
PARTS = "map.parts"  # folder of the finished chunks of an unfinished map
KINDS = list(Kind)


@dataclass(frozen=True)
class MapSummary:
    """Summary of a finished map: content of ``map.json``.

    Attributes
    ----------
    verdicts : dict of str to int
        Cells of each verdict.
    checked, disagreed : int
        Cells that were computed again at a tenth of the tolerance, and those of them whose verdict
        changed.
    random_checked, random_disagreed : int
        Those of them that were drawn away from borders.
    undecided : dict of str to int
        Cells that are undecided, by the reason.
    notes : tuple of str
        Additional notes for the user on the files; not in ``map.json``.
    """

    plan: MapPlan
    verdicts: dict[str, int]
    checked: int
    disagreed: int
    random_checked: int
    random_disagreed: int
    undecided: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def figures(self) -> dict[str, Any]:
        rate = self.random_disagreed / self.random_checked if self.random_checked else None
        return {
            "fingerprint": self.plan.fingerprint(),
            "study": self.plan.described(),
            "cells": self.plan.cells,
            "verdicts": self.verdicts,
            "undecided": self.undecided,
            "budget": BUDGET,
            "checked_tighter": self.checked,
            "disagreed": self.disagreed,
            "checked_at_random": self.random_checked,
            "disagreed_at_random": self.random_disagreed,
            "disagreement_rate_at_random": rate,
        }


def plan_map(
    loop: Loop, x: str, y: str, exponents: bool = False, tolerance: float | None = None
) -> MapPlan:
    """A map of a loop over two axes, see `read_axis`, checked.

    Raises
    ------
    UserError
        If an axis is invalid, or exponents of these parts cannot be computed.
    """
    if loop.step is not None:
        raise UserError("a map solves equations; give a loop without a communication step")
    tolerance = tolerance or (TOLERANCE_OF_MAPS if exponents else TOLERANCE_OF_MOTIONS)
    axes = read_axis(x, loop), read_axis(y, loop)
    loop = _without_told(loop, axes)
    plan = MapPlan(loop, *axes, exponents, tolerance)
    plan.check()
    return plan


def _without_told(loop: Loop, axes: Sequence[Axis]) -> Loop:
    """The loop without the parameter file's values of the axes, which are varied."""
    if loop.file is None:
        return loop
    plant = {**loop.file.plant, **loop.file.found}
    controller = loop.file.controllers.get(table_of(loop.file, loop.controller), {})
    tables = {"plant": plant, "controller": controller}
    values = {"plant": dict(loop.plant_values), "controller": dict(loop.controller_values)}
    for axis in axes:
        said = tables.get(axis.side, {}).get(axis.parameter)
        if said is not None and values[axis.side].get(axis.parameter) == said.value:
            del values[axis.side][axis.parameter]
    return replace(loop, plant_values=values["plant"], controller_values=values["controller"])


def make_map(
    plan: MapPlan,
    folder: Path,
    workers: Workers,
    resume: bool = False,
    progress: Progress | None = None,
) -> MapSummary:
    """Compute a map, or finish one, and write it.

    Writes ``map.parquet`` (``map.csv`` without pyarrow), ``map.json``, ``parameters.toml`` and the
    picture into `folder`, all at once.

    Raises
    ------
    UserError
        If the folder holds another map, or the same one and `resume` is not set.
    OSError
        If the results cannot be written.
    """
    parts = KeptParts(folder / PARTS, plan.fingerprint())
    finished = _claim(plan, folder, parts, resume)
    kernel_of(plan).compile()  # takes half a second, little for thousands of runs
    if finished is not None:
        parts.discard()
        return finished
    finished = _complete(plan, parts, workers, progress)

    def write(stage: Path) -> None:
        table = table_path(parts.folder, TABLE)
        table.replace(stage / table.name)
        plan.loop.parameters().save(stage)
        save_map_picture(plan, stage)
        write_json(stage / "map.json", finished.figures())

    notes = write_run(folder, write)
    parts.discard()
    return replace(finished, notes=tuple(notes))


def _claim(plan: MapPlan, folder: Path, parts: KeptParts, resume: bool) -> MapSummary | None:
    """Use the folder for this map; return its summary if it is already finished."""
    if not (folder / "map.json").is_file():
        parts.claim("map", resume)
        return None
    try:
        found = json.loads((folder / "map.json").read_text(encoding="utf-8"))
        same = found["fingerprint"] == parts.digest
    except (ValueError, TypeError, KeyError):
        same = False
    if not same:
        raise UserError(f"{folder} contains another map; choose another folder, or remove it")
    if not resume:
        raise UserError(f"{folder} already contains this map; add --resume to continue it")
    again, drawn = ("checked_tighter", "disagreed"), ("checked_at_random", "disagreed_at_random")
    try:
        figures = [found[name] for name in ("verdicts", *again, *drawn, "undecided")]
    except KeyError as error:
        raise UserError(f"{folder / 'map.json'} lacks {error}; remove the folder") from None
    return MapSummary(plan, *figures)


def border_cells(verdicts: npt.NDArray[np.int8]) -> npt.NDArray[np.int64]:
    """Flat indices of the cells that have a neighbour of another verdict."""
    edge = np.zeros(verdicts.shape, dtype=bool)
    across, along = verdicts[:, 1:] != verdicts[:, :-1], verdicts[1:] != verdicts[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= along
    edge[:-1] |= along
    return np.flatnonzero(edge)


def _complete(
    plan: MapPlan, parts: KeptParts, workers: Workers, progress: Progress | None
) -> MapSummary:
    """Compute what is missing, then make one table of all, among the parts."""
    plain = _chunks("c0", range(plan.cells), plan)
    _compute(plan, parts, plain, 1.0, workers, progress)
    codes: list[int] = []
    reasons: dict[int, str] = {}
    for columns in _columns(parts, plain):
        codes += [KINDS.index(Kind(v)) for v in columns["verdict"]]
        reasons |= {c: r for c, r in zip(columns["cell"], columns["reason"], strict=True) if r}
    verdicts = np.array(codes, dtype=np.int8)
    border = border_cells(verdicts.reshape(plan.y.count, plan.x.count))
    random = np.random.default_rng(plan.seed)
    away = np.setdiff1d(np.arange(plan.cells), border)
    some = np.sort(random.choice(away, math.ceil(CHECKED * len(away)), replace=False)).tolist()
    again = _chunks("t0", border.tolist(), plan) | _chunks("t1", some, plan)
    _compute(plan, parts, again, TIGHTER, workers, progress)
    checked: set[int] = set()
    changed: dict[int, str] = {}
    for columns in _columns(parts, again):
        for cell, verdict in zip(columns["cell"], columns["verdict"], strict=True):
            kind, finer = KINDS[verdicts[cell]], Kind(verdict)
            both = agreed(kind, finer)
            if both is None:
                changed[cell] = f"{CHANGED}: {kind}, then {finer}"
            verdicts[cell] = KINDS.index(both or Kind.UNDECIDED)
            checked.add(cell)

    def pieces() -> Iterator[Columns]:
        for columns in _columns(parts, plain):
            cells, why = columns.pop("cell"), columns["reason"]
            columns["verdict"] = [KINDS[verdicts[cell]].value for cell in cells]
            columns["reason"] = [changed.get(c, r) for c, r in zip(cells, why, strict=True)]
            columns["checked"] = [cell in checked for cell in cells]
            yield columns

    write_table(parts.folder, TABLE, pieces())
    found, counts = np.unique(verdicts, return_counts=True)
    return MapSummary(
        plan,
        {KINDS[k].value: int(n) for k, n in zip(found, counts, strict=True)},
        len(checked),
        len(changed),
        len(some),
        len(changed.keys() & set(some)),
        dict(Counter(reason.partition(":")[0] for reason in (reasons | changed).values())),
    )


def _chunks(head: str, cells: Sequence[int], plan: MapPlan) -> dict[str, Sequence[int]]:
    """Names of chunks and the cells in them, in order."""
    width = len(str(plan.cells))
    size = min(CHUNK, max(2, plan.cells // LEAST_CHUNKS))
    starts = range(0, len(cells), size)
    return {f"{head}-{start:0{width}d}.json": cells[start : start + size] for start in starts}


def _columns(parts: KeptParts, names: Mapping[str, Any]) -> Iterator[Columns]:
    """The columns of finished chunks, with one chunk in memory at a time."""
    for name in names:
        columns: Columns | None = parts.read(name)
        if columns is None:
            place = parts.folder / name
            raise UserError(f"{place} is missing: another command has finished this map")
        yield columns


def _compute(
    plan: MapPlan,
    parts: KeptParts,
    chunks: Mapping[str, Sequence[int]],
    share: float,
    workers: Workers,
    progress: Progress | None,
) -> None:
    total, done = sum(map(len, chunks.values())), 0
    jobs = {name: (plan, cells, share) for name, cells in chunks.items()}
    for _, columns in parts.results(
        jobs, run_chunk, workers, lambda name, found: bool(found["cell"] == list(chunks[name]))
    ):
        done += len(columns["cell"])
        if progress:
            progress(done, total)

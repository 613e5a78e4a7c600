"""Maps: long-term motion of a closed loop over a grid of two of its parameters.

A map is divided into chunks of cells, each computed alone and written when finished, so that an
interrupted run can continue. Cells at borders between verdicts, and a random share of the rest,
are computed again at a tenth of the tolerance; a cell whose verdict changes is undecided.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..orchestration.fmu.limits import TOLERANCE_OF_MAPS, TOLERANCE_OF_MOTIONS
from ..orchestration.loop.loop import Loop, table_of
from ..orchestration.loop.run_folder import write_run
from ..orchestration.study.workers import KeptParts
from ..solver.errors import UserError
from ..solver.files import write_json
from ..solver.tables import table_path
from .attractor import Kind
from .cell import run_chunk
from .map_pictures import save_map_picture
from .map_plan import Axis, MapPlan, kernel_of, read_axis
from .store import (
    PARTS,
    TABLE,
    VERDICT_CODE,
    MapSummary,
    chunks_of,
    claim_folder,
    load,
    merge_chunks,
    verdict_codes,
)

if TYPE_CHECKING:
    from ..orchestration.study.workers import Workers


Progress = Callable[[int, int], None]
TIGHTER = 0.1  # share of the tolerance at which they are
AGAIN = "a tenth of the tolerance"
CHECKED = 0.05  # share of the cells away from borders that is computed again


def plan_map(
    loop: Loop, x: str, y: str, exponents: bool = False, tolerance: float | None = None
) -> MapPlan:
    """A map of a loop over two axes, see `read_axis`, checked.

    Raises
    ------
    UserError
        If an axis is invalid, or exponents of these parts cannot be computed.
    BadParameter, UserError
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
    if loop.told is None:
        return loop
    plant = {**loop.told.plant, **loop.told.found}
    controller = loop.told.controllers.get(table_of(loop.told, loop.controller), {})
    told = {"plant": plant, "controller": controller}
    values = {"plant": dict(loop.plant_values), "controller": dict(loop.controller_values)}
    for axis in axes:
        said = told.get(axis.side, {}).get(axis.parameter)
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
    finished = claim_folder(plan, folder, parts, resume)
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
    plain = chunks_of(plan.cells, "c", [range(plan.cells)])
    _compute(plan, parts, plain, 1.0, workers, progress)
    codes: list[int] = []
    reasons: dict[int, str] = {}
    for name in plain:
        columns = load(parts, name)
        codes += verdict_codes(columns["verdict"])
        reasons |= {c: r for c, r in zip(columns["cell"], columns["reason"], strict=True) if r}
    verdicts = np.array(codes, dtype=np.int8)
    border = border_cells(verdicts.reshape(plan.y.count, plan.x.count))
    random = np.random.default_rng(plan.seed)
    away = np.setdiff1d(np.arange(plan.cells), border)
    some = np.sort(random.choice(away, math.ceil(CHECKED * len(away)), replace=False))
    again = chunks_of(plan.cells, "t", [border.tolist(), some.tolist()])
    _compute(plan, parts, again, TIGHTER, workers, progress)
    kinds = list(Kind)
    checked: dict[int, Kind] = {}
    for name in again:
        columns = load(parts, name)
        checked |= dict(zip(columns["cell"], map(Kind, columns["verdict"]), strict=True))
    changed: dict[int, str] = {}
    for cell, finer_kind in checked.items():
        kind = kinds[verdicts[cell]]
        if {kind, finer_kind} == {Kind.CREEPING, Kind.LINE}:  # a creep may come to rest later
            verdicts[cell] = VERDICT_CODE[Kind.CREEPING]
        elif kind is not finer_kind:
            verdicts[cell] = VERDICT_CODE[Kind.UNDECIDED]
            changed[cell] = f"{AGAIN} changes the verdict: {kind}, then {finer_kind}"
    reasons |= changed
    by_chance = set(some.tolist())
    merge_chunks(parts, list(plain), [kinds[k].value for k in verdicts], checked, changed)
    found, counts = np.unique(verdicts, return_counts=True)
    return MapSummary(
        plan,
        {kinds[k].value: int(n) for k, n in zip(found, counts, strict=True)},
        len(checked),
        len(changed),
        len(by_chance),
        len(changed.keys() & by_chance),
        dict(Counter(reason.partition(":")[0] for reason in reasons.values())),
    )


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

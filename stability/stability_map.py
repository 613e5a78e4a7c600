"""Maps: what becomes of a closed loop over a grid of two of its parameters.

A map is cut into chunks of cells, each computed alone and written as soon as it is there, so that a
killed run goes on where it was. Cells at borders between verdicts, and a random share of the rest,
are computed again at a tenth of the tolerance; what changes its verdict there is undecided.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.memory import check_memory
from ..orchestration.run_folder import write_run
from ..orchestration.whole_loop import loop_kernel
from ..solver.core import System
from ..solver.files import write_atomically, write_json
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..solver.spectrum import follow, follow_returns
from .attractor import Kind, Motion, judge

if TYPE_CHECKING:
    import pyarrow as pa

    from ..orchestration.workers import Workers

Vector = npt.NDArray[np.float64]
Columns = dict[str, list[Any]]
Progress = Callable[[int, int], None]

CHUNK = 96  # cells
TOLERANCE = 1e-8
TIGHTER = 0.1
CHECKED = 0.05  # share of the cells away from borders that is computed again
LAST = 0.1  # share of the run over which the oscillation is measured
HALVINGS = 8  # of a border's width
PER_CELL = 1000  # bytes of a cell while the map is merged and drawn, measured
MOST_BYTES = 10**30  # counts on the command line have any number of digits
PARTS = "map.parts"  # folder of what is done while the map is not
TABLE, BORDERS = "map.parquet", "borders.csv"
SETPOINT, DESIGN = "setpoint", "design"
_BITS = 1.0 / math.log(2.0)


class BadMap(ValueError):
    """A map that makes no sense; the message says what was got and what was expected."""


@lru_cache(maxsize=8)
def _linear(low: float, high: float, count: int) -> Vector:
    """One array for all cells of a map."""
    return np.linspace(low, high, count)


@dataclass(frozen=True)
class Axis:
    """One side of a map.

    Parameters
    ----------
    name : str
        As the user gave it; the name of the column.
    side : {"plant", "controller", "setpoint", "design"}
        Whose parameter it is. ``design``: of the plant on which the NCTF controller is designed.
    parameter : str
    low, high : float
    count : int
        Points, both ends included.
    """

    name: str
    side: str
    parameter: str
    low: float
    high: float
    count: int

    def values(self) -> Vector:
        return _linear(self.low, self.high, self.count)

    def value(self, number: int) -> float:
        return float(self.values()[number])


@dataclass(frozen=True)
class MapStudy:
    """Everything that decides a map.

    Attributes
    ----------
    plant_values, controller_values : dict of str to float
        Parameters and initial states that are not nominal, the same in all cells.
    stop : float
        Length of each run [s].
    exponents : bool
        Whether to compute the largest exponent of each cell.
    """

    controller: str
    x: Axis
    y: Axis
    plant: str = "plant"
    plant_values: Mapping[str, float] = field(default_factory=dict)
    controller_values: Mapping[str, float] = field(default_factory=dict)
    setpoint: float = 0.08
    stop: float = 20.0
    exponents: bool = False
    tolerance: float = TOLERANCE
    seed: int = 0

    @property
    def cells(self) -> int:
        return self.x.count * self.y.count

    def check(self) -> None:
        """Make sure that the two sides differ and that all values are in range.

        Raises
        ------
        BadMap
        NotEnoughMemory
            If the tables and pictures of so many cells do not fit.
        """
        check_memory(
            float(min(PER_CELL * self.cells, MOST_BYTES)),
            f"{self.x.count} x {self.y.count} cells need",
            "map fewer points, or one part after another",
        )
        if _kernel(self).discrete:
            raise BadMap(
                f"{self.controller} holds its command between samples; maps of sampled loops are "
                "not computed here"
            )
        if (self.x.side, self.x.parameter) == (self.y.side, self.y.parameter):
            raise BadMap(f"--x and --y are both {self.x.parameter}; expected two parameters")
        ranges = {p.name: (p.minimum, p.maximum) for p in _kernel(self).parameters}
        for axis in (self.x, self.y):
            head = CONTROLLER if axis.side == "controller" else PLANT
            low, high = ranges.get(head + axis.parameter, (-math.inf, math.inf))
            if axis.low < low or axis.high > high:
                raise BadMap(
                    f"{axis.name} runs from {axis.low:g} to {axis.high:g}, expected values within "
                    f"[{low:g}, {high:g}]"
                )

    def fingerprint(self) -> str:
        """Hash of the study and of the equations that it is about."""
        text = json.dumps(asdict(self), sort_keys=True) + _kernel(self).module
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def point(self, cell: int) -> tuple[float, float]:
        """Values of x and y in a cell; x runs fastest."""
        row, column = divmod(cell, self.x.count)
        return self.x.value(column), self.y.value(row)


def read_axis(text: str, plant: str, controller: str) -> Axis:
    """An axis from ``NAME=LOW:HIGH:COUNT``.

    NAME is a parameter or initial state (``x_start``) of the controller or the plant, with
    ``controller.`` or ``plant.`` before it where both have it, ``setpoint``, or ``design.NAME``.

    Raises
    ------
    BadMap
    """
    name, equals, numbers = text.partition("=")
    parts = numbers.split(":")
    if not equals or not name or len(parts) != 3:
        raise BadMap(f"{text!r} is not of the form NAME=LOW:HIGH:COUNT")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise BadMap(f"{text!r}: expected two numbers and a whole number after the =") from None
    if not (math.isfinite(low) and math.isfinite(high)):
        raise BadMap(f"{text!r}: the bounds must be finite")
    if not low < high:
        raise BadMap(f"{text!r}: the bounds are {low:g} and {high:g}, expected the lower one first")
    if count < 2:
        raise BadMap(f"{text!r}: {count} points, expected 2 or more")
    side, parameter = _owner(name, plant, controller)
    return Axis(name, side, parameter, low, high, count)


def _owner(name: str, plant: str, controller: str) -> tuple[str, str]:
    import difflib

    if name == SETPOINT:
        return SETPOINT, SETPOINT
    kernel = loop_kernel(plant, controller)
    known = [p.name for p in kernel.parameters] + [f"{s.name}_start" for s in kernel.states]
    theirs = [n.removeprefix(CONTROLLER) for n in known if n.startswith(CONTROLLER)]
    ours = [n.removeprefix(PLANT) for n in known if n.startswith(PLANT)]
    side, dot, own = name.partition(".")
    if dot and side == DESIGN:
        if controller != "nctf":
            raise BadMap(f"{name!r}: only nctf is designed on a plant, and this is {controller}")
        if own in ours:
            return DESIGN, own
    elif dot and side in ("plant", "controller"):
        if own in (ours if side == "plant" else theirs):
            return side, own
    elif name in theirs and name in ours:
        raise BadMap(f"both sides have {name!r}: say controller.{name} or plant.{name}")
    elif name in theirs:
        return "controller", name
    elif name in ours:
        return "plant", name
    near = difflib.get_close_matches(own if dot else name, [*theirs, *ours], n=3, cutoff=0.5)
    hint = f"; nearest: {', '.join(near)}" if near else ""
    raise BadMap(
        f"neither {controller} nor {plant} has {name!r}{hint}; {controller} has "
        f"{', '.join(theirs) or 'none'}; {plant} has {', '.join(ours)}"
    )


# -- one cell -----------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _loop(plant: str, controller: str) -> Kernel:
    return loop_kernel(plant, controller)


def _kernel(study: MapStudy) -> Kernel:
    return _loop(study.plant, study.controller)


def _model(
    study: MapStudy, x: float, y: float, tolerance: float, system: System | None = None
) -> Model:
    values = {PLANT + k: v for k, v in study.plant_values.items()}
    values |= {CONTROLLER + k: v for k, v in study.controller_values.items()}
    setpoint = study.setpoint
    designed: dict[str, float] = {}
    for axis, value in ((study.x, x), (study.y, y)):
        if axis.side == SETPOINT:
            setpoint = value
        elif axis.side == DESIGN:
            designed[axis.parameter] = value
        else:
            head = PLANT if axis.side == "plant" else CONTROLLER
            values[head + axis.parameter] = value
    if designed:
        from ..controllers.nctf import design

        found = design({**study.plant_values, **designed}).parameters()
        values = {CONTROLLER + k: v for k, v in found.items()} | values
    model = Model(_kernel(study), values, tolerance, system)
    for signal in _kernel(study).inputs:
        if signal.role == "reference":
            model.set_input(signal.name, setpoint)
    return model


@dataclass(frozen=True)
class Cell:
    """What becomes of one loop.

    Attributes
    ----------
    verdict : Kind
    final_error : float
        Position minus set-point at the end of the run [m].
    lambda1 : float
        Largest finite-time exponent [bits/s]; NaN where not asked for.
    oscillation : float
        Half the range of the position over the last tenth of the run [m].
    """

    verdict: Kind
    final_error: float
    lambda1: float
    oscillation: float


def run_cell(
    study: MapStudy, x: float, y: float, tolerance: float, system: System | None = None
) -> Cell:
    """Run one loop of a map, with the equations of a cell before it if they are given."""
    try:
        model = _model(study, x, y, tolerance, system)
    except ValueError:  # no controller can be designed on this plant
        return Cell(Kind.UNDECIDED, math.nan, math.nan, math.nan)
    setpoint = next(
        (model.u[k] for k, i in enumerate(model.kernel.inputs) if i.role == "reference"), 0.0
    )
    position = next(k for k, s in enumerate(model.kernel.states) if s.name == PLANT + "x")
    begin = (1.0 - LAST) * study.stop
    growth = math.nan
    if study.exponents:
        run = follow(model, np.array([0.0, begin]), count=1)
        lost, away, at = run.failure, run.ran_away, begin
        frame, growth = run.frame, float(run.growth[-1, 0])
    else:
        passes = follow_returns(model, 0.0, begin, 0, np.inf, 0)
        lost, away, at = passes.failure, passes.ran_away, passes.end
    if not lost:
        last = model.x.copy()
        mode = model.u.copy()
        passes = follow_returns(model, begin, study.stop, position, np.inf, 1)
        lost, away, at = passes.failure, passes.ran_away, passes.end
        if study.exponents and not lost:
            end = model.x.copy(), model.u.copy()
            model.x[:], model.u[:] = last, mode
            tail = follow(model, np.array([begin, study.stop]), count=1, frame=frame)
            growth += float(tail.growth[-1, 0])
            model.x[:], model.u[:] = end
    if lost:
        kind = Kind.DIVERGES if away else Kind.UNDECIDED
        return Cell(kind, math.nan, growth / at * _BITS, math.nan)
    error = float(model.x[position] - setpoint)
    swing = 0.5 * float(passes.high[position] - passes.low[position])
    motion: Motion = judge(model, study.stop, study.stop, exponents=False, rounds=1)
    return Cell(motion.kind, error, growth / study.stop * _BITS, swing)


def run_chunk(study: MapStudy, cells: Sequence[int], tolerance: float) -> Columns:
    """Run some cells; their columns, as they go into the table."""
    columns: Columns = {
        "cell": list(cells),
        study.x.name: [],
        study.y.name: [],
        "verdict": [],
        "final_error": [],
        "lambda1_bits_per_s": [],
        "oscillation_amplitude": [],
    }
    system = _kernel(study).system()
    for cell in cells:
        x, y = study.point(cell)
        found = run_cell(study, x, y, tolerance, system)
        row = (x, y, found.verdict.value, found.final_error, found.lambda1, found.oscillation)
        for name, value in zip(list(columns)[1:], row, strict=True):
            unknown = isinstance(value, float) and math.isnan(value)
            columns[name].append(None if unknown else value)
    return columns


# -- the whole map ------------------------------------------------------------------------------


@dataclass(frozen=True)
class MapSummary:
    """What a finished map says of itself: everything of ``map.json``.

    Attributes
    ----------
    verdicts : dict of str to int
        Cells of each verdict.
    checked, disagreed : int
        Cells that were computed again at a tenth of the tolerance, and those of them whose verdict
        it changed.
    borders : int
        Borders found by refinement; 0 without.
    notes : tuple of str
        What the user should know beside, of the files; not in ``map.json``.
    """

    study: MapStudy
    verdicts: dict[str, int]
    checked: int
    disagreed: int
    random_checked: int
    random_disagreed: int
    borders: int
    notes: tuple[str, ...] = ()

    def figures(self) -> dict[str, Any]:
        rate = self.random_disagreed / self.random_checked if self.random_checked else None
        return {
            "fingerprint": self.study.fingerprint(),
            "study": asdict(self.study),
            "cells": self.study.cells,
            "verdicts": self.verdicts,
            "checked_tighter": self.checked,
            "disagreed": self.disagreed,
            "checked_at_random": self.random_checked,
            "disagreed_at_random": self.random_disagreed,
            "disagreement_rate_at_random": rate,
            "borders": self.borders,
        }


def make_map(
    study: MapStudy,
    folder: Path,
    workers: Workers,
    resume: bool = False,
    refine: bool = False,
    progress: Progress | None = None,
    beside: Callable[[Path], object] | None = None,
) -> MapSummary:
    """Compute a map, or finish one, and write it.

    Writes ``map.parquet``, ``map.json`` and ``map.png``, with `refine` also
    ``borders.csv``, into `folder`, all at once. `beside` may add files to the folder it is given.

    Raises
    ------
    BadMap
        If the folder holds another map, or one like it and `resume` is not asked for.
    OSError
        If the results cannot be written.
    """
    parts = folder / PARTS
    finished = _claim(study, folder, resume)
    _kernel(study).compile()  # thousands of runs are worth half a second
    new = finished is None
    if finished is None:
        finished = _complete(study, parts, workers, progress)
    borders = None
    if refine and (new or not (folder / BORDERS).is_file()):
        table = _load(parts, TABLE) if new else _finished(folder)
        verdicts = np.array(_codes(table.column("verdict").to_pylist()), dtype=np.int8)
        borders, found = _refine(study, verdicts, workers, progress)
        finished = replace(finished, borders=found)

    def write(stage: Path) -> None:
        if new:
            from .map_pictures import save_map_picture

            (parts / TABLE).replace(stage / TABLE)
            save_map_picture(study, stage)
            if beside:
                beside(stage)
        if borders is not None:
            (stage / BORDERS).write_text(borders, encoding="utf-8")
        write_json(stage / "map.json", finished.figures())

    notes: list[str] = []
    if new or borders is not None:
        notes = write_run(folder, write, adds=not new)
    if parts.is_dir():
        for part in parts.iterdir():
            part.unlink()
        parts.rmdir()
    return replace(finished, notes=tuple(notes))


def _complete(
    study: MapStudy, parts: Path, workers: Workers, progress: Progress | None
) -> MapSummary:
    """Compute what is missing, then make one table of all, among the parts."""
    plain = _chunks(study.cells, "c", [range(study.cells)])
    _compute(study, parts, plain, study.tolerance, workers, progress)
    verdicts = np.array(
        [k for name in plain for k in _codes(_load(parts, name).column("verdict").to_pylist())],
        dtype=np.int8,
    )
    border = _border_cells(verdicts.reshape(study.y.count, study.x.count))
    random = np.random.default_rng(study.seed)
    away = np.setdiff1d(np.arange(study.cells), border)
    some = np.sort(random.choice(away, math.ceil(CHECKED * len(away)), replace=False))
    again = _chunks(study.cells, "t", [border.tolist(), some.tolist()])
    _compute(study, parts, again, study.tolerance * TIGHTER, workers, progress)
    checked: dict[int, int] = {}
    for name in again:
        table = _load(parts, name)
        codes = _codes(table.column("verdict").to_pylist())
        checked |= dict(zip(table.column("cell").to_pylist(), codes, strict=True))
    changed = {cell for cell, code in checked.items() if code != verdicts[cell]}
    by_chance = set(some.tolist())
    _merge(parts, list(plain), checked, changed)
    verdicts[sorted(changed)] = _CODE[Kind.UNDECIDED]
    kinds = list(Kind)
    found, counts = np.unique(verdicts, return_counts=True)
    return MapSummary(
        study,
        {kinds[k].value: int(n) for k, n in zip(found, counts, strict=True)},
        len(checked),
        len(changed),
        len(by_chance),
        len(changed & by_chance),
        0,
    )


_CODE = {kind: k for k, kind in enumerate(Kind)}


def _codes(verdicts: list[str]) -> list[int]:
    return [_CODE[Kind(v)] for v in verdicts]


# keys of map.json in the order of the summary's attributes
SUMMARY = (
    "verdicts",
    "checked_tighter",
    "disagreed",
    "checked_at_random",
    "disagreed_at_random",
    "borders",
)


def _claim(study: MapStudy, folder: Path, resume: bool) -> MapSummary | None:
    """Take the folder for this map; what it says of itself where it is finished already."""
    own = study.fingerprint()
    finished = None
    for place in (folder / "map.json", folder / PARTS / "study.json"):
        if not place.is_file():
            continue
        try:
            found = json.loads(place.read_text(encoding="utf-8"))
            same = found["fingerprint"] == own
        except (ValueError, TypeError, KeyError):
            same = False
        if not same:
            raise BadMap(f"{folder} holds another map; choose another folder, or remove it")
        if not resume:
            raise BadMap(f"{folder} holds this map already; add --resume to go on with it")
        if "verdicts" in found:
            finished = found
    if finished is not None:
        try:
            return MapSummary(study, *(finished[name] for name in SUMMARY))
        except KeyError as error:
            raise BadMap(f"{folder / 'map.json'} lacks {error}; remove the folder") from None
    if resume and not (folder / PARTS).is_dir():
        raise BadMap(f"{folder} holds no map to go on with; leave out --resume to begin one")
    (folder / PARTS).mkdir(parents=True, exist_ok=True)
    write_json(folder / PARTS / "study.json", {"fingerprint": own})
    return None


def _chunks(cells: int, head: str, groups: Sequence[Sequence[int]]) -> dict[str, Sequence[int]]:
    """Names of chunks and the cells in them, in order."""
    width = len(str(cells))
    named = {}
    for k, group in enumerate(groups):
        for start in range(0, len(group), CHUNK):
            named[f"{head}{k}-{start:0{width}d}.parquet"] = group[start : start + CHUNK]
    return named


def _compute(
    study: MapStudy,
    parts: Path,
    chunks: Mapping[str, Sequence[int]],
    tolerance: float,
    workers: Workers,
    progress: Progress | None,
) -> None:
    missing = {name: cells for name, cells in chunks.items() if not _whole(parts / name, cells)}
    total = sum(map(len, chunks.values()))
    done = total - sum(map(len, missing.values()))
    tasks = ((name, (study, cells, tolerance)) for name, cells in missing.items())
    for name, columns in workers.map(run_chunk, tasks):
        write_atomically(parts / name, _parquet(columns))
        done += len(columns["cell"])
        if progress:
            progress(done, total)


def _whole(part: Path, cells: Sequence[int]) -> bool:
    """Whether a chunk is there and holds its cells; a disk may have lost the end of it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return bool(pq.read_table(part)["cell"].to_pylist() == list(cells))
    except (OSError, pa.ArrowInvalid):
        return False


def _schema(columns: Columns) -> pa.Schema:
    import pyarrow as pa

    types = {"cell": pa.int64(), "verdict": pa.string(), "checked": pa.bool_()}
    return pa.schema([(name, types.get(name, pa.float64())) for name in columns])


def _parquet(columns: Columns) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(columns, schema=_schema(columns)), sink)
    return bytes(sink.getvalue())


def _load(parts: Path, name: str) -> pa.Table:
    import pyarrow.parquet as pq

    return pq.read_table(parts / name)


def _finished(folder: Path) -> pa.Table:
    import pyarrow as pa

    try:
        return _load(folder, "map.parquet")
    except (OSError, pa.ArrowInvalid) as error:
        raise BadMap(
            f"{folder / 'map.parquet'} is damaged; remove the folder and compute the map again"
        ) from error


def _border_cells(verdicts: npt.NDArray[np.int8]) -> npt.NDArray[np.int64]:
    """Flat indices of the cells that have a neighbour of another verdict."""
    edge = np.zeros(verdicts.shape, dtype=bool)
    across, along = verdicts[:, 1:] != verdicts[:, :-1], verdicts[1:] != verdicts[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= along
    edge[:-1] |= along
    return np.flatnonzero(edge)


def _merge(
    parts: Path,
    names: list[str],
    checked: Mapping[int, int],
    changed: set[int],
) -> None:
    """One table of all chunks, in the order of the cells, a chunk in memory at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    half = parts / (TABLE + ".part")
    writer = None
    for name in names:
        columns = _load(parts, name).to_pydict()
        cells = columns.pop("cell")
        columns["verdict"] = [
            Kind.UNDECIDED.value if cell in changed else verdict
            for cell, verdict in zip(cells, columns["verdict"], strict=True)
        ]
        columns["checked"] = [cell in checked for cell in cells]
        schema = _schema(columns)
        writer = writer or pq.ParquetWriter(half, schema)
        writer.write_table(pa.table(columns, schema=schema))
    if writer:
        writer.close()
    half.replace(parts / TABLE)


# -- borders ------------------------------------------------------------------------------------


def run_border(study: MapStudy, task: tuple[bool, float, float, float, str, str]) -> dict[str, Any]:
    """Halve the distance between two cells of different verdict until it is small."""
    along_x, fixed, low, high, below, above = task
    others = []
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        point = (middle, fixed) if along_x else (fixed, middle)
        found = run_cell(study, *point, study.tolerance).verdict.value
        if found == below:
            low = middle
        else:
            high = middle
            if found != above:
                others.append(found)
                above = found
    position = 0.5 * (low + high)
    return {
        study.x.name: position if along_x else fixed,
        study.y.name: fixed if along_x else position,
        "along": study.x.name if along_x else study.y.name,
        "width": high - low,
        "below": below,
        "above": above,
    }


def _border_tasks(study: MapStudy, verdicts: npt.NDArray[np.int8]) -> Iterator[tuple[str, Any]]:
    kinds = [k.value for k in Kind]
    grid = verdicts.reshape(study.y.count, study.x.count)
    xs, ys = study.x.values(), study.y.values()
    for j, i in zip(*np.nonzero(grid[:, 1:] != grid[:, :-1]), strict=True):
        names = kinds[grid[j, i]], kinds[grid[j, i + 1]]
        yield f"x{j}-{i}", (study, (True, float(ys[j]), float(xs[i]), float(xs[i + 1]), *names))
    for j, i in zip(*np.nonzero(grid[1:] != grid[:-1]), strict=True):
        names = kinds[grid[j, i]], kinds[grid[j + 1, i]]
        yield f"y{j}-{i}", (study, (False, float(xs[i]), float(ys[j]), float(ys[j + 1]), *names))


def _refine(
    study: MapStudy,
    verdicts: npt.NDArray[np.int8],
    workers: Workers,
    progress: Progress | None,
) -> tuple[str, int]:
    """The table of borders as text, and how many there are."""
    tasks = list(_border_tasks(study, verdicts))
    rows = {}
    for name, row in workers.map(run_border, iter(tasks)):
        rows[name] = row
        if progress:
            progress(len(rows), len(tasks))
    header = [study.x.name, study.y.name, "along", "width", "below", "above"]
    lines = [",".join(header)]
    for name, _ in tasks:
        row = rows[name]
        lines.append(
            ",".join(f"{row[c]:.12g}" if isinstance(row[c], float) else row[c] for c in header)
        )
    return "\n".join(lines) + "\n", len(tasks)


# -- the stuck regime ---------------------------------------------------------------------------


def stuck_growth(study: MapStudy, x: float, y: float) -> float:
    """Fastest growth of the loop while stuck: bristles at rest move with the block [1/s].

    The friction law's smooth sign is taken as one: its argument is made large while the velocity
    goes to zero. Of the eigenvalues the one that is zero, for deflection without motion, is left
    out; the sign of the largest real part is Routh and Hurwitz's criterion.
    """
    model = _model(study, x, y, study.tolerance)
    names = [p.name for p in model.kernel.parameters]
    for sharpness in (PLANT + "Kv", CONTROLLER + "Kv"):
        if sharpness in names:
            model.p[names.index(sharpness)] = 1e16
    state = np.zeros(len(model.x))
    states = [s.name for s in model.kernel.states]
    state[states.index(PLANT + "v")] = 1e-10
    state[states.index(PLANT + "x")] = study.setpoint
    nominal = np.array([s.nominal for s in model.kernel.states])
    a = model.jacobian(0.0, state) * nominal[None, :] / nominal[:, None]
    values = np.linalg.eigvals(a)
    keep = np.ones(len(values), dtype=bool)
    keep[int(np.argmin(np.abs(values)))] = False
    return float(values[keep].real.max())


def axis_unit(study: MapStudy, name: str) -> str:
    """The unit of an axis, for its label."""
    axis = study.x if name == study.x.name else study.y
    if axis.side == SETPOINT:
        return "m"
    head = CONTROLLER if axis.side == "controller" else PLANT
    kernel = _kernel(study)
    units = {p.name: p.unit for p in kernel.parameters}
    units |= {f"{s.name}_start": s.unit for s in kernel.states}
    return units[head + axis.parameter]

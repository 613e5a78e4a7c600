"""A map's files: a table for each chunk during the computation, one for all at the end."""

from __future__ import annotations

import json
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..orchestration.study.workers import KeptParts
from ..solver.errors import UserError
from ..solver.tables import write_table
from .attractor import Kind
from .budget import BUDGET
from .map_plan import MapPlan

Columns = dict[str, list[Any]]
CHUNK, LEAST_CHUNKS = 96, 8  # cells in a chunk; chunks of a small map, so that all workers have one
PARTS = "map.parts"  # folder of the finished chunks of an unfinished map
TABLE = "map"


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


VERDICT_CODE = {kind: k for k, kind in enumerate(Kind)}


def verdict_codes(verdicts: list[str]) -> list[int]:
    return [VERDICT_CODE[Kind(v)] for v in verdicts]


# keys of map.json in the order of the summary's attributes
SUMMARY = (
    "verdicts",
    "checked_tighter",
    "disagreed",
    "checked_at_random",
    "disagreed_at_random",
)


def claim_folder(plan: MapPlan, folder: Path, parts: KeptParts, resume: bool) -> MapSummary | None:
    """Use the folder for this map; return its summary if it is already finished."""
    if not (folder / "map.json").is_file():
        parts.claim("map", resume, UserError)
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
    try:
        figures = (found[name] for name in SUMMARY)
        return replace(MapSummary(plan, *figures), undecided=found.get("undecided", {}))
    except KeyError as error:
        raise UserError(f"{folder / 'map.json'} lacks {error}; remove the folder") from None


def chunks_of(cells: int, head: str, groups: Sequence[Sequence[int]]) -> dict[str, Sequence[int]]:
    """Names of chunks and the cells in them, in order."""
    width = len(str(cells))
    size = min(CHUNK, max(2, cells // LEAST_CHUNKS))
    named = {}
    for k, group in enumerate(groups):
        for start in range(0, len(group), size):
            named[f"{head}{k}-{start:0{width}d}.json"] = group[start : start + size]
    return named


def load(parts: KeptParts, name: str) -> Columns:
    """The columns of a finished chunk."""
    columns: Columns | None = parts.read(name)
    if columns is None:
        raise UserError(f"{parts.folder / name} is missing: another command has finished this map")
    return columns


def merge_chunks(
    parts: KeptParts,
    names: list[str],
    verdicts: Sequence[str],
    checked: Container[int],
    changed: Mapping[int, str],
) -> None:
    """Write one table of all chunks, in the order of the cells, with one chunk in memory at a time.

    Parameters
    ----------
    verdicts : sequence of str
        Of all cells, after some were computed again.
    checked : container of int
        Cells that were computed again.
    changed : mapping of int to str
        Reason for each of them whose verdict changed and is now undecided.
    """

    def pieces() -> Iterator[Columns]:
        for name in names:
            columns = load(parts, name)
            cells = columns.pop("cell")
            columns["verdict"] = [verdicts[cell] for cell in cells]
            columns["reason"] = [
                changed.get(cell, reason)
                for cell, reason in zip(cells, columns["reason"], strict=True)
            ]
            columns["checked"] = [cell in checked for cell in cells]
            yield columns

    write_table(parts.folder, TABLE, pieces())

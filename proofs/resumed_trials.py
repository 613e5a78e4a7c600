"""Trials of a proof in several processes; each is kept in a file, from which a call can go on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

Trial = TypeVar("Trial")
Row = TypeVar("Row")


def read_rows(path: Path, code: str, keys: set[str], row: Callable[..., Row]) -> list[Row]:
    """The trials of these keys that an earlier call of the same code has written.

    Parameters
    ----------
    row : callable
        Makes a row of the fields that were written.
    """
    if not path.exists():
        return []
    read = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]
    return [row(**r["row"]) for r in read if r["code"] == code and r["row"]["key"] in keys]


def run_all(
    trials: Sequence[Trial], run: Callable[[Trial], Any], workers: int, path: Path, code: str
) -> Iterator[Any]:
    """The trials' rows, dataclasses, as they come; each is added to the file."""
    with (
        path.open("a", encoding="utf-8") as file,
        ProcessPoolExecutor(max_workers=workers) as pool,
    ):
        for future in as_completed([pool.submit(run, t) for t in trials]):
            row = future.result()
            file.write(json.dumps({"code": code, "row": asdict(row)}) + "\n")
            file.flush()
            yield row

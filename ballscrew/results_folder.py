"""The folder of ``--out``: made before the work, written after it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from .console import print_notes
from .solver.errors import UserError
from .supervision import tell, tell_folder

T = TypeVar("T")


def write_or_refuse(action: Callable[[], T]) -> T:
    """The result of an action; an error if something cannot be written."""
    try:
        return action()
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise UserError(f"cannot write{where}: {error.strerror or error}") from error


def save_results(folder: Path, save: Callable[[Path], None]) -> None:
    """Write the results of a run, and replace those of the previous run."""
    from .orchestration.loop.run_folder import write_run

    tell("writing the results")
    print_notes(write_or_refuse(lambda: write_run(folder, save)))


def prepare_folder(folder: Path, inputs: Iterable[Path | None] = ()) -> None:
    """Try the output folder before any work is done, so that an invalid one costs no time.

    An input must not be a result in this folder that the new results would overwrite.
    """
    if os.path.exists(folder) and not os.path.isdir(folder):  # False for names that are too long
        raise UserError(f"--out {folder} is a file, expected a folder")
    try:
        new = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
        for place in new:  # it is made again with the results: a refused request leaves nothing
            place.rmdir()
    except OSError as error:
        raise UserError(f"--out {folder} cannot be made: {error.strerror}") from error
    if not writable:
        raise UserError(f"--out {folder} cannot be written")
    tell_folder(folder)
    from .orchestration.loop.run_folder import settle, written_files

    print_notes(write_or_refuse(lambda: settle(folder)))
    listed = write_or_refuse(lambda: written_files(folder))
    # realpath, since resolve raises if links form a circle
    results = {Path(os.path.realpath(folder / name)) for name in listed}
    for path in filter(None, inputs):
        own = Path(os.path.realpath(path))
        if own in results or any(own in result.parents for result in results):
            raise UserError(
                f"{path} is a result in --out {folder}, and a new run replaces the "
                "previous one; choose another folder"
            )

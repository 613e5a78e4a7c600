"""The folder of ``--out``: made before the work, written after it."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from .console import print_notes
from .solver.errors import UserError
from .supervision import tell, tell_folder

if TYPE_CHECKING:
    from .result import Result

T = TypeVar("T")


def write_or_refuse(action: Callable[[], T], advice: str = "") -> T:
    """The result of an action; an error if something cannot be written."""
    try:
        return action()
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        raise UserError(f"cannot write{where}: {error.strerror or error}{advice}") from error


def save_results(folder: Path, save: Callable[[Path], None]) -> None:
    """Write the results of a run, and replace those of the previous run."""
    from .orchestration.loop.run_folder import write_run

    tell("writing the results")
    print_notes(write_or_refuse(lambda: write_run(folder, save)))


def save_result(options: argparse.Namespace, result: Result) -> None:
    save_results(options.out, lambda folder: result.save(folder, command=options.command))


def prepare_folder(
    folder: Path, inputs: Iterable[Path | str | None] = (), writes: Iterable[str] = ()
) -> None:
    """Try the output folder before any work is done, so that an invalid one costs no time.

    An input must not be a result in this folder, nor be called as one that the command `writes`.
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
    from .orchestration.loop.parameter_file import FILE_NAME
    from .orchestration.loop.run_folder import settle, written_files

    print_notes(write_or_refuse(lambda: settle(folder)))
    listed = write_or_refuse(lambda: written_files(folder))
    # realpath, since resolve raises if links form a circle
    old = {Path(os.path.realpath(folder / name)) for name in listed}
    made = {Path(os.path.realpath(folder / name)) for name in (FILE_NAME, *writes)}
    for path in (path for path in inputs if path):
        own = Path(os.path.realpath(path))
        if own in old | made or any(own in result.parents for result in old):
            raise UserError(
                f"{path} would be overwritten by the results in --out {folder}; choose another "
                "folder"
            )

"""What a command prints: error messages, notes, progress and tables."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from .printable import printable, unchanged
from .supervision import tell, tell_kept

if TYPE_CHECKING:
    from tqdm import tqdm

    from .orchestration.loop.shown import Table

TRUSTED, NOT_TRUSTED, BAD_REQUEST, INTERNAL = 0, 1, 2, 70  # exit codes

# characters of an error message; a text from a third-party file may be very long
LONGEST_LINE = 600


def forget_output() -> None:
    """Drop output that cannot be printed; otherwise Python tries again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(message: str) -> int:
    line = " ".join(message.split())
    if len(line) > LONGEST_LINE:
        half = LONGEST_LINE // 2
        line = f"{line[:half]} ... {line[-half:]}"
    print(f"ballscrew: {line}", file=sys.stderr)
    return BAD_REQUEST


def complain_of_ourselves(error: Exception) -> int:
    """One line about an error in this program; the details go into a file."""
    import traceback

    from . import __version__
    from .solver import kernel_cache
    from .solver.files import write_atomically

    last = traceback.extract_tb(error.__traceback__)[-1]
    where = "/".join(Path(last.filename).parts[-2:])
    what = f"{type(error).__name__} in {where}, line {last.lineno}: {error}"
    place, fault = kernel_cache.usual_folder()
    head = f"ballscrew {__version__}, Python {sys.version}, {sys.platform}\n{sys.argv}\n"
    text = "".join([head, *traceback.format_exception(error)])
    report = "this line"
    if not fault:
        with contextlib.suppress(OSError):  # only the line is available
            write_atomically(place / "error.txt", text.encode("utf-8", "backslashreplace"))
            report = str(place / "error.txt")
    complain(f"this is an error in ballscrew itself; please report {report}: {what}")
    return INTERNAL


def warn(line: str) -> None:
    print(line, file=sys.stderr)


def print_notes(notes: Iterable[str], as_json: bool = False) -> None:
    """Notes for the user; only readers of JSON are told that N means N*m of a body that turns."""
    notes = [*notes]
    if not notes:
        return
    from .orchestration.loop.parameter_file import TURNS
    from .result import words_for

    words = words_for(notes)
    for note in notes:
        if note != TURNS or as_json:
            warn(f"note: {note if note == TURNS else words(note)}")


def print_json(figures: Any) -> None:
    from .solver.files import finite_or_null

    print(json.dumps(finite_or_null(figures)))


class Line:
    """A line in a terminal that says how far the work is; it is removed at the end of ``with``."""

    _bar: tqdm[Any] | None = None
    _of: tuple[Any, ...] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def show(
        self, done: float, text: str, form: str, total: float | None = None, initial: float = 0
    ) -> None:
        """Show so much of the total, which begins at `initial`; `form` as tqdm's ``bar_format``."""
        if not sys.stderr.isatty():
            return
        if self._bar is None or self._of != (form, total, text if total else ""):
            self.__exit__()
            self._bar = _new_bar(bar_format=form, total=total, initial=initial)
            self._of = form, total, text if total else ""
        self._bar.set_description_str(printable(text), refresh=False)
        self._bar.update(done - self._bar.n)


def _new_bar(**how: Any) -> tqdm[Any]:
    import threading

    from tqdm import tqdm

    # no monitor thread and no lock between processes: commands start processes
    tqdm.monitor_interval = 0
    tqdm.set_lock(threading.RLock())
    often = {"mininterval": 0, "miniters": 0}
    place = {"leave": False, "dynamic_ncols": True, "file": unchanged(sys.stderr)}
    return tqdm(**how, **often, **place)


class Progress(Line):
    """The time [s] that a run has reached; for several runs, with their names."""

    def __init__(self, stop: float | None) -> None:
        self.stop = stop  # None if only the file contains it
        self.shown = 0.0

    def __call__(self, now: float, name: str = "") -> None:
        clock = time.monotonic()
        if clock - self.shown < 0.2:
            return
        self.shown = clock
        head, end = f"{name}: " if name else "", f" of {self.stop:g}" if self.stop else ""
        tell(f"{head}t = {now:.2f}{end} s")
        known = "{desc}{bar} t = {n:.2f} of {total:g} s, {remaining} left"
        self.show(now, head, known if self.stop else "{desc}t = {n:.2f} s", self.stop)


class Count(Line):
    """The number of finished cells, candidates or tasks; each stage is counted separately."""

    def __init__(self, of: str, kept: str = "") -> None:
        self.of, self.kept = of, kept

    def __call__(self, done: int, total: int, stage: str = "") -> None:
        head = f"{stage}: " if stage else ""
        tell(f"{head}{done} of {total} {self.of}")
        if self.kept:
            tell_kept(f"finished {self.kept} are kept, continue with --resume")
        form = f"{{desc}}{{bar}} {{n}} of {{total}} {self.of}, {{remaining}} left"
        self.show(done, head, form, total, 0 if stage else done)


class Stages(Line):
    """The current step of the work, and the time since the start of the command."""

    def __call__(self, doing: str) -> None:
        tell(doing)
        self.show(0, doing, "{elapsed_s:.0f} s: {desc} ...")


def print_result(
    as_json: bool, figures: Any, text: str, files: str = "", folder: Path | None = None
) -> None:
    """Print figures as JSON; or the text, and which files are in the folder, if there is one."""
    if as_json:
        print_json(figures)
    else:
        print(text if folder is None else f"{text}\n{files} in {folder}")


def text_of(table: Table) -> str:
    """A table for a terminal, its columns side by side."""
    return side_by_side([table.columns, *table.rows] if any(table.columns) else table.rows)


def side_by_side(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as lines, each column as wide as its longest cell."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(wide) for cell, wide in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )

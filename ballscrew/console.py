"""What a command prints: error messages, progress, figures and tables."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .options import BAD_REQUEST, INTERNAL
from .printable import printable, unchanged
from .supervision import tell, tell_kept

if TYPE_CHECKING:
    from tqdm import tqdm

    from .orchestration.loop.page import Table

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
    told = "this line"
    if not fault:
        with contextlib.suppress(OSError):  # only the line is available
            write_atomically(place / "error.txt", text.encode("utf-8", "backslashreplace"))
            told = str(place / "error.txt")
    complain(f"this is an error in ballscrew itself; please report {told}: {what}")
    return INTERNAL


def print_notes(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


class Bar:
    """One progress line on standard error, removed at the end; no line if that is no terminal.

    Parameters
    ----------
    form : str
        As tqdm's ``bar_format``.
    total, initial : float
        The amount of work, if known, and the amount already done.
    """

    def __init__(self, form: str, total: float | None = None, initial: float = 0) -> None:
        self.total = total
        self._bar: tqdm[Any] | None = None
        if not sys.stderr.isatty():
            return
        import threading

        from tqdm import tqdm

        # no monitor thread and no lock between processes: commands start processes
        tqdm.monitor_interval = 0
        tqdm.set_lock(threading.RLock())
        self._bar = tqdm(
            bar_format=form,
            total=total,
            initial=initial,
            leave=False,
            mininterval=0,
            miniters=0,
            dynamic_ncols=True,
            file=unchanged(sys.stderr),
        )

    def show(self, done: float, text: str = "") -> None:
        if self._bar is not None:
            self._bar.set_description_str(printable(text), refresh=False)
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


class Progress:
    """The time [s] that a run has reached; for several runs, with their names."""

    def __init__(self, stop: float | None) -> None:
        self.stop = stop  # None if only the file contains it
        self.shown = 0.0
        self.name = ""
        self.bar = self._new_bar()

    def _new_bar(self) -> Bar:
        known = "{desc}{bar} t = {n:.2f} of {total:g} s, {remaining} left"
        return Bar(known if self.stop else "{desc}t = {n:.2f} s", self.stop)

    def __call__(self, now: float, name: str = "") -> None:
        clock = time.monotonic()
        if clock - self.shown < 0.2:
            return
        self.shown = clock
        end = f" of {self.stop:g}" if self.stop else ""
        head = f"{name}: " if name else ""
        tell(f"{head}t = {now:.2f}{end} s")
        if name != self.name:
            self.finish()
            self.name, self.bar = name, self._new_bar()
        self.bar.show(now, head)

    def finish(self) -> None:
        self.bar.close()


OF_A_STEP, OF_A_MOTION = ("settling_time_2pct", "overshoot"), ("rms_error", "largest_error")


def print_figures(figures: dict[str, Any], units: Mapping[str, str], folder: Path) -> None:
    """Print the figures of a run, in the units of `units_of_figures`."""
    labels = {
        "peak_voltage": "peak voltage" if units["peak_voltage"] == "V" else "peak command",
        "peak_voltage_time": "  at",
        "settling_time_2pct": "2 % settling time",
        "overshoot": "overshoot",
        "steady_state_error": "steady-state error",
        "iae": "integral of |error|",
        "rms_error": "rms error",
        "largest_error": "largest error",
        "coupling_residual_max": "coupling residual",
    }
    shown = list(labels) if "peak_voltage" in figures else ["coupling_residual_max"]
    # one pair is for a step, the other for a motion: only one of them applies
    other = OF_A_STEP if figures.get("rms_error") is not None else OF_A_MOTION
    for name in (n for n in shown if n not in other):
        value = figures.get(name)
        told = value is not None and math.isfinite(value)
        text = f"{value:.6g} {units[name]}" if told else "-"
        print(f"{labels[name]:<22}{text}")
    print(f"{'coupling':<22}{figures['coupling']} ({figures['coupling_reason']})")
    print(f"{'communication steps':<22}{figures['macro_steps']}")
    if figures["steps_tried"]:
        tried = figures["steps_tried"]
        step = next((h for h, word in tried if word == "trusted"), tried[-1][0])
        print(f"{'step':<22}{step:g} s ({figures['step_reason']})")
    print(f"{'verdict':<22}{figures['verdict']}: {figures['verdict_reason']}")
    if figures["stopped"]:
        print(f"{'stopped':<22}{figures['stopped']}")
    print(f"{'written to':<22}{folder}")


def comparison_table(rows: list[dict[str, Any]], units: Mapping[str, str]) -> str:
    """The figures of several runs on one plant, in the units of `units_of_figures`."""
    columns = {
        "controller": ("controller", "{}"),
        "peak_voltage": (f"peak [{units['peak_voltage']}]", "{:.2f}"),
        "settling_time_2pct": ("settling [s]", "{:.3f}"),
        "overshoot": (f"overshoot [{units['overshoot']}]", "{:.3g}"),
        "steady_state_error": (f"final error [{units['steady_state_error']}]", "{:.3g}"),
        "iae": (f"IAE [{units['iae']}]", "{:.5f}"),
        "rms_error": (f"rms error [{units['rms_error']}]", "{:.3g}"),
        "largest_error": (f"largest error [{units['largest_error']}]", "{:.3g}"),
        "sampling_period": ("sampled [s]", "{:g}"),
        "coupling": ("coupling", "{}"),
        "verdict": ("verdict", "{}"),
    }
    moving = any(row.get("rms_error") is not None for row in rows)
    for name in OF_A_STEP if moving else OF_A_MOTION:
        del columns[name]
    cells = [[title for title, _ in columns.values()]]
    for row in rows:
        cells.append(
            [
                "-" if row.get(key) is None else form.format(row[key])
                for key, (_, form) in columns.items()
            ]
        )
    return side_by_side(cells)


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


def tell_export(names: Sequence[str], name: str) -> None:
    """Print the progress of an export; each of its files is complete in itself."""
    tell(f"{names.index(name)} of {len(names)} files written, at {name}")
    tell_kept("each file that exists is complete")


class Stages:
    """The current step of the work, and the time since the start of the command."""

    def __init__(self) -> None:
        self.bar = Bar("{elapsed_s:.0f} s: {desc} ...")

    def __call__(self, doing: str) -> None:
        tell(doing)
        self.bar.show(0, doing)

    def finish(self) -> None:
        self.bar.close()

"""What a command prints: complaints, progress, figures and tables."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from .options import BAD_REQUEST
from .supervision import tell, tell_kept

LONGEST_LINE = 600  # characters of a complaint; what a third-party file says may be endless


def forget_output() -> None:
    """Leave what cannot be printed, or Python tries once more at its end."""
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


def print_notes(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


class Progress:
    """One line on standard error, rewritten; silent where nobody watches."""

    def __init__(self, stop: float | None) -> None:
        self.stop = stop  # None where only the file knows it
        self.started = time.monotonic()
        self.shown = 0.0
        self.active = sys.stderr.isatty()

    def __call__(self, now: float, name: str = "") -> None:
        clock = time.monotonic()
        if clock - self.shown < 0.2:
            return
        self.shown = clock
        end = f" of {self.stop:g}" if self.stop else ""
        done = now / self.stop if self.stop else 0.0
        left = (clock - self.started) * (1 - done) / done if done > 0 and not name else None
        rest = f", about {left:.0f} s left" if left is not None else ""
        head = f"{name}: " if name else ""
        tell(f"{head}t = {now:.2f}{end} s")
        if self.active:
            print(f"\r\033[K{head}t = {now:.2f}{end} s{rest}", end="", file=sys.stderr)

    def finish(self) -> None:
        if self.active and self.shown:
            print("\r\033[K", end="", file=sys.stderr)


def print_figures(figures: dict[str, Any], folder: Path) -> None:
    rows = [
        ("peak voltage", figures.get("peak_voltage"), "V"),
        ("  at", figures.get("peak_voltage_time"), "s"),
        ("2 % settling time", figures.get("settling_time_2pct"), "s"),
        ("overshoot", figures.get("overshoot"), "m"),
        ("steady-state error", figures.get("steady_state_error"), "m"),
        ("integral of |error|", figures.get("iae"), "m*s"),
        ("coupling residual", figures["coupling_residual_max"], "V"),
    ]
    for label, value, unit in rows:
        shown = "-" if value is None else f"{value:.6g} {unit}"
        print(f"{label:<22}{shown}")
    print(f"{'coupling':<22}{figures['coupling']} ({figures['coupling_reason']})")
    print(f"{'communication steps':<22}{figures['macro_steps']}")
    if figures["steps_tried"]:
        step = figures["steps_tried"][-1][0]
        print(f"{'step':<22}{step:g} s ({figures['step_reason']})")
    print(f"{'verdict':<22}{figures['verdict']}: {figures['verdict_reason']}")
    if figures["stopped"]:
        print(f"{'stopped':<22}{figures['stopped']}")
    print(f"{'written to':<22}{folder}")


def comparison_table(rows: list[dict[str, Any]]) -> str:
    columns = {
        "controller": ("controller", "{}"),
        "peak_voltage": ("peak [V]", "{:.2f}"),
        "settling_time_2pct": ("settling [s]", "{:.3f}"),
        "overshoot": ("overshoot [m]", "{:.3g}"),
        "steady_state_error": ("final error [m]", "{:.3g}"),
        "iae": ("IAE [m*s]", "{:.5f}"),
        "coupling": ("coupling", "{}"),
        "verdict": ("verdict", "{}"),
    }
    cells = [[title for title, _ in columns.values()]]
    for row in rows:
        cells.append(
            [
                "-" if row.get(key) is None else form.format(row[key])
                for key, (_, form) in columns.items()
            ]
        )
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )


def tell_export(names: Sequence[str], name: str) -> None:
    """Say how far an export is; each of its files stands by itself."""
    tell(f"{names.index(name)} of {len(names)} files written, at {name}")
    tell_kept("each file that is there is whole")


class Stages:
    """One line on standard error, rewritten; silent where nobody watches."""

    def __init__(self) -> None:
        self.started = time.monotonic()
        self.active = sys.stderr.isatty()

    def __call__(self, doing: str) -> None:
        tell(doing)
        if self.active:
            seconds = time.monotonic() - self.started
            print(f"\r\033[K{seconds:.0f} s: {doing} ...", end="", file=sys.stderr, flush=True)

    def finish(self) -> None:
        if self.active:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

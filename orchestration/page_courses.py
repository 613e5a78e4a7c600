"""Curves of runs for pages with zoom: from rest to rest, with every peak."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .loop_run import LoopRun
from .page import COLOURS_OF_PAGES, MOST, Line, Picture
from .pictures import RESTING, colour_of, shown_signal, signals_of, states_of, until_rest
from .shown_units import labelled, shown_unit
from .thinning import rows_over_time

Vector = npt.NDArray[np.float64]

MOST_PICTURES = 12  # of the signals of one run
LEAST = 1e-9  # smallest distance on a logarithmic axis [m]
_TIME = "time [s]"
_DASHES = ("", " dashed", " dotted", " dashdot")


def pictures_of_run(run: LoopRun) -> list[Picture]:
    """A picture of each signal, and of the position error, until all of them rest."""
    end = until_rest(run)
    pictures: list[Picture] = []
    names = states_of(run)
    commands = [n for n in run.commands if n not in names]
    for name in (*names[:1], *commands, *names[1:]):
        how, values = shown_signal([run], name), signals_of(run)[name]
        own = f"c{colour_of(run, name)}"
        lines = [_line(how.called, own, run, how.factor * values, end)]
        if name == "x" and not run.alone:
            goal = how.factor * run.reference
            lines.append(_line("set-point", "level dotted", run, goal, end))
        pictures.append(_picture(f"signal{len(pictures)}", how.called, how.label, lines, [run]))
        if name == "x" and not run.alone:
            pictures.append(_error(run, end))
    left_out = len(pictures) - MOST_PICTURES
    if left_out > 0:
        del pictures[MOST_PICTURES:]
        pictures[-1] = _saying(pictures[-1], f"{left_out} more signals are in trajectory.csv.")
    return pictures


def pictures_of_runs(labels: Sequence[str], runs: Sequence[LoopRun]) -> list[Picture]:
    """Position, distance to the set-point and command of runs with the same signals.

    Parameters
    ----------
    labels : sequence of str
        Name of each run.
    """
    end = max(map(until_rest, runs))
    of_x, of_u = shown_signal(runs, "x"), shown_signal(runs, "u")
    metres = (runs[0].units.get("x") or "m") == "m"
    size, unit = (1e6, "µm") if metres else (1.0, of_x.unit)

    def lines(values: Iterable[Vector]) -> list[Line]:
        return [
            _line(label, style_of(k), run, course, end)
            for k, (label, run, course) in enumerate(zip(labels, runs, values, strict=True))
        ]

    positions = lines(of_x.factor * run.outputs["x"] for run in runs)
    goal = _line("set-point", "level dotted", runs[0], of_x.factor * runs[0].reference, end)
    far = lines(size * np.maximum(np.abs(run.outputs["x"] - run.reference), LEAST) for run in runs)
    commands = lines(of_u.factor * run.commands["u"] for run in runs)
    apart = _picture("distance", "Distance to the set-point", labelled("distance", unit), far, runs)
    return [
        _picture("position", of_x.called, of_x.label, [*positions, goal], runs),
        _saying(apart, f"What is below {size * LEAST:g} {unit} is drawn there.", log=True),
        _picture("command", of_u.called, of_u.label, commands, runs),
    ]


def style_of(number: int) -> str:
    """The style of a run among several, the same in all pictures of its page."""
    return f"c{number % COLOURS_OF_PAGES}{_DASHES[number % len(_DASHES)]}"


def _error(run: LoopRun, end: float) -> Picture:
    error = run.reference - run.outputs["x"]
    factor, unit = shown_unit(error, run.units.get("x") or "m")
    line = _line("set-point less position", "c6", run, factor * error, end)
    return _picture("error", "position error", labelled("error", unit), [line], [run])


def _line(label: str, style: str, run: LoopRun, values: Vector, end: float) -> Line:
    moving = run.time <= end
    time, course = run.time[moving], values[moving]
    rows = rows_over_time(time, course, MOST // 4)
    return Line(label, style, time[rows], course[rows])


def _picture(
    name: str, title: str, y_label: str, lines: Sequence[Line], runs: Sequence[LoopRun]
) -> Picture:
    end, stop = max(map(until_rest, runs)), max(float(run.time[-1]) for run in runs)
    rest = f"From {end:.3g} s on all signals stay within {RESTING:.1%} of their range; "
    says = [f"{rest}the run goes on to {stop:g} s."] * (end < stop)
    most = max(int(np.count_nonzero(run.time <= end)) for run in runs)
    drawn = max(len(line.x) for line in lines)
    if drawn < most:
        says.append(f"Drawn are {drawn} of {most} points, every peak among them.")
    title = title[:1].upper() + title[1:]
    return Picture(name, title, " ".join(says), _TIME, y_label, tuple(lines))


def _saying(picture: Picture, more: str, log: bool = False) -> Picture:
    return replace(picture, says=f"{picture.says} {more}".strip(), log=log)

"""Figs. 2.14 to 2.19 with the predictions of all laws.

The measured points are not printed in the thesis; values from its text are drawn in grey.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.orchestration.loop.pictures import (
    COLOURS,
    DASHES,
    STYLE,
    drawing,
    new_figure,
    write_figure,
)

from .criteria import LAG_SPEED, MEASURED_BREAK_AWAY, STIFFNESS
from .observations import ForceCurve, Observations

GREY = "#555555"
MARKS = ("o", "s", "^", "v", "D", "P", "X")
# Table 2.3: parameters fitted to the constant velocities, by direction
_MEASURED_CURVE = {1: (1.11, 2.3, 0.001943, 193.4), -1: (1.458, 2.4, 0.0003365, 152.6)}

Laws = Mapping[str, Observations]


@drawing()
def save_pictures(laws: Laws, folder: Path) -> None:
    """Write all figures as PNG and SVG into `folder`.

    Parameters
    ----------
    laws : mapping of str to Observations
        By name of the law.
    folder : Path

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        _break_away(laws, folder)
        _viscous(laws, folder)
        _lag(laws, folder)
        _varying(laws, folder)
        _presliding(laws, folder)
        _step(laws, folder)


def _line(k: int, law: str) -> dict[str, Any]:
    return {
        "color": COLOURS[k % len(COLOURS)],
        "ls": DASHES[k % len(DASHES)],
        "label": law.replace("_", " "),
    }


def _mark(k: int, law: str) -> dict[str, Any]:
    return {
        "color": COLOURS[k % len(COLOURS)],
        "marker": MARKS[k % len(MARKS)],
        "ms": 6,
        "ls": "none",
        "label": law.replace("_", " "),
    }


def _legend_below(figure: Any, axes: Any, columns: int = 4) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def _measured_curve(direction: int, speed: Any) -> Any:
    """Table 2.3's Stribeck curve of one direction [N], at speeds [m/s]."""
    fc, fs, vs, viscous = _MEASURED_CURVE[direction]
    return direction * (fc + (fs - fc) * np.exp(-((speed / vs) ** 2)) + viscous * speed)


def _break_away(laws: Laws, folder: Path) -> None:
    figure, (axes,) = new_figure(1, 3, (13, 4.8))
    whole, *zooms = axes
    speed = np.linspace(0, 8e-3, 400)
    for direction in (1, -1):
        label = "Stribeck curve of Table 2.3" if direction > 0 else None
        curve = _measured_curve(direction, speed)
        whole.plot(direction * speed * 1e3, curve, color=GREY, label=label)
    # next to each other, so that equal laws do not hide each other
    shown = [n for n, s in laws.items() if None not in (s.forwards.force, s.backwards.force)]
    places = {law: k for k, law in enumerate(shown)}
    for k, (law, seen) in enumerate(laws.items()):
        if law not in places:
            continue
        forwards, backwards = seen.forwards.force or 0.0, -(seen.backwards.force or 0.0)
        whole.plot([0.0, 0.0], [forwards, backwards], **_mark(k, law))
        zooms[0].plot(places[law], forwards, **_mark(k, law))
        zooms[1].plot(places[law], backwards, **_mark(k, law))
    whole.set_xlabel("velocity [mm/s]")
    whole.set_ylabel("friction [N]")
    missing = [law.replace("_", " ") for law in laws if law not in places]
    without = f"\nwithout a peak: {', '.join(missing)}" if missing else ""
    whole.set_title(f"(a) break-away at no velocity{without}")
    for name, zoom, part in zip(MEASURED_BREAK_AWAY, zooms, "bc", strict=True):
        measured = MEASURED_BREAK_AWAY[name]
        zoom.axhline(measured, color=GREY, ls=":", label=f"measured, {measured:g} N")
        zoom.set_title(f"({part}) {name}; measured {measured:g} N dotted")
        zoom.set_xticks(range(len(shown)), [n.replace("_", " ") for n in shown], rotation=40)
        zoom.set_ylabel("break-away force [N]")
        zoom.margins(y=0.25)
    _legend_below(figure, whole)
    write_figure(figure, folder, "figure_2_14_break_away")


def _viscous(laws: Laws, folder: Path) -> None:
    figure, (axes,) = new_figure(1, 2, (11, 5))
    for direction, panel in zip((1, -1), axes, strict=True):
        for k, (law, seen) in enumerate(laws.items()):
            there = direction * seen.speed > 0
            speed, friction = _means(seen.speed[there], seen.friction[there])
            panel.plot(speed * 1e3, friction, marker=MARKS[k % len(MARKS)], **_line(k, law))
        speed = np.linspace(3e-3, 8e-3, 100)
        panel.plot(
            direction * speed * 1e3,
            _measured_curve(direction, speed),
            color=GREY,
            lw=6,
            alpha=0.3,
            label="Stribeck curve of Table 2.3",
        )
        panel.set_xlabel("velocity [mm/s]")
        panel.set_ylabel("steady friction [N]")
        panel.set_title("positive velocity" if direction > 0 else "negative velocity")
    _legend_below(figure, axes[0])
    write_figure(figure, folder, "figure_2_15_viscous_friction")


def _means(speed: Any, friction: Any) -> tuple[Any, Any]:
    """Means over the repetitions of each velocity, by velocity."""
    wanted = np.round(speed * 1e3)
    levels = np.unique(wanted)

    def mean(values: Any) -> Any:
        return np.array([values[wanted == level].mean() for level in levels])

    return mean(speed), mean(friction)


def _lag(laws: Laws, folder: Path) -> None:
    figure, ((axes,),) = new_figure(1, 1, (8, 5.6))
    for k, (law, seen) in enumerate(laws.items()):
        axes.plot(seen.loop_speed * 1e3, seen.loop_friction, **_line(k, law))
    axes.axvline(LAG_SPEED * 1e3, color=GREY, ls=":", lw=1)
    axes.annotate(
        "largest deviation of LuGre\nfrom the measured: 7.6 %",
        (LAG_SPEED * 1e3, axes.get_ylim()[0]),
        xytext=(6, 8),
        textcoords="offset points",
        color=GREY,
        fontsize=9,
    )
    axes.set_xlabel("velocity [mm/s]")
    axes.set_ylabel("friction [N]")
    axes.set_title("Friction lag: 1.5 mm/s + 1 mm/s sin(3 t)")
    _legend_below(figure, axes)
    write_figure(figure, folder, "figure_2_16_friction_lag")


def _varying(laws: Laws, folder: Path) -> None:
    figure, ((axes,),) = new_figure(1, 1, (8, 5.6))
    for k, (law, seen) in enumerate(laws.items()):
        if np.isfinite(seen.rate_peaks).any():
            axes.semilogx(
                seen.rates, seen.rate_peaks, marker=MARKS[k % len(MARKS)], ms=4, **_line(k, law)
            )
    missing = [n.replace("_", " ") for n, s in laws.items() if np.isnan(s.rate_peaks).any()]
    without = f"\nno peak at some or all rates: {', '.join(missing)}" if missing else ""
    axes.set_xlabel("loading rate [N/s]")
    axes.set_ylabel("break-away force [N]")
    axes.set_title(f"Break-away force by loading rate{without}")
    _legend_below(figure, axes)
    write_figure(figure, folder, "figure_2_17_varying_break_away_force")


def _presliding(laws: Laws, folder: Path) -> None:
    figure, (axes,) = new_figure(1, 2, (12, 5.4))
    force, displacement = axes
    for k, (law, seen) in enumerate(laws.items()):
        course = seen.staircase
        force.plot(course.time, course.force, **_line(k, law))
        displacement.plot(course.time, course.x * 1e6, **_line(k, law))
    ends = np.array([7.0, 12.0, 17.0])
    displacement.plot(
        ends,
        np.array([0.5, 1.0, 1.5]) / STIFFNESS * 1e6,
        "_",
        ms=22,
        mew=3,
        color=GREY,
        label="force over Table 2.9's 67.0 kN/m",
    )
    force.set_ylabel("friction [N]")
    force.set_title("(a) force on the block")
    displacement.set_ylabel("displacement [µm]")
    displacement.set_title("(b-d) presliding")
    for panel in axes:
        panel.set_xlabel("time [s]")
        panel.margins(x=0.01)
    _limit(displacement, laws, [s.staircase for s in laws.values()])
    _legend_below(figure, displacement)
    write_figure(figure, folder, "figure_2_18_presliding")


def _step(laws: Laws, folder: Path) -> None:
    figure, axes = new_figure(2, 1, (8, 7))
    force, displacement = (row[0] for row in axes)
    for k, (law, seen) in enumerate(laws.items()):
        course = seen.step
        early = course.time <= 1.0
        force.plot(course.time[early], course.force[early], **_line(k, law))
        displacement.plot(course.time[early], course.x[early] * 1e6, **_line(k, law))
    force.axhline(1.5, color=GREY, ls=":", lw=1)
    force.set_ylabel("friction [N]")
    force.set_title("Motor's force stepped to 1.5 N (dotted)")
    displacement.set_ylabel("displacement [µm]")
    displacement.set_xlabel("time [s]")
    _limit(displacement, laws, [s.step for s in laws.values()])
    _legend_below(figure, displacement)
    write_figure(figure, folder, "figure_2_19_force_step")


def _limit(axes: Any, laws: Laws, courses: list[ForceCurve]) -> None:
    """Set limits without curves that slide away, because the others would not be visible."""
    held = [c.x.max() for c in courses if c.x.max() < 5e-4]
    if held and len(held) < len(laws):
        axes.set_ylim(-0.05e6 * max(held), 1.2e6 * max(held))

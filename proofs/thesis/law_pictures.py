"""Figs. 2.14 to 2.19 with the predictions of the laws of the thesis.

The measured points are not printed in the thesis; values from its text are drawn in grey.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ballscrew.orchestration.loop.pictures import COLOURS, DASHES, new_figure
from thesis.friction_laws import (
    HOLDS,
    LAWS,
    MEASURED,
    STIFFNESS,
    break_away,
    cycle,
    force_step,
    rates,
    staircase,
    steady,
)
from thesis.pictures import FOLDER, write

GREY, MARKS = "#555555", ("o", "s", "^", "v")
# Table 2.3: the Stribeck curve fitted to the constant velocities, by direction
_FITTED = {1: (1.11, 2.3, 0.001943, 193.4), -1: (1.458, 2.4, 0.0003365, 152.6)}


def _line(k: int, law: str) -> dict[str, Any]:
    return {"color": COLOURS[k], "ls": DASHES[k], "label": law.replace("_", " ")}


def _named(axes: Any, across: str, up: str, title: str = "") -> None:
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.set_title(title)


def _legend(figure: Any, axes: Any) -> Any:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _curve(direction: int, speed: Any) -> Any:
    fc, fs, vs, viscous = _FITTED[direction]
    return direction * (fc + (fs - fc) * np.exp(-((speed / vs) ** 2)) + viscous * speed)


def break_away_forces() -> Any:
    figure, (axes,) = new_figure(1, 2, (9, 4.2))
    for panel, (direction, measured) in zip(axes, MEASURED.items(), strict=True):
        for k, law in enumerate(LAWS):
            force = direction * break_away(law, direction)[0]
            panel.plot(k, force, MARKS[k], ms=8, color=COLOURS[k])
        panel.axhline(measured, color=GREY, ls=":")
        panel.set_xticks(range(len(LAWS)), [n.replace("_", "\n") for n in LAWS])
        panel.margins(y=0.3)
        way = "forwards" if direction > 0 else "backwards"
        panel.text(1, measured, "no peak", ha="center", va="bottom", fontsize=9)
        title = f"Fig. 2.14, {way}; measured: dotted"
        _named(panel, "", "break-away force [N]", title)
    return figure


def viscous_friction() -> Any:
    figure, (axes,) = new_figure(1, 2, (10, 4.6))
    for panel, direction in zip(axes, (1, -1), strict=True):
        for k, law in enumerate(LAWS):
            speed, friction = steady(law)
            there = direction * speed > 0
            order = np.argsort(speed[there])
            panel.plot(1e3 * speed[there][order], friction[there][order], **_line(k, law))
        fine = np.linspace(3e-3, 8e-3, 100)
        style = {"color": GREY, "lw": 6, "alpha": 0.3, "label": "Stribeck curve of Table 2.3"}
        panel.plot(1e3 * direction * fine, _curve(direction, fine), **style)
        _named(panel, "velocity [mm/s]", "steady friction [N]", "Fig. 2.15")
    return _legend(figure, axes[0])


def friction_lag() -> Any:
    figure, ((axes,),) = new_figure(1, 1, (7, 5))
    for k, law in enumerate(LAWS):
        speed, friction = cycle(law)
        axes.plot(1e3 * speed, friction, **_line(k, law))
    title = "Fig. 2.16: velocity 1.5 mm/s + 1 mm/s sin(3 t)"
    _named(axes, "velocity [mm/s]", "friction [N]", title)
    return _legend(figure, axes)


def varying_break_away() -> Any:
    figure, ((axes,),) = new_figure(1, 1, (7, 5))
    for k, law in enumerate(LAWS):
        rate, peaks = rates(law)
        axes.semilogx(rate, peaks, marker=MARKS[k], ms=4, **_line(k, law))
    title = "Fig. 2.17: laws without a curve have no peak"
    _named(axes, "loading rate [N/s]", "break-away force [N]", title)
    return _legend(figure, axes)


def presliding() -> Any:
    figure, (axes,) = new_figure(1, 2, (10, 4.6))
    moved = {law: staircase(law) for law in LAWS}
    for k, (law, truth) in enumerate(moved.items()):
        axes[0].plot(truth["time"], truth["friction"], **_line(k, law))
        axes[1].plot(truth["time"], 1e6 * truth["x"], **_line(k, law))
    spring = 1e6 * np.array([0.5, 1.0, 1.5]) / STIFFNESS
    style = {"color": GREY, "ms": 22, "mew": 3, "label": "force over Table 2.9's 67.0 kN/m"}
    axes[1].plot(HOLDS, spring, "_", **style)
    axes[1].set_ylim(-2.0, 45.0)  # those that slide away leave the picture
    _named(axes[0], "time [s]", "friction [N]", "Fig. 2.18 (a)")
    _named(axes[1], "time [s]", "displacement [um]", "Fig. 2.18 (b-d)")
    return _legend(figure, axes[1])


def step_of_force() -> Any:
    figure, (axes,) = new_figure(1, 2, (10, 4.6))
    for k, law in enumerate(LAWS):
        truth = force_step(law)
        early = truth["time"] <= 1.0
        axes[0].plot(truth["time"][early], truth["friction"][early], **_line(k, law))
        axes[1].plot(truth["time"][early], 1e6 * truth["x"][early], **_line(k, law))
    axes[1].set_ylim(-2.0, 45.0)
    _named(axes[0], "time [s]", "friction [N]", "Fig. 2.19: the motor's force steps to 1.5 N")
    _named(axes[1], "time [s]", "displacement [um]", "Fig. 2.19")
    return _legend(figure, axes[1])


PICTURES: dict[str, Callable[[], Any]] = {
    "break_away": break_away_forces,
    "viscous_friction": viscous_friction,
    "friction_lag": friction_lag,
    "varying_break_away": varying_break_away,
    "presliding": presliding,
    "step_of_force": step_of_force,
}


def save_all() -> None:
    """Draw Figs. 2.14 to 2.19."""
    for name, draw in PICTURES.items():
        write(draw, FOLDER / f"{name}.png")

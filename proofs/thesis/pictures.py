"""The figures 3.4 to 3.24, drawn by this program with what the thesis says.

The pictures of the thesis are not copied. Numbers and statements of its text are black.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from PIL import Image

from ballscrew.orchestration.loop.pictures import COLOURS, DASHES, STYLE, new_figure
from thesis import printed as th
from thesis.loops import axis_under_step, end_of, hats, model_of, scipy_course, tangents
from thesis.region_and_tables import designed, grid

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images" / "thesis"
SIZE = (9.6, 5.6)  # in


def thesis_text(axes: Any, text: str, place: tuple[float, float], **style: Any) -> None:
    """Draw a statement of the thesis, at a position in shares of the axes."""
    style = {"fontsize": 9, "color": "black", "transform": axes.transAxes, **style}
    axes.text(*place, f"thesis: {text}", **style)


def titled(axes: Any, title: str, across: str, up: str) -> None:
    axes.set_title(title, fontsize=10.5)
    axes.set_xlabel(across)
    axes.set_ylabel(up)


def course(controller: str, values: dict[str, float], stop: float, points: int) -> Any:
    return model_of(controller, 1e-9, **values).simulate(np.linspace(0.0, stop, points))


def exponents(controller: str, values: dict[str, float], stop: float) -> tuple[Any, Any]:
    """Times [s], and all finite-time exponents [bits/s] in descending order, one per column."""
    run = tangents(controller, np.linspace(0.0, stop, 401), 1e-11, None, **values)
    rates = run.growth[1:] * th.BITS / run.time[1:, None]
    return run.time[1:], -np.sort(-rates, axis=1)


def draw_position(axes: Any, run: Any, figure: str) -> None:
    axes.plot(run.time, 1e2 * run.outputs["x"], color=COLOURS[0])
    axes.axhline(1e2 * th.SETPOINT, color="black", lw=1, ls=":")
    thesis_text(axes, "no overshoot, no steady-state error", (0.97, 0.08), ha="right")
    titled(axes, f"Fig. {figure}: position", "time [s]", "position $x$ [cm]")


def draw_voltage(axes: Any, run: Any, figure: str, steady: float) -> None:
    axes.plot(run.time, run.outputs["u"], color=COLOURS[1])
    axes.axhline(th.NOMINAL_VOLTAGE, color="black", lw=1, ls=":")
    axes.text(run.time[-1], 35.3, "nominal 35 V", ha="right", va="bottom", fontsize=9)
    axes.axvline(steady, color="black", lw=1, ls="--")
    axes.text(steady, 5.0, f" thesis: steady\n after {steady:g} s", fontsize=9)
    axes.set_ylim(-1.0, 40.0)
    titled(axes, f"Fig. {figure}: motor voltage", "time [s]", "motor voltage $u$ [V]")


def mark(axes: Any, run: Any, k: int, marker: str, place: str, **style: Any) -> None:
    """Mark the k-th voltage; `place` is a format of the time."""
    time, u = run.time[k], run.outputs["u"][k]
    here = f"here {u:.1f} V at {place.format(time)}"
    axes.plot(time, u, marker, color=COLOURS[1], label=here, **style)


def linearization() -> Any:
    run = course("iol", {}, 3.0, 1501)
    figure, ((left, right),) = new_figure(1, 2, (9.6, 3.8))
    draw_position(left, run, "3.4")
    draw_voltage(right, run, "3.5", th.STEADY)
    mark(right, run, np.argmax(run.outputs["u"]), "o", "{:.3f} s")
    said = f"thesis: about {th.PEAK[1]:g} V at {th.PEAK[0]:g} s"
    right.plot(*th.PEAK, "x", color="black", ms=8, label=said)
    right.legend(loc="center right", fontsize=8, bbox_to_anchor=(1.0, 0.35), handlelength=1.0)
    return figure


def nctf() -> Any:
    figure, ((step, plane), (position, voltage)) = new_figure(2, 2, (9.6, 7.2))
    plant = axis_under_step()
    up = plant.simulate(np.linspace(0.0, 0.3, 1501))
    plant.set_input("u", 0.0)
    # the creep is visible in the plane of speed and distance, with logarithmic time
    down = plant.simulate(0.3 + np.concatenate([[0.0], np.geomspace(1e-6, 0.3, 1500)]))
    time = np.concatenate([up.time, down.time])
    speed = np.concatenate([up.outputs["v"], down.outputs["v"]])
    step.plot(time, speed, color=COLOURS[0], label="here")
    step.axhline(th.PRINTED_H, color="black", lw=1, ls=":")
    step.axvspan(0.3, 0.3 + th.PRINTED_A, color="#dddddd")
    thesis_text(step, f"$h$ = {th.PRINTED_H} m/s, dotted", (0.03, 0.91))
    thesis_text(step, f"stops within\n$A$ = {th.PRINTED_A} s (grey)", (0.53, 0.45))
    step.set_ylim(-0.005, 0.145)
    titled(step, "Fig. 3.7: 30 V until 0.3 s, then 0 V", "time [s]", "velocity $v$ [m/s]")
    last = int(np.argmax(down.outputs["x"]))  # then it creeps back
    x, v = down.outputs["x"][: last + 1], down.outputs["v"][: last + 1]
    plane.semilogx(1e6 * np.maximum(x[-1] - x, 1e-9), v, color=COLOURS[0], label="here")
    error = np.geomspace(1e-9, 0.1, 200)
    printed = th.PRINTED_H * np.tanh(th.PRINTED_C * error)
    said = f"thesis:\n{th.PRINTED_H} tanh({th.PRINTED_C} $e$)"
    plane.semilogx(1e6 * error, printed, color="black", ls="--", label=said)
    plane.set_xlim(1e-2, 1e5)
    plane.legend(loc="center left", fontsize=9)
    titled(plane, "Figs. 3.7, 3.8: speed and way to go", "way to go $e$ [um]", "velocity [m/s]")
    run = course("nctf", {}, 4.0, 4001)
    draw_position(position, run, "3.9")
    draw_voltage(voltage, run, "3.10", th.STEADY_NCTF)
    second = np.argmax(np.where(run.time > 0.05, run.outputs["u"], -np.inf))
    mark(voltage, run, second, "o", "{:.2f} s")
    said = f"thesis: second peak at about {th.SECOND_PEAK:g} s"
    voltage.axvline(th.SECOND_PEAK, color="black", lw=1, ls="-.", label=said)
    mark(voltage, run, 0, "s", "the start", ms=5)
    voltage.legend(loc="upper left", fontsize=8, bbox_to_anchor=(0.1, 0.84), handlelength=1.4)
    return figure


STATES = (
    ("$x_1$ [cm]", lambda s: 1e2 * (s["plant_x"] - th.SETPOINT)),
    ("$x_2$ = $v$ [cm/s]", lambda s: 1e2 * s["plant_v"]),
    ("$x_3$ = $z$ [um]", lambda s: 1e6 * s["plant_z"]),
    ("$x_4$ = $i$ [A]", lambda s: s["plant_i"]),
    ("$x_5$ [mm]", lambda s: 1e3 * s["controller_w"]),
)


def draw_states(panels: Any, run: Any, figures: tuple[str, ...]) -> None:
    shown = zip(panels, figures, STATES, strict=False)
    for k, (axes, figure, (label, of)) in enumerate(shown):
        axes.plot(run.time, of(run.states), color=COLOURS[(0, 2, 3, 5, 4)[k]], lw=1.4)
        titled(axes, f"Fig. {figure}", "time [s]", label)


def draw_rates(axes: Any, time: Any, rates: Any) -> None:
    for k, rate in enumerate(rates.T):
        axes.plot(time, rate, color=COLOURS[k], ls=DASHES[k], label=f"here $\\lambda_{k + 1}$")


def draw_exponents(
    axes: Any, found: tuple[Any, Any], figure: str, printed: tuple[float, ...], said: str
) -> None:
    time, rates = found
    draw_rates(axes, time, rates)
    for value in printed:
        axes.axhline(value, color="black", lw=1, ls=":")
    axes.plot([], [], color="black", lw=1, ls=":", label=f"thesis: {said}")
    axes.set_yscale("symlog", linthresh=0.01)
    axes.set_ylim(bottom=200.0 * rates.min())  # room for the legend
    axes.set_ylim(top=0.02 if max(printed, default=-1.0) == 0.0 else -0.01)
    axes.legend(
        loc="lower right", fontsize=7.5, ncols=2, bbox_to_anchor=(1.02, 0.0), handlelength=1.8,
        columnspacing=0.8,
    )  # fmt: skip
    titled(axes, f"Fig. {figure}: exponents", "time [s]", "exponents [bits/s]")


def system_1() -> Any:
    figure, grid = new_figure(2, 3, SIZE)
    run = course("iol", hats(th.SYSTEM_1), th.STOP, 4001)
    draw_states(grid[:, :2].T.flat, run, ("3.11", "3.11", "3.12", "3.12"))
    thesis_text(grid[0][0], "the states converge", (0.97, 0.1), ha="right")
    found = exponents("iol", hats(th.SYSTEM_1), 400.0)
    said = f"{th.LARGEST_1} ($\\lambda_1$)"
    draw_exponents(grid[0][2], found, "3.13", (th.LARGEST_1,), said)
    largest = grid[1][2]
    largest.plot(found[0], found[1][:, 0], color=COLOURS[0], label="here")
    largest.axhline(th.LARGEST_1, color="black", lw=1, ls=":", label=f"thesis: {th.LARGEST_1}")
    largest.set_ylim(-0.2, 0.0)
    largest.legend(loc="lower right", fontsize=9)
    titled(largest, "Fig. 3.13: the largest one", "time [s]", "$\\lambda_1$ [bits/s]")
    return figure


def system_2() -> Any:
    figure, grid = new_figure(2, 4, (12.0, 5.6))
    run = course("iol", hats(th.SYSTEM_2), th.STOP, 4001)
    loose = scipy_course(th.SYSTEM_2, "RK45", 1e-3, 1e-6, np.linspace(0.0, th.STOP, 20_001))
    draw_states(grid[:, :2].T.flat, run, ("3.14", "3.14", "3.15", "3.15"))
    for panel in grid[0][:2]:
        thesis_text(panel, "it swings on", (0.97, 0.1), ha="right")
    courses = (
        (run.time, run.states["plant_x"], run.states["plant_v"], "here"),
        (loose.t, loose.y[0], loose.y[1], "RK45, loose"),
    )
    phase, close, slow = grid[0][2], grid[0][3], grid[1][3]
    for k, (time, x, v, label) in enumerate(courses):
        phase.plot(1e2 * (x - th.SETPOINT), 1e2 * v, color=COLOURS[k], ls=DASHES[k], label=label)
        late = time >= 4.0
        close.plot(time[late], 1e6 * (x[late] - th.SETPOINT), color=COLOURS[k], label=label, lw=1.2)
    thesis_text(phase, "ends in a cycle\naround the origin", (0.3, 0.08))
    phase.legend(loc="upper right", fontsize=8)
    titled(phase, "Fig. 3.16: phase portrait", "$x_1$ [cm]", "$x_2$ [cm/s]")
    close.legend(loc="lower left", fontsize=8)
    titled(close, "Fig. 3.14, close-up", "time [s]", "$x_1$ [um]")
    found = exponents("iol", hats(th.SYSTEM_2), th.LONG)
    said = "{:g}, {:g},\n{:g}, {:g}".format(*th.SPECTRUM_2)
    draw_exponents(grid[1][2], found, "3.17", th.SPECTRUM_2, said)
    draw_rates(slow, found[0], found[1][:, :2])
    for k, value in enumerate(th.SPECTRUM_2[:2]):
        slow.axhline(value, color="black", lw=1, ls=(":", "--")[k], label=f"thesis: {value:g}")
    slow.set_ylim(-1.0, 0.05)
    slow.legend(loc="lower right", fontsize=8)
    titled(slow, "Fig. 3.17: the largest two", "time [s]", "exponents [bits/s]")
    return figure


KINDS = ("stands", "swings", "diverges")


def plane() -> Any:
    across, up = grid()
    cells = np.array([[KINDS.index(end_of(a, b).kind) for a in across] for b in up])
    figure, ((axes,),) = new_figure(1, 1, (8.0, 5.2))
    colours = ("#666666", "#56B4E9", "#E69F00")
    axes.pcolormesh(across - th.SIGMA0, up, cells, cmap=ListedColormap(colours), shading="nearest")
    for k, kind in enumerate(KINDS):
        share = f"{kind} ({100 * np.mean(cells == k):.0f} %)"
        axes.plot([], [], "s", ms=10, color=colours[k], label=share)
    axes.axvline(th.RUNAWAY - th.SIGMA0, color="black", lw=1.5, ls="--")
    said = f"thesis: unstable beyond {th.RUNAWAY} N/m"
    axes.text(th.RUNAWAY - th.SIGMA0 + 0.06, 354.0, said, rotation=90, va="center")
    axes.axhline(th.CYCLE, color="black", lw=1.5, ls=":")
    said = f"thesis: cycle or unstable below {th.CYCLE} (dotted)"
    axes.text(across[0] - th.SIGMA0, up[0] - 1.9, said)
    axes.plot(0.0, th.SIGMA1, "*", ms=15, color="#F0E442", mec="black", label="nominal")
    axes.set_ylim(up[0] - 2.4, up[-1] + 0.5)
    axes.grid(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    titled(axes, "Fig. 3.18", "$\\hat\\sigma_0 - \\sigma_0$ [N/m]", "$\\hat\\sigma_1$ [N s/m]")
    return figure


def perturbed(percent: int, figures: tuple[str, ...]) -> Any:
    made = designed(percent, percent).parameters()
    figure, grid = new_figure(2, 3, SIZE)
    panels = list(grid.flat)
    draw_states(panels, course("nctf", made, 5.0, 5001), figures)
    thesis_text(panels[0], "the states converge", (0.97, 0.1), ha="right")
    found = exponents("nctf", made, th.LONG)
    draw_exponents(panels[5], found, figures[5], (), "all negative")
    return figure


PICTURES: dict[str, Callable[[], Any]] = {
    "linearization": linearization,
    "nctf": nctf,
    "system_1": system_1,
    "system_2": system_2,
    "plane": plane,
    "nctf_70": lambda: perturbed(70, ("3.19", "3.19", "3.20", "3.20", "3.20", "3.21")),
    "nctf_130": lambda: perturbed(130, ("3.22", "3.22", "3.23", "3.23", "3.23", "3.24")),
}


def save_all() -> None:
    """Draw all figures as PNG of 256 colours: a third of the size."""
    for name, draw in PICTURES.items():
        drawn = io.BytesIO()
        with mpl.rc_context({**STYLE, "font.size": 10}):
            draw().savefig(drawn, format="png", dpi=100)
        image = Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE)
        image.save(FOLDER / f"{name}.png", optimize=True)

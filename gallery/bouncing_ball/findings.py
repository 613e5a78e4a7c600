"""Final rest of a bouncing ball, here and in the table of the Reference-FMUs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..drawing import COLOURS, drawing, part
from ..finding import Finding, exponents, motion

BALL = part(__file__, "ball")
G, E, V_MIN = 9.81, 0.7, 0.1
TABLE = "BouncingBall_out.csv of the Reference-FMUs"
EULER = "their table is explicit Euler in steps of 1 ms; with it we get the same digits"
FIRST = math.sqrt(2.0 / G)  # until the first impact, from a height of 1 m [s]
ZENO = FIRST * (1.0 + E) / (1.0 - E)  # end of infinitely many bounces [s]

Vector = npt.NDArray[np.float64]


def table() -> tuple[Vector, Vector, Vector]:
    """Times, heights and velocities of the table, by its method: Euler, impacts at its steps."""
    step, x, v, g = 1e-3, 1.0, 0.0, G
    rows = [(x, v)]
    for _ in range(3000):
        x, v = x + step * v, v - step * g
        if x <= 0.0 and v < 0.0:
            x, v = 0.0, -E * v
            if v < V_MIN:
                v = g = 0.0
        rows.append((x, v))
    heights, velocities = np.array(rows[::10]).T
    return np.arange(301.0) * 0.01, heights, velocities


def rests_from(time: Vector, v: Vector) -> float:
    """Time after which the ball does not move [s]."""
    return float(time[np.flatnonzero(v)[-1] + 1])


def findings() -> list[Finding]:
    run, fine = motion(BALL, 3.0, 0.01), motion(BALL, 3.0, 1e-3, {"v_min": 1e-6})
    x, v = run.outputs["x"], run.outputs["v"]
    highest, rest = float(x[50:].max()), rests_from(fine.time, fine.outputs["v"])
    shrunk = float(exponents(BALL, 2.0).exponents.sum()) * 2.0
    area = "logarithm of the area of disturbances after four impacts [nats]"
    impacts = "each impact multiplies it by e^2, and flight leaves it"
    rebounds = int(np.sum((v[:-1] <= 0.0) & (v[1:] > 0.0)))
    first = rests_from(run.time, v)
    bounces = (
        f"so it still bounces after the time {ZENO:.4g} s, by which a ball without an end rule "
        "bounces infinitely often"
    )
    ends = (
        "sqrt(2 h/g) (1 + e)/(1 - e), the end of infinitely many bounces; those slower than v_min, "
        "and a row of 1 ms, are neglected"
    )
    left_out = 2e-6 / (G * (1.0 - E)) + 1e-3
    return [
        Finding("height at 1 s", float(x[100]), "m", TABLE, 0.236644, 1e-6, EULER),
        Finding("highest row after the first impact", highest, "m", TABLE, 0.494764, 1e-6, EULER),
        Finding("rebounds until it rests", rebounds, "1", TABLE, 11, 0, EULER),
        Finding("first row at rest", first, "s", TABLE, 2.61, 0.01, f"{EULER}; {bounces}"),
        Finding("rests from, with v_min = 1e-6 m/s", rest, "s", ends, ZENO, left_out),
        Finding(area, shrunk, "1", impacts, 8.0 * math.log(E), 1e-9),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (whole, end)):
        run, endless = motion(BALL, 3.0, 1e-3), motion(BALL, 3.0, 1e-3, {"v_min": 1e-4})
        time, rows, speeds = table()
        style = {"color": COLOURS[2], "lw": 1.2, "label": "solution, v_min = 0.1 mm/s"}
        end.plot(endless.time, 1e3 * endless.outputs["x"], **style)
        style = {"color": COLOURS[1], "ls": "--", "lw": 1.2, "ms": 4, "label": "table"}
        for axes, unit in ((whole, 1.0), (end, 1e3)):
            axes.plot(run.time, unit * run.outputs["x"], color=COLOURS[0], label="solution")
            axes.plot(time, unit * rows, ".", **style)
            axes.axvline(ZENO, color="black", ls=":", lw=1.4, label="end without an end rule")
        end.plot(rests_from(run.time, run.outputs["v"]), 0.0, "o", color=COLOURS[0], clip_on=False)
        end.plot(rests_from(time, speeds), 0.0, "s", color=COLOURS[1], clip_on=False)
        whole.set(xlabel="time [s]", ylabel="height [m]", xlim=(0.0, 2.8), ylim=(0.0, 1.02))
        end.set(xlabel="time [s]", ylabel="height [mm]", xlim=(2.2, 2.65), ylim=(0.0, 17.0))
        whole.set_title("Infinitely many bounces take 2.56 s")
        end.set_title("The table bounces on beyond their end")
        figure.legend(*end.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure

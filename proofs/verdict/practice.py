"""Limits of sampled, delayed and hunting loops.

Longest sampling periods and delays are found by bisection to a twentieth. The maps come from the
commands that are stored beside them; their pictures go into ``docs/images``.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ballscrew.cli import main as command
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.plant.instruments.encoder import encoder
from ballscrew.plant.instruments.late_command import with_late_command
from ballscrew.plant.instruments.measured_through import measured_through
from ballscrew.solver.component import Component, Parameter
from ballscrew.solver.kernel import IntegrationError, Kernel, Model
from ballscrew.solver.spectrum import follow_returns
from ballscrew.stability.lyapunov import held_loop_kernel

ROOT = Path(__file__).resolve().parents[2]
GOAL, BAND = 0.08, 0.02  # set-point [m]; share of it within which the position has to stay
SAMPLED = {"iol": "iol+sampled", "nctf": "nctf+sampled", "pid": "pid_sampled"}
SETTLED = 10.0  # more than twice the longest settling time [s]
RATIO = 1.05  # ratio of the shortest failing to the longest working value at the end of a search
SHORTEST, LONGEST = 2e-6, 10.0  # [s]
MAPS = {
    "hunting_of_the_sampled_pid": (
        "map --controller proofs/verdict/practice.py:pid_encoder --plant plant_classical "
        "--x Ki=0:4000:21 --y encoder_counts=1:41:21 --stop 60 --set plant.Fc=5 "
        "--set plant.Fs=25 --set controller.sample_time=0.005"
    ),
    "hunting_over_friction": (
        "map --controller pid --plant plant_classical --stop 60 --x plant.Fc=0.5:10:20 "
        "--y plant.Fs=10:60:21 --set controller.Ki=3000"
    ),
}


def pid_encoder() -> Component:
    """The digital PID that sees the counts of the rig's encoder."""
    counts = encoder()
    named = replace(counts, outputs=(replace(counts.outputs[0], name="x_measured"),))
    return measured_through(component("pid_sampled"), [named])


def stays(low: float, high: float) -> bool:
    return max(abs(low - GOAL), abs(high - GOAL)) <= BAND * GOAL


def bears_period(name: str, period: float) -> bool:
    """Whether a sampled controller moves the axis to its set-point and keeps it there."""
    kernel = held_loop_kernel("plant", SAMPLED[name])
    model = Model(kernel, {"controller_sample_time": period}, 1e-6)
    model.set_input("x_d", GOAL)
    place = [s.name for s in kernel.states].index("plant_x")
    spans = (0.0, SETTLED - 1), (SETTLED - 1, SETTLED)
    seen = [follow_returns(model, a, b, 0, np.inf, 0) for a, b in spans]
    if any(s.failure for s in seen):
        return False
    return stays(float(seen[1].low[place]), float(seen[1].high[place]))


@cache
def late_loop(name: str) -> Kernel:
    delay = Parameter("delay", 1e-3, "s", "delay of the command", "varied", minimum=1e-9)
    kernel = loop_kernel(with_late_command(component("plant"), delay), component(name))
    kernel.compile()
    return kernel


def bears_delay(name: str, delay: float) -> bool:
    """Whether a continuous controller does so with a delayed command."""
    model = Model(late_loop(name), {"plant_delay": delay}, 1e-6)
    model.set_input("x_d", GOAL)
    times = np.linspace(0.0, SETTLED, round(200 * SETTLED) + 1)
    try:
        x = model.simulate(times).outputs["x"][times >= SETTLED - 1.0]
    except IntegrationError:
        return False
    return stays(float(x.min()), float(x.max()))


BEARS = {"sampling_period": bears_period, "delay": bears_delay}


def longest(what: str, name: str) -> dict[str, float | None]:
    """The longest working time [s], and the shortest failing one."""
    borne, not_borne = 0.0, SHORTEST
    while BEARS[what](name, not_borne):
        borne, not_borne = not_borne, 4.0 * not_borne
        if not_borne > LONGEST:
            return {"borne_s": borne, "not_borne_s": None}
    if borne == 0.0:
        return {"borne_s": None, "not_borne_s": not_borne}
    while not_borne > RATIO * borne:
        middle = float(np.sqrt(borne * not_borne))
        borne, not_borne = (middle, not_borne) if BEARS[what](name, middle) else (borne, middle)
    return {"borne_s": borne, "not_borne_s": not_borne}


def mapped(name: str) -> dict[str, Any]:
    """The summary of a map; its picture is copied to the documentation."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(ROOT):
        out = Path(folder) / "map"
        if command([*MAPS[name].split(), "--out", str(out)]) not in (0, 1):
            raise RuntimeError(f"{MAPS[name]} failed")
        shutil.copyfile(out / "map.png", ROOT / "docs" / "images" / f"{name}.png")
        summary = json.loads((out / "map.json").read_text(encoding="utf-8"))
    return {"command": f"ballscrew {MAPS[name]}", "verdicts": summary["verdicts"]}


def tasks(asked: Namespace) -> dict[str, tuple[str, ...]]:
    limits = {f"{what} of {name}": (what, name) for name in SAMPLED for what in BEARS}
    return limits | {name: (name,) for name in MAPS}


def trial(what: str, name: str = "") -> tuple[str, str, dict[str, Any]]:
    return what, name, longest(what, name) if name else mapped(what)


def report(rows: Sequence[tuple[str, str, dict[str, Any]]]) -> dict[str, Any]:
    limits: dict[str, Any] = {}
    for what, name, found in rows:
        if name:
            limits.setdefault(name, {})[what] = found
    told = {"set_point_m": GOAL, "band": BAND, "within_s": SETTLED, "limits": limits}
    return told | {"maps": {what: found for what, name, found in rows if not name}}


def says(report: dict[str, Any]) -> str:
    found = ((n, limits.get("sampling_period", {})) for n, limits in report["limits"].items())
    periods = (f"{name} {of['borne_s']:.2g} s" for name, of in found if of.get("borne_s"))
    return f"longest sampling periods: {', '.join(periods)}"

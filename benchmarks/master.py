"""Cost of a communication step, and of a start, in one run: ``make bench``.

Every row is measured on the same machine in the same process, next to a pair of trivial FMUs on the
same master, which is what a step costs where nothing is computed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ballscrew.fmus.catalogue import fmu
from ballscrew.fmus.export import export
from ballscrew.orchestration.coupling import Coupling, Loop
from ballscrew.orchestration.participant import FmuParticipant
from ballscrew.orchestration.wiring import wire
from ballscrew.solver.component import Component, Input, Output, State, symbol


def trivial_pair(folder: Path) -> tuple[Path, Path]:
    """A plant and a controller with next to nothing inside, law ports and all."""
    x, u = symbol("x"), symbol("u")
    plant = Component(
        "trivial_plant",
        "x' = u - x",
        inputs=(Input("u", "1", "command", law=("x",)),),
        states=(State("x", "1", "state", u - x),),
        outputs=(Output("x", "1", "state", x),),
    )
    controller = Component(
        "trivial_controller",
        "u = x_d - x",
        inputs=(
            Input("x", "1", "state", role="measurement"),
            Input("x_d", "1", "goal", role="reference"),
        ),
        outputs=(Output("u", "1", "command", symbol("x_d") - x),),
    )
    return export(plant, folder / "plant.fmu"), export(controller, folder / "controller.fmu")


def step_cost(plant: Path, controller: Path, h: float, corrected: bool, seconds: float) -> float:
    """Microseconds per communication step of the tangent coupling, best of three."""
    import numpy as np

    best = float("inf")
    for _ in range(3):
        p, c = FmuParticipant(plant, "plant"), FmuParticipant(controller, "controller")
        p.initialize({}, seconds)
        c.initialize({}, seconds)
        goal = np.array([0.08])
        loop = Loop(p, c, wire(p, c), Coupling.TANGENT, corrected, True, goal)
        steps = round(seconds / h)
        start = time.perf_counter()
        for k in range(steps):
            loop.step(k * h, h, goal, goal)
        best = min(best, (time.perf_counter() - start) / steps)
        p.close()
        c.close()
    return 1e6 * best


def start_cost() -> tuple[float, float]:
    """Seconds until a fresh process has computed its first step, cold and warm."""
    code = (
        "from ballscrew.fmus.catalogue import fmu_kernel; "
        "from ballscrew.solver.kernel import Model; "
        "m = Model(fmu_kernel('plant')); m.set_input('u', 30.0); m.advance(0.0, 1e-3)"
    )
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"BALLSCREW_CACHE": folder}
        for _ in range(4):
            start = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True, env=environment)
            seconds.append(time.perf_counter() - start)
    return seconds[0], min(seconds[1:])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        pair = trivial_pair(Path(folder))
        base = {c: step_cost(*pair, 1e-3, c, 5.0) for c in (False, True)}
        print(f"{'loop':<34}{'us/step':>10}{'ratio to trivial pair':>24}")
        for label, name, h, corrected in (
            ("trivial pair", "", 1e-3, False),
            ("trivial pair, corrected", "", 1e-3, True),
            ("iol at 1e-3 s", "iol", 1e-3, False),
            ("iol at 1e-3 s, corrected", "iol", 1e-3, True),
            ("nctf at 1e-4 s", "nctf", 1e-4, False),
            ("nctf at 1e-4 s, corrected", "nctf", 1e-4, True),
        ):
            cost = (
                step_cost(fmu("plant"), fmu(name), h, corrected, 5.0 if h > 5e-4 else 1.0)
                if name
                else base[corrected]
            )
            print(f"{label:<34}{cost:>10.1f}{cost / base[corrected]:>24.2f}")
    cold, warm = start_cost()
    print(f"\nfirst step in a fresh process: {cold:.2f} s cold (compiles), {warm:.2f} s warm")


if __name__ == "__main__":
    main()

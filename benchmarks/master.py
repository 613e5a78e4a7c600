"""Cost of a communication step, and of a start: ``make bench``.

Every row is measured on the same machine in the same process, next to a pair of trivial FMUs on the
same master, which gives the cost of a step without computations.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from other_masters import TimedChain, TimedLoop, link, side_by_side

from ballscrew.fmus.export import export
from ballscrew.fmus.native.export import export_native
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.fmu.group import Feed, Group
from ballscrew.orchestration.fmu.isolated import open_fmu
from ballscrew.orchestration.fmu.wiring import Wiring
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.march import Clock, Record, march_on
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides
from ballscrew.solver.component import Component, Input, Output, State, symbol

COLUMNS = {
    "ours": "ours",
    "corrected": "ours, corrected",
    "judged": "ours, judged",
    "isolated": "ours, isolated",
    "libcosim": "libcosim, 1 core",
    "ecos": "ecos, 1 core",
    "container": "container, 1 core",
}


def trivial_pair(folder: Path) -> tuple[Path, Path]:
    """A plant and a controller with almost no computations, but with law ports."""
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


def step_cost(
    plant: Path,
    controller: Path,
    h: float,
    corrected: bool,
    seconds: float,
    isolate: bool = False,
) -> float:
    """Microseconds per communication step of the interface-Jacobian coupling, best of three.

    Without the rungs for the verdict, which other masters do not have.
    """
    best = math.inf
    goal = Reference.constant(0.08)
    for _ in range(3):
        p, c = (open_fmu(path, path.stem, isolate) for path in (plant, controller))
        sides = Sides(p, c, goal, seconds, Coupling.INTERFACE_JACOBIAN, int(corrected))
        main = sides.main()
        record = Record(main, goal, (0,))
        began = perf_counter()
        march_on(main, Clock(seconds, h), record)
        best = min(best, (perf_counter() - began) / (seconds / h))
        assert not main.failure
        p.close()
        c.close()
    return 1e6 * best


def judged_cost(plant: Path, controller: Path, h: float, seconds: float) -> float:
    """Microseconds per step of a complete run: corrected, with its rungs and opening of files."""
    best = math.inf
    for _ in range(3):
        began = perf_counter()
        p, c = (open_fmu(path, path.stem, False) for path in (plant, controller))
        run_loop(Sides(p, c, Reference.constant(0.08), seconds), h)
        best = min(best, (perf_counter() - began) / (seconds / h))
        p.close()
        c.close()
    return 1e6 * best


def _opened(chain: TimedChain) -> tuple[FmuInstance, Group, Wiring]:
    """The first mass as the plant, the others as the group, as in `run --system`."""
    plant = FmuInstance(chain.link, "plant")
    rest = {name: FmuInstance(chain.link, name) for name in chain.names[1:]}
    feeds = [
        Feed(".".join(source), *target)
        for source, target in chain.connections()
        if target[0] in rest
    ]
    wiring = Wiring(
        commands=(("m1.x", "after"),),
        signals=(("x", "plant.x"),),
        references=(),
        others=tuple(f"{name}.x" for name in rest),
        network=True,
    )
    return plant, Group("controller", rest, feeds, ["plant.x"]), wiring


def chain_cost(chain: TimedChain, judged: bool = False) -> float:
    """Microseconds per step of a chain, best of three; `judged`: with the rungs of the verdict."""
    best, still = math.inf, Reference.constant(0.0)
    values = {"push": 100.0}, {}
    for _ in range(3):
        began = perf_counter()
        plant, group, wiring = _opened(chain)
        scheme = Coupling.GAUSS_SEIDEL
        sides = Sides(plant, group, still, chain.stop, scheme, values=values, wiring=wiring)
        if judged:
            run_loop(sides, chain.step)
        else:
            main = sides.main()
            record = Record(main, still, ())
            began = perf_counter()
            march_on(main, Clock(chain.stop, chain.step), record)
            assert not main.failure
        best = min(best, (perf_counter() - began) / (chain.stop / chain.step))
        plant.close()
        group.close()
    return 1e6 * best


def networks(folder: Path) -> None:
    """Print the cost of a step of 3, 10 and 20 native FMUs here and elsewhere, and the ratios."""
    made = export_native(link(), folder / "link.fmu").path
    chains = {f"chain of {n}": TimedChain(made, n, 1e-3, 2.0) for n in (3, 10, 20)}
    costs = side_by_side(chain_cost, chains, ("libcosim", "ecos"))
    columns = [c for c in COLUMNS if c in next(iter(costs.values()))]
    print("\nmicroseconds per communication step of native FMUs; in brackets: ratio to ours")
    print(f"{'network':<16}" + "".join(f"{COLUMNS[c]:>22}" for c in [*columns, "judged"]))
    for name, row in costs.items():
        row["judged"] = chain_cost(chains[name], judged=True)
        cells = [f"{row[c]:.1f} ({row[c] / row['ours']:.2f})" for c in [*columns, "judged"]]
        print(f"{name:<16}" + "".join(f"{cell:>22}" for cell in cells))


def start_cost() -> tuple[float, float]:
    """Seconds until a fresh process has computed its first step, cold and warm."""
    code = (
        "from ballscrew.orchestration.loop.catalogue import fmu_kernel; "
        "from ballscrew.solver.kernel import Model; "
        "m = Model(fmu_kernel('plant')); m.set_input('u', 30.0); m.advance(0.0, 1e-3)"
    )
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"BALLSCREW_CACHE": folder}
        for _ in range(4):
            start = perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True, env=environment)
            seconds.append(perf_counter() - start)
    return seconds[0], min(seconds[1:])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        trivial = trivial_pair(Path(folder))
        loops = {
            "trivial pair": TimedLoop(*trivial, 1e-3, 5.0),
            "iol at 1e-3 s": TimedLoop(fmu("plant"), fmu("iol"), 1e-3, 5.0),
            "nctf at 1e-4 s": TimedLoop(fmu("plant"), fmu("nctf"), 1e-4, 1.0),
        }
        costs = side_by_side(
            lambda loop: step_cost(loop.plant, loop.controller, loop.step, False, loop.stop), loops
        )
        for name, loop in loops.items():
            costs[name]["corrected"] = step_cost(
                loop.plant, loop.controller, loop.step, True, loop.stop
            )
            costs[name]["judged"] = judged_cost(loop.plant, loop.controller, loop.step, loop.stop)
            costs[name]["isolated"] = step_cost(
                loop.plant, loop.controller, loop.step, False, 0.2 * loop.stop, isolate=True
            )
    columns = [c for c in COLUMNS if c in next(iter(costs.values()))]
    print("microseconds per communication step, feedback law wired; in brackets: ratio to the same")
    print("master's trivial pair")
    print(f"{'loop':<16}" + "".join(f"{COLUMNS[c]:>22}" for c in columns))
    for name, row in costs.items():
        cells = [f"{row[c]:.1f} ({row[c] / costs['trivial pair'][c]:.2f})" for c in columns]
        print(f"{name:<16}" + "".join(f"{cell:>22}" for cell in cells))
    with tempfile.TemporaryDirectory() as made:
        networks(Path(made))
    cold, warm = start_cost()
    print(f"\nfirst step in a fresh process: {cold:.2f} s cold (compiles), {warm:.2f} s warm")


if __name__ == "__main__":
    main()

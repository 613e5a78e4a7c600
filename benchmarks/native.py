"""Native FMUs and the pythonfmu build: cost of a step, size, time to export.

``python benchmarks/native.py``. Every row is measured on the same machine in the same process. Each
round runs every program, so that other load on the machine affects all of them.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
import zipfile
from importlib.util import find_spec
from pathlib import Path

import master
from other_masters import TimedLoop, missing_for_ecos, step_cost

from ballscrew.fmus.native.export import write_native
from ballscrew.orchestration.loop.catalogue import NAMES, catalogued_model, fmu
from ballscrew.solver.compilers import PLATFORMS, own_platform, platforms_of

ROUNDS = 3
SECONDS = {"iol at 1e-3 s": ("iol", 1e-3, 5.0), "nctf at 1e-4 s": ("nctf", 1e-4, 1.0)}


def ours(loop: TimedLoop) -> float:
    """Microseconds per step of our master on one core, like the others."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        return master.step_cost(loop.plant, loop.controller, loop.step, False, loop.stop)
    finally:
        os.sched_setaffinity(0, allowed)


def steps(native: dict[str, Path]) -> None:
    hosts = ["libcosim"] if missing_for_ecos() else ["libcosim", "ecos"]
    print("microseconds per communication step, feedback law wired, one core")
    columns = ["ours, pythonfmu", "ours, native", *(f"{host}, native" for host in hosts)]
    print(f"{'loop':<16}" + "".join(f"{column:>18}" for column in columns) + f"{'gain':>8}")
    for name, (controller, step, stop) in SECONDS.items():
        python = TimedLoop(fmu("plant"), fmu(controller), step, stop)
        compiled = TimedLoop(native["plant"], native[controller], step, stop)
        best = [math.inf] * len(columns)
        for _ in range(ROUNDS):
            row = [ours(python), ours(compiled), *(step_cost(host, compiled) for host in hosts)]
            best = [min(a, b) for a, b in zip(best, row, strict=True)]
        gain = best[0] / best[1]
        print(f"{name:<16}" + "".join(f"{value:>18.1f}" for value in best) + f"{gain:>7.1f}x")


def exports(folder: Path) -> dict[str, Path]:
    """Export everything, print times and sizes; return the FMUs by name."""
    platforms = platforms_of(2) if find_spec("ziglang") else [own_platform()]
    print(
        f"\n{'component':<26}{'cold [s]':>10}{'warm [s]':>10}{'FMI 3 [s]':>11}{'FMU [kB]':>10}",
        end="",
    )
    print("".join(f"{platform + ' [kB]':>15}" for platform in platforms))
    made = {}
    for name in NAMES:
        taken = []
        for fmi, target in ((2, "cold"), (2, name), (3, "three")):
            start = time.perf_counter()
            written = write_native(catalogued_model(name), folder / f"{target}.fmu", fmi)
            taken.append(time.perf_counter() - start)
            if target == name:
                made[name] = written.path
        size = made[name].stat().st_size / 1000
        print(f"{name:<26}{taken[0]:>10.2f}{taken[1]:>10.2f}{taken[2]:>11.2f}{size:>10.1f}", end="")
        every = write_native(catalogued_model(name), folder / "all.fmu", 2, platforms).path
        with zipfile.ZipFile(every) as archive:
            packed = {i.filename: i.compress_size for i in archive.infolist()}
        binaries = {n.split("/")[1]: s for n, s in packed.items() if n.startswith("binaries/")}
        print("".join(f"{binaries[PLATFORMS[p].folder[2]] / 1000:>15.1f}" for p in platforms))
    return made


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        print("export: seconds, and sizes as they lie in the FMU")
        native = exports(Path(folder))
        print()
        steps(native)


if __name__ == "__main__":
    main()

"""Commands, FMUs from equations, and FMUs of others: what it takes until they run."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import by_hand
import fmpy
import numpy as np
import small_fmus
from reference_fmus import reference_fmu, reference_result
from report import OURS, Cost, Program, Works, missing, timed

import ballscrew
from ballscrew.solver.component import Component, Output, State, symbol

COMMANDS = {
    "--version": "--version",
    "run": "run --controller iol --stop 5 --out out",
    "run, two FMUs of others, 1 s": "run --plant cart.fmu --controller pd.fmu --stop 1 --out out",
    "swap": "swap --controllers iol nctf pid --stop 4 --out out",
    "lyapunov": "lyapunov --controller nctf --stop 20 --out out",
    "map, 25 cells": (
        "map --controller iol --x sigma0_hat=66966:66967:5 --y sigma1_hat=340:367:5 --stop 5 "
        "--out out"
    ),
    "export of all parts": "export --out out",
    "export --native of all parts": "export --native --out out",
}


def pair_of_others(folder: Path) -> tuple[Path, Path]:
    """A cart and its controller, compiled from a few lines of C."""
    paths = folder / "cart.fmu", folder / "pd.fmu"
    small_fmus.plant(str(paths[0]))
    small_fmus.pd(str(paths[1]))
    return paths


def commands(folder: Path) -> Works:
    """Complete commands

    Processor time of the command and of all processes that it starts: with a filled cache, and
    the first time after installation, with an empty one.
    """
    pair_of_others(folder)

    def cost(words: str, cache: str) -> Cost:
        environment = os.environ | {"HOME": str(folder), "BALLSCREW_CACHE": cache}
        environment.pop("XDG_CACHE_HOME", None)
        before = os.times()
        words = words.replace("--out out", f"--out {tempfile.mkdtemp(dir=folder)}")
        command = [sys.executable, "-m", "ballscrew", *words.split()]
        done = subprocess.run(command, env=environment, cwd=folder, capture_output=True)
        after = os.times()
        assert done.returncode in (0, 1), done.stderr  # 1: computed, but not trusted
        user = after.children_user - before.children_user
        return Cost(user + after.children_system - before.children_system)

    def first(words: str) -> Cost:
        with tempfile.TemporaryDirectory() as empty:
            return cost(words, empty)

    again = partial(cost, cache=str(folder / "cache"))
    for words in COMMANDS.values():
        again(words)
    return {
        name: {OURS: partial(again, words), "the first time": partial(first, words)}
        for name, words in COMMANDS.items()
    }


def van_der_pol(name: str) -> Component:
    x, v = symbol("x"), symbol("v")
    rates = {"x": (v, 2.0), "v": ((1 - x * x) * v - x, 0.0)}
    return Component(
        name,
        "Van der Pol's oscillator",
        states=tuple(State(n, "1", n, rate, start=start) for n, (rate, start) in rates.items()),
        outputs=(Output("y", "1", "position", x),),
    )


def compiled(files: list[str], library: str) -> None:
    """A library from C files in the present folder."""
    headers = Path(fmpy.__file__).parent / "c-code"
    command = ["gcc", "-O2", "-shared", "-fPIC", "-I.", f"-I{headers}", *files]
    subprocess.run([*command, "-o", library, "-lm"], check=True)


def by_casadi(folder: Path) -> None:
    """FMU by CasADi: it writes C and a description, which the user compiles and packs."""
    import casadi

    model = casadi.DaeBuilder("vanderpol")
    model.add("time", "independent")
    x, v = (model.add(n, "output", "continuous", {"start": s}) for n, s in (("x", 2.0), ("v", 0.0)))
    model.eq(model.der(x), v)
    model.eq(model.der(v), (1 - x * x) * v - x)
    with contextlib.chdir(folder):
        files = model.export_fmu()
        compiled([f for f in files if f.endswith(".c")], "vanderpol.so")
        with zipfile.ZipFile("vanderpol.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
            for name in files:
                archive.write(name, name if name.endswith(".xml") else f"sources/{name}")
            archive.write("vanderpol.so", "binaries/x86_64-linux/vanderpol.so")


def preparing(folder: Path) -> Works:
    """From equations to a compiled FMU

    Van der Pol's oscillator as an FMU of FMI 3.0. That of CasADi is for model exchange alone; ours
    is for co-simulation, too.
    """
    fresh = (van_der_pol(f"vanderpol{k}") for k in itertools.count())  # in no cache
    programs: dict[str, Program] = {
        OURS: lambda: ballscrew.export(next(fresh), folder / "vdp.fmu", native=True, fmi=3),
        "CasADi": missing("casadi") or partial(by_casadi, folder),
    }
    return {"Van der Pol": programs}


def reference(folder: Path, name: str) -> dict[str, Program]:
    """A Reference FMU in this program and in FMPy; its binary is compiled here, untimed."""
    path = reference_fmu(folder, name, 2)
    with zipfile.ZipFile(path, "a") as archive, contextlib.chdir(folder):
        archive.extractall(name)
        with contextlib.chdir(Path(name) / "sources"):
            compiled(["all.c"], f"{name}.so")
            archive.write(f"{name}.so", f"binaries/linux64/{name}.so")
    truth = reference_result(name)
    stop, signal = truth["time"][-1], list(truth)[1]

    def here() -> tuple[object, object]:
        run = ballscrew.run("none", plant=path, stop=stop, step=stop / 1000).run
        return run.time, run.outputs[signal]

    def there() -> tuple[object, object]:
        found = fmpy.simulate_fmu(str(path), stop_time=stop, output_interval=stop / 1000)
        return found["time"], found[signal]

    def cost(run: Callable[[], tuple[object, object]]) -> Cost:
        took, course = timed(run)
        off = np.abs(np.interp(truth["time"], *course) - truth[signal]).max()
        return Cost(took, f"off by {off:.1e} at most")

    return {OURS: partial(cost, here), "FMPy": partial(cost, there)}


def loading(folder: Path) -> Works:
    """FMUs of others, loaded and run

    A thousand steps each. Off: from the exact course, or from the result that is published with a
    Reference FMU. This program runs FMUs of others in processes of their own, tries whether their
    states come back, and checks the run; FMPy does none of these.
    """
    plant, controller = pair_of_others(folder)
    goals, step = np.full(1001, 0.1), 1e-3
    names = "Dahlquist", "VanDerPol", "BouncingBall"
    return {
        "two FMUs, 1 s": {
            OURS: lambda: ballscrew.run(controller, plant, 0.1, 1.0, step=step),
            "FMPy by hand": lambda: by_hand.run(plant, controller, goals, step),
        },
        **{f"Reference FMU {name}": reference(folder, name) for name in names},
    }


TABLES = commands, preparing, loading

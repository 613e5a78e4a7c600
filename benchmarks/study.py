"""Time of a swap study: 10 controllers, 20 duties and 50 plants, 5 s each at 1 kHz.

    python benchmarks/study.py

First, one run is compared with programs that a user could write instead, each the best of three
rounds in this process. Then all 10 000 runs are computed as in a study, on two processes, without
tuning and without the runs over FMUs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import fmpy
import numpy as np
import numpy.typing as npt
from fmpy.fmi2 import FMU2Slave
from fmpy.simulation import instantiate_fmu
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.orchestration.loop.catalogue import component, fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.reference_motions import as_reference
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Tuning, Variation
from ballscrew.orchestration.study.run import StudyLoop
from ballscrew.orchestration.study.study import Work
from ballscrew.orchestration.study.workers import Processes

Vector = npt.NDArray[np.float64]

PERIOD, STOP = 1e-3, 5.0  # s
AIM = 600.0  # for all runs [s]
ROUNDS = 3
MOVE = "move:distance={},speed=0.08,acceleration=0.8,jerk=20"
ENTRANTS = (
    "iol iol_observed nctf pid p_pi pid_dob pid_lugre lqi adaptive_friction fuzzy_pd_i"
).split()
SIZES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 8e-2)  # m
WAVES = (
    "sine:amplitude=1e-3,frequency=2 sine:amplitude=1e-4,frequency=5 "
    "sine:amplitude=1e-2,frequency=1 sine:amplitude=1e-5,frequency=1 "
    "triangle:amplitude=1e-4,period=1 triangle:amplitude=1e-3,period=1 "
    "triangle:amplitude=1e-2,period=2 triangle:amplitude=1e-5,period=1"
).split()


def plan() -> Plan:
    """The study: real instruments, friction, payload and resistance varied."""
    motions = [MOVE.format(sign * size) for size in SIZES for sign in (1, -1)]
    motions += [f"{wave},duration={STOP:g}" for wave in WAVES]
    return Plan(
        plant="plant",
        entrants=tuple(Entrant(name, name) for name in ENTRANTS),
        duties=(
            Duty("to tune on", MOVE.format(0.02), STOP, tune=True),
            *(Duty(motion, motion, STOP) for motion in motions),
        ),
        variations=(
            Variation(("Fc", "Fs", "sigma2"), (0.7, 1.3)),
            Variation(("m",), (1.0, 1.5)),
            Variation(("R",), (1.0, 1.2)),
        ),
        tuning=Tuning(budget=1, plants=0, seeds=1),
        plants=50,
        period=PERIOD,
        instruments=("position_encoder", "velocity_estimate", "current_sensor"),
    )


def whole_study() -> None:
    """Time all runs of the study."""
    asked = plan()
    runs = len(asked.entrants) * len(asked.judged_duties) * asked.plants

    def progress(stage: str, done: int, total: int) -> None:
        if done % 100 == 0:
            print(f"  {stage}: {done} of {total} tasks", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        began = perf_counter()
        work = Work.of(asked, Path(folder), Processes(2), progress)
        compiled = perf_counter() - began
        began = perf_counter()
        figures = work.figures(work.tunings())
        took = perf_counter() - began
    failed = int(figures["failed"].sum())
    verdict = "met" if took <= AIM else "MISSED"
    print(f"{runs} runs of {STOP:g} s at {1 / PERIOD:g} Hz: {took:.0f} s on two processes, the aim")
    print(f"of {AIM:g} s is {verdict}; {failed} runs failed; loops made in {compiled:.1f} s before")


def by_hand_with_fmpy(plant: Path, controller: Path, goal: Vector) -> Vector:
    """The usual loop of co-simulation tutorials: one part after the other."""
    units = []
    for path in (plant, controller):
        about = fmpy.read_model_description(path)
        unit: FMU2Slave = instantiate_fmu(fmpy.extract(path), about, "CoSimulation")
        unit.setupExperiment(startTime=0.0, stopTime=STOP)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        units.append((unit, {v.name: v.valueReference for v in about.modelVariables}))
    (axis, of_axis), (law, of_law) = units
    ins, outs = [of_law["x_d"], of_law["x"]], [of_axis["x"]]
    position = np.zeros(len(goal))
    for k, x_d in enumerate(goal[:-1]):
        law.setReal(ins, [x_d, position[k]])
        law.doStep(k * PERIOD, PERIOD)
        axis.setReal([of_axis["u"]], law.getReal([of_law["u"]]))
        axis.doStep(k * PERIOD, PERIOD)
        position[k + 1] = axis.getReal(outs)[0]
    for unit, _ in units:
        unit.terminate()
        unit.freeInstance()
    return position


def by_hand_with_scipy(goal: Vector) -> Vector:
    """The equations written out in Python, solved from sample to sample."""
    v = {p.name: p.default for p in (*component("plant").all_parameters, *gains())}
    turns = 2 * np.pi * v["p"]
    mass = v["m"] + v["Jm"] * turns**2

    def rates(_t: float, y: Vector, u: float) -> list[float]:
        _, speed, current, z = y
        sign = 2 / np.pi * np.arctan(v["Kv"] * speed)
        steady = v["Fc"] + (v["Fs"] - v["Fc"]) * np.exp(-((speed / v["Vs"]) ** 2))
        z_rate = sign**2 * speed - v["sigma0"] * sign * speed / steady * z
        friction = v["sigma0"] * z + v["sigma1"] * z_rate + v["sigma2"] * speed
        return [
            speed,
            (v["kt"] * turns * current - friction) / mass,
            (u - v["R"] * current - v["ke"] * turns * speed) / v["L"],
            z_rate,
        ]

    y, total, last = np.zeros(4), 0.0, 0.0
    position = np.zeros(len(goal))
    for k, x_d in enumerate(goal[:-1]):
        error, speed = x_d - y[0], (y[0] - last) / PERIOD
        u = v["Kp"] * error + v["Ki"] * total - v["Kd"] * speed
        total, last = total + PERIOD * error, y[0]
        y = solve_ivp(
            rates, (0.0, PERIOD), y, "LSODA", args=(u,), rtol=1e-6, atol=[1e-9, 1e-9, 1e-8, 1e-11]
        ).y[:, -1]
        position[k + 1] = y[0]
    return position


def gains() -> tuple[object, ...]:
    return component("pid_sampled").all_parameters


def one_run() -> None:
    """One run of the digital PID, by all programs."""
    motion = MOVE.format(0.02)
    reference = as_reference(motion)
    assert reference is not None
    time = np.arange(round(STOP / PERIOD) + 1) * PERIOD
    goal = reference.on(time, 0)
    loop = StudyLoop(loop_kernel(component("plant"), component("pid_sampled")))

    def over_fmus(goal: Reference) -> Vector:
        study = Loop("pid_sampled", "plant", goal, stop=STOP, step=PERIOD, isolate=False)
        return np.asarray(run_closed_loop(study).run.outputs["x"])

    with tempfile.TemporaryDirectory() as folder:
        native = [
            ballscrew.export(name, Path(folder) / f"{name}.fmu", native=True)
            for name in ("plant", "pid_sampled")
        ]
        readable = [fmu(name) for name in ("plant", "pid_sampled")]
        programs: dict[str, Callable[[], Vector]] = {
            "a run of a study": lambda: loop.run({}, (reference, STOP)).position,
            "our master over FMUs, judged": lambda: over_fmus(reference),
            "fmpy by hand, native FMUs": lambda: by_hand_with_fmpy(*native, goal),
            "fmpy by hand, pythonfmu": lambda: by_hand_with_fmpy(*readable, goal),
            "scipy's LSODA by hand": lambda: by_hand_with_scipy(goal),
        }
        took = dict.fromkeys(programs, np.inf)
        positions = {}
        for _ in range(ROUNDS):
            for name, program in programs.items():
                began = perf_counter()
                positions[name] = program()
                took[name] = min(took[name], perf_counter() - began)
    exact = loop.run({}, (reference, STOP), 1e-11).position
    best = took["a run of a study"]
    print(f"one run: pid_sampled, {motion}, {STOP:g} s at {1 / PERIOD:g} Hz")
    print(f"{'':32}{'time [ms]':>12}{'times ours':>12}{'off by [m]':>12}")
    for name, seconds in took.items():
        at = np.linspace(0.0, STOP, len(positions[name]))
        apart = np.abs(np.interp(time, at, positions[name]) - exact).max()
        print(f"{name:32}{1e3 * seconds:>12.1f}{seconds / best:>12.1f}{apart:>12.1e}")


def main() -> None:
    one_run()
    whole_study()


if __name__ == "__main__":
    main()

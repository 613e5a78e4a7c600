"""Run a trial on the rig: the plant in one solver, instruments and controller at 200 Hz."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ...plant.instruments.acquisition import SAMPLE_TIME, filter_lag
from ...solver.core import DONE, NOT_FINITE, at
from ...solver.errors import BadParameter
from ...solver.kernel import MAX_STEPS, IntegrationError, Model, describe_failure
from .calibration import POINTS
from .compiled_rig import plant_kernel, program_kernel
from .machine import Machine, machine_of
from .noise import Noise
from .parameters import TRIAL
from .record import TrialRecord
from .rig_trials import VELOCITY, Trial, trials_named
from .rig_wiring import COMMAND, PLANT, REFERENCE
from .setup import Setup, set_up

if TYPE_CHECKING:
    from ...orchestration.loop.parameter_file import ParameterFile


Vector = npt.NDArray[np.float64]
TOLERANCE = 1e-6
"""Relative tolerance of the solver; its error is far below the instruments' steps."""


def run_trial(
    trial: Trial | str,
    law: str = "modified_lugre",
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: Noise | None = None,
    tolerance: float = TOLERANCE,
    progress: Callable[[float], None] | None = None,
    told: ParameterFile | None = None,
) -> TrialRecord:
    """Run one trial and record it.

    Parameters
    ----------
    trial : Trial or str
        One of `trials.TRIALS`, or its name.
    law : str
        One of `plant.LAWS`.
    parameters : mapping of str to float, optional
        Values other than nominal: ``plant.sigma0`` or plain ``sigma0`` for the plant and its
        friction law, ``load_cell.resolution`` and so on for the other parts.
    seed : int
        Seed of all noise.
    noise : Noise, optional
    tolerance : float
        Relative tolerance of the solver.
    progress : function of time [s], optional
        Called repeatedly.
    told : ParameterFile, optional
        The machine and its values; `parameters` have priority. Default: the axis of the thesis.

    Returns
    -------
    TrialRecord

    Raises
    ------
    BadParameter, UnknownName, BadParameter, BadParameters
        For invalid names and values.
    IntegrationError
        If the motion cannot be computed.
    """
    machine = machine_of(law, parameters, told)
    setup = set_up(one_trial(trial, machine), machine, parameters, seed, noise, told)
    return _finish(setup, *_run(setup, tolerance, progress), tolerance)


def one_trial(trial: Trial | str, machine: Machine) -> Trial:
    """The machine's trial of this name; it must be a single trial, not a table.

    Raises
    ------
    BadParameter
    """
    if isinstance(trial, Trial):
        return trial
    found = trials_named(trial, machine.trials)
    if len(found) > 1:
        raise BadParameter(f"{trial!r} is a table of {len(found)} trials; run them one by one")
    return found[0]


# -- running -----------------------------------------------------------------------------------


def _run(
    setup: Setup, tolerance: float, progress: Callable[[float], None] | None
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Run the trial; return the columns of the record and of the true signals."""
    trial, machine = setup.trial, setup.machine
    plant = Model(plant_kernel(machine.law, machine.kind), setup.values_of(PLANT), tolerance)
    values = {
        f"{part.name}_{name}": value
        for part in setup.wiring.parts
        for name, value in setup.values_of(part.name).items()
    }
    program = Model(program_kernel(trial.control, machine.is_axis), values)
    given = [i.name for i in program.kernel.inputs]
    outputs = [o.name for o in plant.kernel.outputs]
    measured = [k for k, name in enumerate(given) if name.startswith(f"{PLANT}_")]
    places = [outputs.index(given[k].removeprefix(f"{PLANT}_")) for k in measured]
    outside = [k for k in range(len(given)) if k not in measured]
    external = np.column_stack([setup.external[given[k]] for k in outside])
    end = len(given)

    time = trial.time
    taps = np.empty((len(time), len(program.kernel.outputs)))
    true = np.empty((len(time), len(outputs)))
    y, held = np.empty(len(outputs)), np.empty(len(program.kernel.discrete))
    # fixed arrays are passed by address, because of thousands of short calls
    axis = plant.system.instance(plant.x, plant.u, plant.p, y, plant.atol, plant.info)
    working = at(program.x), at(program.u), at(program.p)
    at_held, at_taps = at(held), at(taps)
    names = [o.name for o in program.kernel.outputs]
    command = names.index(COMMAND) if COMMAND in names else -1
    reference = setup.external[REFERENCE[trial.control]]
    at_u = [i.name for i in plant.kernel.inputs].index(COMMAND)
    for k, t in enumerate(time):
        axis.out(t)
        program.u[measured] = y[places]
        program.u[outside] = external[k]
        program.system.sample(t, *working, at_held)
        program.u[end:] = held
        program.system.out(t, *working, at_taps + k * taps.strides[0])
        plant.u[at_u] = taps[k, command] if command >= 0 else reference[k]
        # again, because the voltage at the motor follows the new command immediately
        axis.out(t)
        true[k] = y
        if k + 1 < len(time):
            status = axis.advance(t, time[k + 1], tolerance, MAX_STEPS)
            if status not in (DONE, NOT_FINITE):  # the latter is reported below, with its time
                raise IntegrationError(
                    describe_failure(plant.kernel.name, status, plant.info, time[k + 1])
                )
        if progress and k % 200 == 0:
            progress(float(t))
    broken = ~np.isfinite(true).all(axis=1)
    if broken.any():
        when = time[int(np.argmax(broken))]
        raise IntegrationError(f"{plant.kernel.name}: not finite at t = {when:.9g} s")
    columns = {name: taps[:, j] for j, name in enumerate(names)}
    if command < 0:
        columns[COMMAND] = reference
    truth = {name: true[:, j] for j, name in enumerate(outputs)}
    return columns, truth


def _finish(
    setup: Setup, taps: dict[str, Vector], truth: dict[str, Vector], tolerance: float
) -> TrialRecord:
    """Put columns in order and add notes on results that are not trusted."""
    trial = setup.trial
    time = trial.time
    order = ["x", *(["x_fine"] if trial.fine else []), "force", "u"]
    columns = {"time": time} | {name: taps[name] for name in order}
    name = REFERENCE[trial.control]
    if name != "u_ref":
        columns[name] = setup.external[name]
    columns |= {name: taps[name] for name in ("x_filtered", "force_filtered")}
    first = [n for n in ("x", "v", "friction", "force", "i") if n in truth]
    rest = [n for n in truth if n not in (*first, "voltage")]
    real = {"time": time} | {n: truth[n] for n in first}
    real |= {"u": truth["voltage"]} | {n: truth[n] for n in rest}
    settings = {
        "seed": setup.seed,
        "tolerance": tolerance,
        "noise": asdict(setup.noise),
        "sample_time": SAMPLE_TIME,
        "lags": lags(setup),
    }
    notes = _notes(setup, columns, real)
    return TrialRecord(
        trial,
        setup.machine,
        columns,
        real,
        setup.parameters,
        settings,
        notes,
        setup.calibration if trial.fine else None,
        setup.used,
    )


def lags(setup: Setup) -> dict[str, float]:
    """Delays of the recorded columns relative to the true signals, and of the command [s].

    Readings have the time stamp of their sample instant: without a filter they have no delay.
    """
    values = setup.parameters
    found = {
        "x": 0.0,
        "force": 0.0,
        "command_held": SAMPLE_TIME / 2,
    }
    for column, part in (("x_filtered", "position_filter"), ("force_filtered", "force_filter")):
        found[column] = filter_lag(values[f"{part}.cutoff"], values[f"{part}.damping"])
    if setup.trial.control == VELOCITY:
        found["velocity_difference"] = SAMPLE_TIME / 2
    if setup.trial.fine:
        samples = math.ceil(values["capacitance_sensor.samples"])
        # the mean of a conversion is delayed by half of it, and is held for the time of a
        # conversion
        found["x_fine"] = (samples - 1) * SAMPLE_TIME
    return found


def _notes(setup: Setup, record: dict[str, Vector], truth: dict[str, Vector]) -> list[str]:
    values, time, notes = setup.parameters, setup.trial.time, []
    unit = setup.machine.unit

    def since(late: npt.NDArray[np.bool_]) -> str:
        return f"from t = {time[int(np.argmax(late))]:.3f} s"

    clipped = np.abs(record["force"]) >= values["load_cell.capacity"]
    if clipped.any():
        capacity = values["load_cell.capacity"]
        end = f"{capacity:.4g} {unit('N')}"
        notes.append(f"the load cell is at the limit of its range, {end}, {since(clipped)}")
    limited = np.abs(record["u"]) >= values[f"{PLANT}.voltage_limit"]
    if limited.any():
        limit = values[f"{PLANT}.voltage_limit"]
        notes.append(f"the amplifier is at its limit, {limit:g} {unit('V')}, {since(limited)}")
    travel = values[f"{TRIAL}.travel"]
    beyond = np.abs(truth["x"]) > travel
    if beyond.any():
        notes.append(f"the block exceeds its travel, {travel:g} {unit('m')}, {since(beyond)}")
    if "x_fine" in record:
        out = (truth["x"] < -POINTS[1] / 2) | (truth["x"] > POINTS[-1])
        if out.any():
            notes.append(
                f"the capacitance sensor is out of its calibrated {1e6 * POINTS[-1]:g} um "
                f"{since(out)}"
            )
    return notes

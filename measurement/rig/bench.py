"""Run a trial on the rig: the plant in one solver, instruments and controller at 200 Hz."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...orchestration.fmu.limits import TOLERANCE_OF_MOTIONS
from ...solver.arrays import Vector
from ...solver.core import DONE, NOT_FINITE, at
from ...solver.kernel import MAX_STEPS, IntegrationError, Model, describe_failure
from .machine import TRIAL, Machine
from .program import COMMAND, DEVICES, PLANT, REFERENCE, of_part, plant_kernel, program_kernel
from .record import TrialRecord
from .setup import POINTS, Noise, Setup, set_up
from .trials import VOLTAGE, Trial

if TYPE_CHECKING:
    from ...orchestration.loop.parameter_file import ParameterFile


def run_trial(
    trial: Trial | str,
    law: str = "modified_lugre",
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: Noise | None = None,
    tolerance: float = TOLERANCE_OF_MOTIONS,
    progress: Callable[[float], None] | None = None,
    file: ParameterFile | None = None,
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
        Relative tolerance of the solver; its error is far below the instruments' steps.
    progress : function of time [s], optional
        Called repeatedly.
    file : ParameterFile, optional
        The machine and its values; `parameters` have priority. Default: the axis of the thesis.

    Returns
    -------
    TrialRecord

    Raises
    ------
    UnknownName, BadParameter, BadParameters
        For invalid names and values.
    IntegrationError
        If the motion cannot be computed.
    """
    machine = Machine(law, parameters, file)
    setup = set_up(machine.trial(trial), machine, seed, noise)
    measured, true = _run(setup, tolerance, progress)
    trial = setup.trial
    reference = [] if trial.control == VOLTAGE else [REFERENCE[trial.control]]
    order = ["x", *(["x_fine"] if trial.fine else []), "force", COMMAND, *reference]
    record = {n: measured[n] for n in ("time", *order, "x_filtered", "force_filtered")}
    first = [n for n in ("time", "x", "v", "friction", "force", "i") if n in true]
    truth = {n: true.pop(n) for n in first} | {"u": true.pop("voltage")} | true
    notes = _notes(setup, record, truth)
    return TrialRecord(**vars(setup), record=record, truth=truth, tolerance=tolerance, notes=notes)


def _run(
    setup: Setup, tolerance: float, progress: Callable[[float], None] | None
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Run the trial; return the measured and the true signals."""
    trial, machine, time = setup.trial, setup.machine, setup.trial.time
    values = {
        name.replace(".", "_", 1): value
        for name, value in (setup.parameters | setup.starts).items()
        if name.partition(".")[0] in DEVICES
    }
    kernel, own = plant_kernel(machine.law, machine.kind), of_part(PLANT, setup.parameters)
    plant = Model(kernel, own, tolerance)
    program = Model(program_kernel(trial.control, machine.is_axis), values)
    given = [i.name for i in program.kernel.inputs]
    outputs = [o.name for o in kernel.outputs]
    measured = [k for k, name in enumerate(given) if name.startswith(f"{PLANT}_")]
    places = [outputs.index(given[k].removeprefix(f"{PLANT}_")) for k in measured]
    outside = [k for k in range(len(given)) if k not in measured]
    external = np.column_stack([setup.external[given[k]] for k in outside])
    reference = setup.external[REFERENCE[trial.control]]
    taps = [o.name for o in program.kernel.outputs]
    if trial.control == VOLTAGE:
        taps.append(COMMAND)  # in the last column, which the program does not write
    at_command, at_u = taps.index(COMMAND), [i.name for i in kernel.inputs].index(COMMAND)
    read = np.tile(reference[:, None], len(taps))
    true = np.empty((len(time), len(outputs)))
    y, held = np.empty(len(outputs)), np.empty(len(program.kernel.discrete))
    # fixed arrays are passed by address, because of thousands of short calls
    axis = plant.system.instance(plant.x, plant.u, plant.p, y, plant.atol, plant.info)
    working = at(program.x), at(program.u), at(program.p)
    at_held, at_read = at(held), at(read)
    for k, t in enumerate(time):
        axis.out(t)
        program.u[measured] = y[places]
        program.u[outside] = external[k]
        program.system.sample(t, *working, at_held)
        program.u[len(given) :] = held
        program.system.out(t, *working, at_read + k * read.strides[0])
        plant.u[at_u] = read[k, at_command]
        # again, because the voltage at the motor follows the new command immediately
        axis.out(t)
        true[k] = y
        if k + 1 < len(time):
            status = axis.advance(t, time[k + 1], tolerance, MAX_STEPS)
            if status not in (DONE, NOT_FINITE):  # the latter is reported below, with its time
                raise IntegrationError(
                    describe_failure(kernel.name, status, plant.info, time[k + 1])
                )
        if progress and k % 200 == 0:
            progress(float(t))
    broken = ~np.isfinite(true).all(axis=1)
    if broken.any():
        when = time[int(np.argmax(broken))]
        raise IntegrationError(f"{kernel.name}: not finite at t = {when:.9g} s")
    columns = dict(zip(taps, read.T, strict=True))
    columns |= {"time": time, REFERENCE[trial.control]: reference}
    return columns, {"time": time} | dict(zip(outputs, true.T, strict=True))


def _notes(setup: Setup, record: dict[str, Vector], truth: dict[str, Vector]) -> list[str]:
    """Results that are not trusted, and since when."""
    values, unit = setup.parameters, setup.machine.unit
    capacity, travel = values["load_cell.capacity"], values[f"{TRIAL}.travel"]
    limit = values[f"{PLANT}.voltage_limit"]
    x, largest = truth["x"], f"{1e6 * POINTS[-1]:g} um"
    late = {
        f"the load cell is at the limit of its range, {capacity:.4g} {unit('N')},": (
            np.abs(record["force"]) >= capacity
        ),
        f"the amplifier is at its limit, {limit:g} {unit('V')},": np.abs(record["u"]) >= limit,
        f"the block exceeds its travel, {travel:g} {unit('m')},": np.abs(x) > travel,
    }
    if "x_fine" in record:
        out = (x < -POINTS[1] / 2) | (x > POINTS[-1])
        late[f"the capacitance sensor is out of its calibrated {largest}"] = out
    return [
        f"{said} from t = {setup.trial.time[int(np.argmax(when))]:.3f} s"
        for said, when in late.items()
        if when.any()
    ]

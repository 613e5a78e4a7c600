"""Run a trial on the rig: the moving part in one solver, instruments and controller at 200 Hz."""

from __future__ import annotations

import difflib
import hashlib
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..plant import LAWS
from ..solver.core import at
from ..solver.kernel import IntegrationError, Kernel, Model, ParameterInfo
from ..solver.stored import stored_kernel
from .calibration import POINTS, Calibration, calibrate
from .instruments import SAMPLE_TIME, filter_lag
from .parameters import used_by_trial, values_for
from .record import TrialRecord
from .trials import FORCE, VELOCITY, Trial, trials_named
from .wiring import COMMAND, PLANT, REFERENCE, WIRINGS

if TYPE_CHECKING:
    from ..orchestration.parameter_file import ParameterFile
    from ..solver.component import Component

Vector = npt.NDArray[np.float64]

TOLERANCE = 1e-6
"""Relative tolerance of the solver; what it leaves is far below the instruments' steps."""
STROKE = 0.131
"""Half the screw's thread, from the middle where trials begin [m]: Table 2.1."""


class BadRig(ValueError):
    """A parameter that the rig does not have, or a value out of its range; the message says so."""


@dataclass(frozen=True)
class Noise:
    """What the seed decides, and how large it is.

    Attributes
    ----------
    load_cell : float
        Standard deviation before the converter [N]. Not printed: a third of the resolution.
    capacitance : float
        Standard deviation of a conversion [F]. AD7747's data sheet: resolution down to 20 aF.
    micrometer : float
        Standard deviation of setting the micrometer by hand [m]. Not printed; with half a
        micrometre the identified stiffness scatters as Table 2.9's does, by some percent.
    separation : float
        Half the range in which the plates' initial separation falls [m]. Not printed.
    """

    load_cell: float = 0.03
    capacitance: float = 20e-18
    micrometer: float = 0.5e-6
    separation: float = 10e-6


@dataclass(frozen=True)
class Draw:
    """What one seed gives one trial.

    Attributes
    ----------
    encoder_phase : float
        Where between two counts the origin is.
    separation : float
        Deviation of the plates' initial separation [m].
    micrometer : ndarray, shape (8,)
        Errors of the micrometer's positions [m]; the first is where zero is, so it has none.
    calibration : ndarray, shape (8,)
        Noise of the calibration's average capacitances [F].
    force, capacitance : ndarray, shape (m,)
        Noise at each sample [N], [F].
    """

    encoder_phase: float
    separation: float
    micrometer: Vector
    calibration: Vector
    force: Vector
    capacitance: Vector


CALIBRATION_AVERAGE = 25
"""Conversions that are averaged at each point of the calibration: a second."""


def draw(trial: Trial, seed: int, noise: Noise) -> Draw:
    """The random numbers of one trial; the same for the same seed, name and noise."""
    rng = np.random.default_rng([seed, zlib.crc32(trial.name.encode())])
    phase = rng.random()
    separation = noise.separation * rng.uniform(-1.0, 1.0)
    micrometer = noise.micrometer * rng.standard_normal(len(POINTS))
    micrometer[0] = 0.0
    calibration = noise.capacitance / CALIBRATION_AVERAGE**0.5 * rng.standard_normal(len(POINTS))
    return Draw(
        phase,
        separation,
        micrometer,
        calibration,
        noise.load_cell * rng.standard_normal(trial.samples),
        noise.capacitance * rng.standard_normal(trial.samples),
    )


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
        Values that are not nominal: ``plant.sigma0`` or plain ``sigma0`` for the plant and its
        friction law, ``load_cell.resolution`` and so on for the other parts.
    seed : int
        Decides all noise.
    noise : Noise, optional
    tolerance : float
        Of the solver, relative.
    progress : function of time [s], optional
        Called now and then.
    told : ParameterFile, optional
        Values, over which `parameters` win.

    Returns
    -------
    TrialRecord

    Raises
    ------
    UnknownTrial, UnknownLaw, BadRig, BadParameters
        For names and values that make no sense.
    IntegrationError
        If the motion cannot be computed.
    """
    trial = one_trial(trial)
    setup = set_up(trial, law, parameters, seed, noise or Noise(), told)
    return finish(setup, *_run(setup, tolerance, progress), tolerance)


def one_trial(trial: Trial | str) -> Trial:
    """The trial of this name, which must be one and no table.

    Raises
    ------
    UnknownTrial, BadRig
    """
    if isinstance(trial, Trial):
        return trial
    found = trials_named(trial)
    if len(found) > 1:
        raise BadRig(f"{trial!r} is a table of {len(found)} trials; run them one by one")
    return found[0]


# -- what is run -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """A trial with everything that decides its outcome.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters of all parts, as ``part.name``.
    starts : dict of str to float
        Start values of discrete states, as ``part.state``.
    external : dict of str to ndarray, shape (m,)
        Signals from outside at each sample: noise and reference.
    used : ParameterFile
        The parameters as a file, without what the seed drew.
    """

    trial: Trial
    law: str
    seed: int
    noise: Noise
    parameters: dict[str, float]
    starts: dict[str, float]
    external: dict[str, Vector]
    calibration: Calibration | None
    used: ParameterFile

    def values_of(self, part: str) -> dict[str, float]:
        """Parameters and start values of one part, under its own names."""
        head = f"{part}."
        values = {n.removeprefix(head): v for n, v in self.parameters.items() if n.startswith(head)}
        starts = {n.removeprefix(head): v for n, v in self.starts.items() if n.startswith(head)}
        return values | {f"{name}_start": value for name, value in starts.items()}


def set_up(
    trial: Trial,
    law: str,
    parameters: Mapping[str, float] | None,
    seed: int,
    noise: Noise,
    told: ParameterFile | None = None,
) -> Setup:
    """Draw the trial's random numbers, calibrate its sensor, and collect all parameters.

    Raises
    ------
    UnknownLaw, BadRig, BadParameters
    """
    drawn = draw(trial, seed, noise)
    known = {f"{PLANT}.{p.name}": p for p in plant_kernel(law).parameters}
    known |= {_dotted(trial.control, p.name): p for p in program_kernel(trial.control).parameters}
    for fixed in ("sample_time", *_CALIBRATED):
        known.pop(fixed, None)
    given = values_for(told, law, trial.control, known) if told else {}
    given |= {
        name if "." in name else f"{PLANT}.{name}": float(value)
        for name, value in (parameters or {}).items()
    }
    for name, value in given.items():
        _check(name, value, known, law)
    if f"{PLANT}.p" in given:  # one screw
        given.setdefault("encoder.p", given[f"{PLANT}.p"])
    values = {name: p.default for name, p in known.items()}
    values["encoder.phase"] = drawn.encoder_phase
    calibration, starts = None, {}
    if trial.control == FORCE:
        values["capacitance_sensor.separation"] += drawn.separation
    values |= given
    if trial.control == FORCE:
        calibration = _calibrate(values, drawn)
        values |= dict(zip(_CALIBRATED, calibration.coefficients.tolist(), strict=True))
        at_rest = float(_capacitance(values, np.zeros(1))[0])
        before = math.ceil(values["capacitance_sensor.samples"]) - 1.0
        # the converter has been running before the trial begins, with the block at rest
        starts = {
            "capacitance_sensor.count": before,
            "capacitance_sensor.total": before * at_rest,
            "capacitance_sensor.held": at_rest,
        }
    external = {
        "force_noise": drawn.force,
        "capacitance_noise": drawn.capacitance,
        REFERENCE[trial.control]: trial.reference(),
    }
    used = used_by_trial(law, known, given, told)
    return Setup(trial, law, seed, noise, values, starts, external, calibration, used)


_CALIBRATED = tuple(f"capacitance_sensor.c{k}" for k in range(3))


def _check(name: str, value: float, known: Mapping[str, ParameterInfo], law: str) -> None:
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
        hint = f"; did you mean {near[0]}?" if near else ""
        owner = name.partition(".")[0]
        theirs = [k for k in known if k.startswith(f"{owner}.")] or list(
            dict.fromkeys(k.partition(".")[0] + ".*" for k in known if "." in k)
        )
        raise BadRig(f"the rig with {law} has no {name!r}; it has {', '.join(theirs)}{hint}")
    p = known[name]
    if not (math.isfinite(value) and p.minimum <= value <= p.maximum):
        raise BadRig(
            f"{name} is {value:g} {p.unit}, expected a value within [{p.minimum:g}, {p.maximum:g}]"
        )


def _dotted(control: str, name: str) -> str:
    """``part.name`` of a parameter that the program calls ``part_name``."""
    for part in WIRINGS[control].parts:
        if name.startswith(f"{part.name}_"):
            return f"{part.name}.{name.removeprefix(part.name + '_')}"
    return name


def _capacitance(values: Mapping[str, float], displacement: Vector) -> Vector:
    """Eq. 2.1 with the sensor's values [F]."""
    area = values["capacitance_sensor.permittivity"] * values["capacitance_sensor.area"]
    return np.asarray(area / (values["capacitance_sensor.separation"] + displacement))


def _calibrate(values: Mapping[str, float], drawn: Draw) -> Calibration:
    found = _capacitance(values, POINTS + drawn.micrometer) + drawn.calibration
    largest = values["capacitance_sensor.range"]
    if not (found.max() <= largest and np.ptp(found) > 1e-3 * largest):
        raise BadRig(
            f"the plates have {found.min():.3g} to {found.max():.3g} F in the calibration, which "
            f"the converter's {largest:.3g} F cannot resolve; change capacitance_sensor.area or "
            "capacitance_sensor.separation"
        )
    return calibrate(found)


# -- compiled parts ----------------------------------------------------------------------------


@cache
def _sources() -> str:
    """Hash of this folder's sources: what is compiled from them is kept under it."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


@cache
def plant_kernel(law: str) -> Kernel:
    """The compiled moving part with a friction law.

    Raises
    ------
    UnknownLaw
    """
    from ..plant import law as laws

    if law not in LAWS:
        raise laws.UnknownLaw(f"no friction law {law!r}; there are {', '.join(LAWS)}")

    def make() -> Component:
        from .plant import rig_plant

        return rig_plant(laws.law(law), f"rig_plant_{law}")

    return stored_kernel(f"rig_plant_{law}_{_sources()}", make)


@cache
def program_kernel(control: str) -> Kernel:
    """The compiled instruments and controller for one kind of trial."""

    def make() -> Component:
        from .program import program

        return program(WIRINGS[control], f"rig_{control}_program")

    return stored_kernel(f"rig_{control}_program_{_sources()}", make)


# -- running -----------------------------------------------------------------------------------


def _run(
    setup: Setup, tolerance: float, progress: Callable[[float], None] | None
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    """Columns of the record and of the truth."""
    trial = setup.trial
    wiring = WIRINGS[trial.control]
    plant = Model(plant_kernel(setup.law), setup.values_of(PLANT), tolerance)
    values = {
        f"{part.name}_{name}": value
        for part in wiring.parts
        for name, value in setup.values_of(part.name).items()
    }
    program = Model(program_kernel(trial.control), values)
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
    # what stays where it is goes by its address: thousands of short calls
    moving = at(plant.x), at(plant.u), at(plant.p)
    working = at(program.x), at(program.u), at(program.p)
    at_y, at_held, at_taps, at_true = at(y), at(held), at(taps), at(true)
    names = [o.name for o in program.kernel.outputs]
    command = names.index(COMMAND) if COMMAND in names else -1
    reference = setup.external[REFERENCE[trial.control]]
    at_u = [i.name for i in plant.kernel.inputs].index(COMMAND)
    for k, t in enumerate(time):
        plant.system.out(t, *moving, at_y)
        program.u[measured] = y[places]
        program.u[outside] = external[k]
        program.system.sample(t, *working, at_held)
        program.u[end:] = held
        program.system.out(t, *working, at_taps + k * taps.strides[0])
        plant.u[at_u] = taps[k, command] if command >= 0 else reference[k]
        # again: the voltage at the motor follows the new command at once
        plant.system.out(t, *moving, at_true + k * true.strides[0])
        if k + 1 < len(time):
            plant.advance(t, time[k + 1])
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


def finish(
    setup: Setup, taps: dict[str, Vector], truth: dict[str, Vector], tolerance: float
) -> TrialRecord:
    """Put columns in order and say what is not to be believed."""
    trial = setup.trial
    time = trial.time
    order = ["x", *(["x_fine"] if trial.fine else []), "force", "u"]
    columns = {"time": time} | {name: taps[name] for name in order}
    name = REFERENCE[trial.control]
    if name != "u_ref":
        columns[name] = setup.external[name]
    columns |= {name: taps[name] for name in ("x_filtered", "force_filtered")}
    first = ["x", "v", "friction", "force", "i"]
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
        setup.law,
        columns,
        real,
        setup.parameters,
        settings,
        notes,
        setup.calibration if trial.fine else None,
        setup.used,
    )


def lags(setup: Setup) -> dict[str, float]:
    """Delays of the recorded columns against the truth, and of the command [s].

    Readings carry the time at which they were taken: without a filter they are not late.
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
        # the mean of a conversion is half of it old, and is shown for as long again
        found["x_fine"] = (samples - 1) * SAMPLE_TIME
    return found


def _notes(setup: Setup, record: dict[str, Vector], truth: dict[str, Vector]) -> list[str]:
    values, time, notes = setup.parameters, setup.trial.time, []

    def since(late: npt.NDArray[np.bool_]) -> str:
        return f"from t = {time[int(np.argmax(late))]:.3f} s"

    clipped = np.abs(record["force"]) >= values["load_cell.capacity"]
    if clipped.any():
        capacity = values["load_cell.capacity"]
        notes.append(f"the load cell is at the end of its range, {capacity:g} N, {since(clipped)}")
    limited = np.abs(record["u"]) >= values[f"{PLANT}.voltage_limit"]
    if limited.any():
        limit = values[f"{PLANT}.voltage_limit"]
        notes.append(f"the amplifier is at its limit, {limit:g} V, {since(limited)}")
    beyond = np.abs(truth["x"]) > STROKE
    if beyond.any():
        notes.append(f"the block runs off the screw's thread, {STROKE:g} m, {since(beyond)}")
    if "x_fine" in record:
        out = (truth["x"] < -POINTS[1] / 2) | (truth["x"] > POINTS[-1])
        if out.any():
            notes.append(
                f"the capacitance sensor is out of its calibrated {1e6 * POINTS[-1]:g} um "
                f"{since(out)}"
            )
    return notes

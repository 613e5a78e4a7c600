"""The same rig out of separate FMUs, wired like the real one; the check on the compiled bench."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..fmus.export import export
from ..fmus.interface import TOLERANCE as SOLVER_TOLERANCE
from ..instruments.sampling_period import SAMPLE_TIME
from ..orchestration.fmu_instance import FmuInstance
from ..orchestration.parameter_file import ParameterFile
from ..plant import law as laws
from ..solver.files import write_atomically, write_json
from .bench import TOLERANCE, finish, one_trial
from .noise import Noise
from .plant import rig_plant
from .record import TrialRecord
from .rig_trials import Trial
from .rig_wiring import COMMAND, PLANT, WIRINGS
from .setup import Setup, set_up

Vector = npt.NDArray[np.float64]


def export_rig(folder: Path | str, law: str = "modified_lugre") -> dict[str, Path]:
    """Write every part of the rig as an FMU, and ``wiring.json``, which says what goes where.

    Parameters
    ----------
    folder : path-like
        Made if it is not there.
    law : str
        Friction law of the moving part, one of `plant.LAWS`.

    Returns
    -------
    dict of str to Path
        The FMUs by the part's name.

    Raises
    ------
    UnknownLaw
    OSError
        If a file cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    moving = rig_plant(laws.law(law), f"rig_plant_{law}")
    paths = {PLANT: export(moving, folder / f"{PLANT}.fmu")}
    for wiring in WIRINGS.values():
        for part in wiring.parts:
            if part.name not in paths:
                paths[part.name] = export(part.make(), folder / f"{part.name}.fmu")
    table = {
        control: {
            "order": [*(part.name for part in wiring.parts), PLANT],
            "feeds": {
                f"{part.name}.{port}": source
                for part in wiring.parts
                for port, source in part.feeds.items()
            }
            | {f"{PLANT}.{COMMAND}": wiring.command},
        }
        for control, wiring in WIRINGS.items()
    }
    write_json(folder / "wiring.json", {"step": SAMPLE_TIME, "trials": table})
    return paths


def export_trial(
    folder: Path | str,
    trial: Trial | str,
    law: str = "modified_lugre",
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: Noise | None = None,
    tolerance: float = TOLERANCE,
    told: ParameterFile | None = None,
) -> list[Path]:
    """Write the rig as `export_rig` does, and all that one trial gives its parts.

    ``values.json`` holds the parameters and start values of every part, ``outside.csv`` over time
    [s] what comes from outside: noise and reference. With them and ``wiring.json`` any master can
    repeat the trial. ``parameters.toml`` is the rig's parameter file; of `told` it has the values.

    Returns
    -------
    list of Path
        All files that were written.

    Raises
    ------
    UnknownTrial, UnknownLaw, BadRig, BadParameters
        For names and values that make no sense; before anything is written.
    OSError
        If a file cannot be written.
    """
    trial = one_trial(trial)
    setup = set_up(trial, law, parameters, seed, noise or Noise(), told)
    folder = Path(folder)
    fmus = export_rig(folder, law)
    names = [*(part.name for part in WIRINGS[trial.control].parts), PLANT]
    about = {
        "trial": trial.name,
        "control": trial.control,
        "asked": trial.asked,
        "duration": trial.duration,
        "values": {name: _values(setup, name, tolerance) for name in names},
    }
    write_json(folder / "values.json", about)
    columns = {"time": trial.time} | setup.external
    table, stream = np.column_stack(list(columns.values())), io.StringIO()
    np.savetxt(stream, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")
    write_atomically(folder / "outside.csv", stream.getvalue().encode())
    others = [folder / name for name in ("wiring.json", "values.json", "outside.csv")]
    return [*fmus.values(), *others, setup.used.save(folder)]


def _values(setup: Setup, name: str, tolerance: float) -> dict[str, float]:
    """All that a part is given before it starts."""
    values = setup.values_of(name)
    return values | {SOLVER_TOLERANCE: tolerance} if name == PLANT else values


def run_trial_with_fmus(
    trial: Trial | str,
    fmus: Mapping[str, Path],
    law: str = "modified_lugre",
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: Noise | None = None,
    tolerance: float = TOLERANCE,
) -> TrialRecord:
    """Run one trial with the FMUs of `export_rig`; for the rest see `bench.run_trial`.

    At each sample instant the parts are stepped in the order of the signals, each with the newest
    values of those before it, and the moving part last. Slower than the compiled bench by far.

    Raises
    ------
    UnknownTrial, UnknownLaw, BadRig
        For names and values that make no sense.
    StepFailed
        If an FMU refuses or cannot go on.
    """
    trial = one_trial(trial)
    setup = set_up(trial, law, parameters, seed, noise or Noise())
    names = [*(part.name for part in WIRINGS[trial.control].parts), PLANT]
    instances = {name: FmuInstance(fmus[name], name) for name in names}
    try:
        for name, instance in instances.items():
            instance.initialize(_values(setup, name, tolerance), trial.duration)
        taps, truth = _run(setup, instances)
    finally:
        for instance in instances.values():
            instance.close()
    return finish(setup, taps, truth, tolerance)


def _run(
    setup: Setup, instances: Mapping[str, FmuInstance]
) -> tuple[dict[str, Vector], dict[str, Vector]]:
    trial, wiring = setup.trial, WIRINGS[setup.trial.control]
    plant = instances[PLANT]
    outputs = [name for name in plant.outputs if "." not in name]
    read_plant, write_plant = plant.reader(outputs), plant.writer([COMMAND])
    ports = {}
    for part in wiring.parts:
        instance = instances[part.name]
        ports[part.name] = (
            instance.writer(list(part.feeds)),
            list(part.feeds.values()),
            instance.reader(instance.outputs),
            [f"{part.name}.{name}" for name in instance.outputs],
        )
    taps: dict[str, list[float]] = {name: [] for name in (*wiring.taps, COMMAND)}
    truth: dict[str, list[float]] = {name: [] for name in outputs}
    time = trial.time
    for k in range(len(time)):
        t, h = k * SAMPLE_TIME, SAMPLE_TIME
        now = {name: float(values[k]) for name, values in setup.external.items()}
        now |= dict(zip((f"{PLANT}.{n}" for n in outputs), read_plant().tolist(), strict=True))
        for name, (write, sources, read, given) in ports.items():
            write(np.array([now[source] for source in sources]))
            instances[name].step(t, h)
            now |= dict(zip(given, read().tolist(), strict=True))
        write_plant(np.array([now[wiring.command]]))
        for name, value in zip(outputs, read_plant().tolist(), strict=True):
            truth[name].append(value)
        for name, source in (wiring.taps | {COMMAND: wiring.command}).items():
            taps[name].append(now[source])
        if k + 1 < len(time):
            plant.step(t, h)
    return (
        {name: np.array(values) for name, values in taps.items()},
        {name: np.array(values) for name, values in truth.items()},
    )

"""The same rig as separate FMUs, with all data that a master needs to repeat a trial."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..fmus.export import export
from ..fmus.interface import TOLERANCE as SOLVER_TOLERANCE
from ..instruments.sampling_period import SAMPLE_TIME
from ..orchestration.parameter_file import ParameterFile
from ..plant import law as laws
from ..solver.files import write_atomically, write_json
from .bench import TOLERANCE, one_trial
from .machine import Machine, machine_of
from .noise import Noise
from .plant import rig_plant
from .rig_trials import Trial
from .rig_wiring import COMMAND, PLANT, wirings
from .setup import Setup, set_up


def export_rig(folder: Path | str, machine: Machine) -> dict[str, Path]:
    """Write every part of the rig as an FMU, and ``wiring.json`` with the connections.

    Parameters
    ----------
    folder : path-like
        Created if it does not exist.
    machine : Machine

    Returns
    -------
    dict of str to Path
        The FMUs by part name.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    moving = rig_plant(laws.law(machine.law), f"rig_plant_{machine.law}", machine.kind)
    own = {PLANT: moving.in_units(machine.command_words)}
    trials = wirings(machine.is_axis)
    for wiring in trials.values():
        own |= {p.name: p.make().in_units(machine.words) for p in wiring.parts if p.name not in own}
    paths = {name: export(part, folder / f"{name}.fmu") for name, part in own.items()}
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
        for control, wiring in trials.items()
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
    """Write the rig as in `export_rig`, and all inputs of its parts in one trial.

    ``values.json`` contains the parameters and start values of every part, ``outside.csv`` the
    external signals over time [s]: noise and reference. With them and ``wiring.json`` any master
    can repeat the trial. ``parameters.toml`` is the rig's parameter file, including the values of
    `told`.

    Returns
    -------
    list of Path
        All written files.

    Raises
    ------
    UnknownTrial, UnknownLaw, BadRig, BadParameters
        For invalid names and values; before anything is written.
    OSError
        If a file cannot be written.
    """
    machine = machine_of(law, parameters, told)
    setup = set_up(one_trial(trial, machine), machine, parameters, seed, noise, told)
    trial, folder = setup.trial, Path(folder)
    fmus = export_rig(folder, machine)
    names = [*(part.name for part in setup.wiring.parts), PLANT]
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
    """Parameters and start values of a part."""
    values = setup.values_of(name)
    return values | {SOLVER_TOLERANCE: tolerance} if name == PLANT else values

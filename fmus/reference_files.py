"""Files for the FMI cross-check of an FMU: a reference solution, its options, its inputs."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from ..solver import kernel_cache
from ..solver.files import write_atomically
from ..solver.kernel import Kernel, Model
from .model_description import STEP_SIZE

STOP, INTERVAL, TOLERANCE = 2.0, 1e-2, 1e-9
MOST_COLUMNS = 10  # recommended by the cross-check
FOLDER = "reference"
"""Their folder, next to the FMUs."""
_VOLTAGE, _SETPOINT = 5.0, 0.08  # V, m; constant, so that a host may hold or interpolate them


def write_reference_files(files: Mapping[str, str], fmu: Path) -> None:
    """Write the result of `reference_files` into the folder `FOLDER` next to an FMU.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    for suffix, text in files.items():
        write_atomically(fmu.parent / FOLDER / (fmu.stem + suffix), text.encode())


def reference_files(kernel: Kernel) -> dict[str, str]:
    """Text of ``_ref.csv``, ``_ref.opt`` and, if it has inputs to be driven, ``_in.csv``.

    They come from the user's cache if available.

    Parameters
    ----------
    kernel : Kernel
        Content of the FMU; it is solved alone, without the FMU.

    Raises
    ------
    IntegrationError, ArithmeticError, ValueError
        If the solution diverges.
    """
    digest = hashlib.sha256(
        (kernel.to_json() + Path(__file__).read_text(encoding="utf-8")).encode()
    ).hexdigest()
    path = kernel_cache.entry(kernel_cache.REFERENCES, f"{kernel.name}-{digest[:16]}.json")
    if (kept := kernel_cache.read(path)) is not None:
        return dict(json.loads(kept))
    files = _computed(kernel)
    with contextlib.suppress(OSError):  # a full disk costs time, not results
        kernel_cache.write(path, json.dumps(files).encode())
    return files


def _computed(kernel: Kernel) -> dict[str, str]:
    driven = {i.name: v for i in kernel.inputs if (v := _drive(i.name, i.role)) is not None}
    driven = {n: v for n, v in driven.items() if v != _starts(kernel)[n]}
    names = [o.name for o in kernel.outputs][:MOST_COLUMNS]
    course = _course(kernel, driven)
    rows = [[t, *(values[n] for n in names)] for t, values in course]
    options = {
        "StartTime": 0.0,
        "StopTime": STOP,
        "StepSize": STEP_SIZE,
        "RelTol": TOLERANCE,
        "OutputIntervalLength": INTERVAL,
    }
    files = {
        "_ref.csv": _table(["time", *names], rows),
        "_ref.opt": "".join(f"{name}, {value!r}\n" for name, value in options.items()),
    }
    if driven:
        held = [[t, *driven.values()] for t in (0.0, STOP)]
        files["_in.csv"] = _table(["time", *driven], held)
    return files


def _starts(kernel: Kernel) -> dict[str, float]:
    return {i.name: i.start for i in kernel.inputs}


def _drive(name: str, role: str) -> float | None:
    """The constant value of an input in the reference; None: its start value."""
    return _SETPOINT if role == "reference" else _VOLTAGE if name == "u" else None


def _course(kernel: Kernel, driven: dict[str, float]) -> list[tuple[float, dict[str, float]]]:
    """Time and outputs at each interval; at a sample instant, the values before it."""
    model = Model(kernel, tolerance=TOLERANCE)
    for name, value in driven.items():
        model.set_input(name, value)
    if kernel.modes:
        model.settle(0.0)
    samples = round(INTERVAL / model.sample_time) if kernel.sample_time else 1
    rows = [(0.0, model.outputs(0.0, model.x))]
    for k in range(round(STOP / INTERVAL)):
        for part in range(samples):
            begin, end = (INTERVAL * (k + (part + more) / samples) for more in (0, 1))
            if kernel.sample_time:
                model.sample(begin)
            if len(model.x):
                model.advance(begin, end)
        rows.append((end, model.outputs(end, model.x)))
    return rows


def _table(names: list[str], rows: list[list[float]]) -> str:
    """In the format of the cross-check: names in double quotes, separated by commas."""
    head = ",".join(f'"{name}"' for name in names)
    return "\n".join([head, *(",".join(repr(float(v)) for v in row) for row in rows)]) + "\n"

"""Result of a trial: the instruments' record, the true signals, and the reference."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...orchestration.loop.parameter_file import ParameterFile
from ...solver.files import write_atomically, write_json
from .calibration import Calibration
from .machine import Machine
from .rig_trials import Trial

Vector = npt.NDArray[np.float64]

UNITS = {
    "time": "s",
    **dict.fromkeys(("x", "x_fine", "x_filtered"), "m"),
    **dict.fromkeys(("force", "force_filtered", "force_ref", "friction"), "N"),
    **dict.fromkeys(("v", "v_ref"), "m/s"),
    **dict.fromkeys(("u", "u_ref"), "V"),
}
"""Units of columns for the thesis' axis; another machine has its own, see `Machine.unit`."""
_DIGITS = "%.15g"  # a reading of 3 steps of 0.089 N is written as 0.267, and read back unchanged


@dataclass(frozen=True)
class TrialRecord:
    """One trial as recorded by the instruments, and its true signals.

    Attributes
    ----------
    trial : Trial
    machine : Machine
    record : dict of str to ndarray, shape (m,)
        ``time`` [s], ``x`` [m] (encoder), ``x_fine`` [m] (capacitance sensor, if used), ``force``
        [N] (load cell), ``u`` [V] (command), ``x_filtered`` and ``force_filtered`` (inputs of the
        controllers), and the reference, ``v_ref`` [m/s] or ``force_ref`` [N].
    truth : dict of str to ndarray, shape (m,)
        At the same times, without noise: ``time, x, v, friction, force, i`` (of a motor), ``u``
        (within its limit) and the law's internal states.
    parameters : dict of str to float
        Parameters of every part, as ``part.name``; those of the plant and its friction law as
        ``plant.name``.
    settings : dict
        Seed, tolerance, noise, lags of filters and sampling [s].
    notes : list of str
        Reasons why parts of the record are not trusted; empty if all are.
    calibration : Calibration or None
        Calibration of the capacitance sensor.
    used : ParameterFile
        The parameters as a file, without values drawn by the seed.
    """

    trial: Trial
    machine: Machine
    record: dict[str, Vector]
    truth: dict[str, Vector]
    parameters: dict[str, float]
    settings: dict[str, Any]
    notes: list[str]
    calibration: Calibration | None
    used: ParameterFile

    @property
    def law(self) -> str:
        """Friction law of the rig."""
        return self.machine.law

    def description(self) -> dict[str, Any]:
        """Content of ``trial.json``."""
        about: dict[str, Any] = {
            "name": self.trial.name,
            "table": self.trial.table,
            "number": self.trial.number,
            "asked": self.trial.asked,
            "control": self.trial.control,
            "level": self.trial.level,
            "duration": self.trial.duration,
            "note": self.trial.note,
            "kind": self.machine.kind,
            "law": self.law,
            # without unknown sizes: infinite travel, or velocity nan
            "parameters": {n: v for n, v in self.parameters.items() if math.isfinite(v)},
            **self.settings,
            "not_trusted": self.notes,
        }
        if self.calibration:
            c = self.calibration
            about["calibration"] = {
                "polynomial_m_per_pF": c.coefficients.tolist(),
                "covariance": c.covariance.tolist(),
                "displacement_m": c.displacements.tolist(),
                "capacitance_F": c.capacitances.tolist(),
                "residual_m": c.residual,
                "error_95_m": c.error,
            }
        return about

    def save(self, folder: Path | str) -> None:
        """Write the record, the truth, ``trial.json`` and ``parameters.toml``.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / "truth.csv", self._csv(self.truth))
        write_json(folder / "trial.json", self.description())
        self.used.save(folder)
        write_atomically(folder / "record.csv", self._csv(self.record))

    def _csv(self, columns: dict[str, Vector]) -> bytes:
        """Columns as CSV, with units unless they are those of the thesis' axis."""
        said = {n: f"{n} [{self.machine.unit(UNITS[n])}]" for n in columns if n in UNITS}
        names = columns if self.machine.is_axis else [said.get(n, n) for n in columns]
        stream = io.StringIO()
        np.savetxt(
            stream,
            np.column_stack(list(columns.values())),
            fmt=_DIGITS,
            delimiter=",",
            header=",".join(names),
            comments="",
        )
        return stream.getvalue().encode()

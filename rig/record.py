"""What a trial leaves behind: the instruments' record, the truth beside it, and what was asked."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..orchestration.parameter_file import ParameterFile
from ..solver.files import write_atomically, write_json
from .calibration import Calibration
from .trials import Trial

Vector = npt.NDArray[np.float64]

_DIGITS = "%.15g"  # a reading of 3 steps of 0.089 N is written 0.267, and read back as it was


@dataclass(frozen=True)
class TrialRecord:
    """One trial as the instruments recorded it, and as it was.

    Attributes
    ----------
    trial : Trial
    law : str
        Friction law of the rig.
    record : dict of str to ndarray, shape (m,)
        ``time`` [s], ``x`` [m] (encoder), ``x_fine`` [m] (capacitance sensor, where it is used),
        ``force`` [N] (load cell), ``u`` [V] (command), ``x_filtered`` and ``force_filtered`` (what
        the controllers see), and what was asked, ``v_ref`` [m/s] or ``force_ref`` [N].
    truth : dict of str to ndarray, shape (m,)
        On the same times, free of noise: ``time, x, v, friction, force, i, u`` (at the motor) and
        the law's internal states.
    parameters : dict of str to float
        Of every part, as ``part.name``; the plant's and its friction law's as ``plant.name``.
    settings : dict
        Seed, tolerance, noise, lags of filters and sampling [s].
    notes : list of str
        Why parts of the record are not to be believed; empty if all are.
    calibration : Calibration or None
        Of the capacitance sensor.
    used : ParameterFile
        The parameters as a file, without what the seed drew.
    """

    trial: Trial
    law: str
    record: dict[str, Vector]
    truth: dict[str, Vector]
    parameters: dict[str, float]
    settings: dict[str, Any]
    notes: list[str]
    calibration: Calibration | None
    used: ParameterFile

    def description(self) -> dict[str, Any]:
        """What goes into ``trial.json``."""
        about: dict[str, Any] = {
            "name": self.trial.name,
            "table": self.trial.table,
            "number": self.trial.number,
            "asked": self.trial.asked,
            "control": self.trial.control,
            "level": self.trial.level,
            "duration": self.trial.duration,
            "note": self.trial.note,
            "law": self.law,
            "parameters": self.parameters,
            **self.settings,
            "not_to_be_believed": self.notes,
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
        """Write the record, the truth, ``trial.json``, ``parameters.toml`` and a picture.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / "truth.csv", _csv(self.truth))
        write_json(folder / "trial.json", self.description())
        self.used.save(folder)
        write_atomically(folder / "record.png", self.plot())
        write_atomically(folder / "record.csv", _csv(self.record))

    def plot(self) -> bytes:
        """A picture of the record over time, as PNG."""
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        with mpl.rc_context({"axes.grid": True, "grid.color": "#dddddd", "font.size": 9}):
            figure = Figure(figsize=(7, 6))
            FigureCanvasAgg(figure)
            rows = figure.subplots(3, 1, sharex=True)
            # looking for the best layout would take as long as the drawing itself
            figure.subplots_adjust(left=0.11, right=0.98, top=0.95, bottom=0.08, hspace=0.12)
            self._draw(rows)
            figure.align_ylabels(rows)
            stream = io.BytesIO()
            figure.savefig(stream, format="png", dpi=90)
        return stream.getvalue()

    def _draw(self, rows: Any) -> None:
        blue, orange, black = "#0072B2", "#D55E00", "#000000"
        record, truth, time = self.record, self.truth, self.record["time"]
        motion, force, command = rows
        motion.plot(time, 1e3 * record["x"], color=blue, label="encoder")
        if "x_fine" in record:
            motion.plot(time, 1e3 * record["x_fine"], color=orange, label="capacitance sensor")
        motion.set_ylabel("position [mm]")
        motion.set_title(f"{self.trial.name}: {self.trial.asked} ({self.law})", fontsize=10)
        force.plot(time, record["force"], color=blue, linewidth=0.8, label="load cell")
        force.plot(time, truth["friction"], color=black, linewidth=1, label="friction, true")
        if "force_ref" in record:
            force.plot(time, record["force_ref"], "--", color=orange, label="asked")
        force.set_ylabel("force [N]")
        if "v_ref" in record:
            command.plot(time, 1e3 * truth["v"], color=black, linewidth=1, label="velocity, true")
            command.plot(time, 1e3 * record["v_ref"], "--", color=orange, label="asked")
            command.set_ylabel("velocity [mm/s]")
        else:
            command.plot(time, record["u"], color=blue, label="command")
            command.set_ylabel("voltage [V]")
        command.set_xlabel("time [s]")
        for axes in rows:
            axes.legend(loc="best", frameon=False, fontsize=8)


def _csv(columns: dict[str, Vector]) -> bytes:
    stream = io.StringIO()
    np.savetxt(
        stream,
        np.column_stack(list(columns.values())),
        fmt=_DIGITS,
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    return stream.getvalue().encode()

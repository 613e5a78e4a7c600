"""Result of a trial: the instruments' record, the true signals, the reference, their picture."""

from __future__ import annotations

import io
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...orchestration.loop.pictures import COLOURS, styled_figure
from ...plant.instruments.acquisition import SAMPLE_TIME, filter_lag
from ...solver.arrays import Vector
from ...solver.files import write_atomically, write_json
from .setup import Setup
from .trials import VELOCITY

UNITS = {
    "time": "s",
    **dict.fromkeys(("x", "x_fine", "x_filtered"), "m"),
    **dict.fromkeys(("force", "force_filtered", "force_ref", "friction"), "N"),
    **dict.fromkeys(("v", "v_ref"), "m/s"),
    **dict.fromkeys(("u", "u_ref"), "V"),
}
"""Units of columns for the thesis' axis; another machine has its own, see `Machine.unit`."""
_DIGITS = "%.15g"  # a reading of 3 steps of 0.089 N is written as 0.267, and read back unchanged
BLUE, ORANGE, BLACK = COLOURS[0], COLOURS[1], COLOURS[6]


@dataclass(frozen=True)
class TrialRecord(Setup):
    """One trial as recorded by the instruments, its true signals, and all its inputs.

    Attributes
    ----------
    record : dict of str to ndarray, shape (m,)
        ``time`` [s], ``x`` [m] (encoder), ``x_fine`` [m] (capacitance sensor, if used), ``force``
        [N] (load cell), ``u`` [V] (command), ``x_filtered`` and ``force_filtered`` (inputs of the
        controllers), and the reference, ``v_ref`` [m/s] or ``force_ref`` [N].
    truth : dict of str to ndarray, shape (m,)
        At the same times, without noise: ``time, x, v, friction, force, i`` (of a motor), ``u``
        (within its limit) and the law's internal states.
    tolerance : float
        Relative tolerance of the solver.
    notes : list of str
        Reasons why parts of the record are not trusted; empty if all are.
    """

    record: dict[str, Vector]
    truth: dict[str, Vector]
    tolerance: float
    notes: list[str]

    @property
    def law(self) -> str:
        """Friction law of the rig."""
        return self.machine.law

    def lags(self) -> dict[str, float]:
        """Delays of the recorded columns relative to the true signals, and of the command [s].

        Readings have the time stamp of their sample instant: without a filter they have no delay.
        """
        values = self.parameters
        found = {"x": 0.0, "force": 0.0, "command_held": SAMPLE_TIME / 2}
        for column, part in (("x_filtered", "position_filter"), ("force_filtered", "force_filter")):
            found[column] = filter_lag(values[f"{part}.cutoff"], values[f"{part}.damping"])
        if self.trial.control == VELOCITY:
            found["velocity_difference"] = SAMPLE_TIME / 2
        if self.trial.fine:
            # the mean of a conversion is delayed by half of it, and is held for its time
            samples = math.ceil(values["capacitance_sensor.samples"])
            found["x_fine"] = (samples - 1) * SAMPLE_TIME
        return found

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
            "seed": self.seed,
            "tolerance": self.tolerance,
            "noise": asdict(self.noise),
            "sample_time": SAMPLE_TIME,
            "lags": self.lags(),
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
        names = ",".join(n if self.machine.is_axis else said.get(n, n) for n in columns)
        table, stream = np.column_stack(list(columns.values())), io.StringIO()
        np.savetxt(stream, table, fmt=_DIGITS, delimiter=",", header=names, comments="")
        return stream.getvalue().encode()


def record_figure(recorded: TrialRecord) -> Any:
    """A figure of the record over time."""
    style = {"font.size": 9, "lines.linewidth": 1.2}
    with styled_figure(3, 1, (7, 6), None, True, **style) as (figure, grid):
        # the search for the best layout would take as long as the drawing
        figure.subplots_adjust(left=0.11, right=0.98, top=0.95, bottom=0.08, hspace=0.12)
        _draw(recorded, grid[:, 0])
        figure.align_ylabels()
    return figure


def _draw(recorded: TrialRecord, rows: Any) -> None:
    record, truth, time = recorded.record, recorded.truth, recorded.record["time"]
    motion, force, command = rows
    unit = recorded.machine.unit
    turns = unit("m") == "rad"
    scale, prefix = (1.0, "") if turns else (1e3, "m")
    motion.plot(time, scale * record["x"], color=BLUE, label="encoder")
    if "x_fine" in record:
        motion.plot(time, 1e3 * record["x_fine"], color=ORANGE, label="capacitance sensor")
    motion.set_ylabel(f"{'angle' if turns else 'position'} [{prefix}{unit('m')}]")
    title = f"{recorded.trial.name}: {recorded.trial.asked} ({recorded.law})"
    motion.set_title(title, fontsize=10)
    force.plot(time, record["force"], color=BLUE, linewidth=0.8, label="load cell")
    force.plot(time, truth["friction"], color=BLACK, linewidth=1, label="friction, true")
    if "force_ref" in record:
        force.plot(time, record["force_ref"], "--", color=ORANGE, label="asked")
    force.set_ylabel(f"{'torque' if turns else 'force'} [{unit('N')}]")
    if "v_ref" in record:
        command.plot(time, scale * truth["v"], color=BLACK, linewidth=1, label="velocity, true")
        command.plot(time, scale * record["v_ref"], "--", color=ORANGE, label="asked")
        command.set_ylabel(f"velocity [{prefix}{unit('m/s')}]")
    else:
        command.plot(time, record["u"], color=BLUE, label="command")
        command.set_ylabel(f"command [{unit('V')}]")
    command.set_xlabel("time [s]")
    for axes in rows:
        axes.legend(loc="best", frameon=False, fontsize=8)

"""The picture of a trial: recorded signals, true signals, and the reference."""

from __future__ import annotations

from typing import Any

from ...orchestration.loop.pictures import COLOURS, STYLE, empty_figure
from .record import TrialRecord

BLUE, ORANGE, BLACK = COLOURS[0], COLOURS[1], COLOURS[6]


def record_figure(recorded: TrialRecord) -> Any:
    """A figure of the record over time."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE | {"font.size": 9, "lines.linewidth": 1.2}):
        figure = empty_figure((7, 6))
        rows = figure.subplots(3, 1, sharex=True)
        # the search for the best layout would take as long as the drawing
        figure.subplots_adjust(left=0.11, right=0.98, top=0.95, bottom=0.08, hspace=0.12)
        _draw(recorded, rows)
        figure.align_ylabels(rows)
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

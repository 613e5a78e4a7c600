"""Pictures of a tuned loop: its motions, and its frequency response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..loop.pictures import COLOURS, DASHES, STYLE, new_figure

if TYPE_CHECKING:
    from .tune import TunedController


def motions_figure(tuned: TunedController) -> Any:
    """Position, error and command of each motion, one column each."""
    import matplotlib as mpl

    motions = tuned.motions
    with mpl.rc_context(STYLE):
        figure, axes = new_figure(3, len(motions), (4.2 * len(motions), 7.5))
        for k, motion in enumerate(motions):
            course = motion.course
            time = course.time[: len(course.position)]
            goal = course.reference[: len(time)]
            position, error, command = axes[:, k]
            words = "tuned on" if motion.tuned_on else "not tuned on"
            position.set_title(f"{motion.name}, {words}")
            position.plot(time, 1e3 * goal, color=COLOURS[1], ls=DASHES[1], label="set-point")
            position.plot(time, 1e3 * course.position, color=COLOURS[0], label="position")
            error.plot(time, 1e6 * (goal - course.position), color=COLOURS[0])
            command.plot(time, course.command[: len(time)], color=COLOURS[0], label="command")
            for sign in (1, -1):
                label = "limit" if sign > 0 else None
                command.axhline(sign * tuned.limit, color=COLOURS[6], ls=DASHES[3], label=label)
            command.set_xlabel("time [s]")
        axes[0, 0].set_ylabel("position [mm]")
        axes[1, 0].set_ylabel("error [µm]")
        axes[2, 0].set_ylabel(f"command [{tuned.command_unit}]")
        axes[0, 0].legend()
        axes[2, 0].legend()
    return figure


def bode_figure(tuned: TunedController) -> Any:
    """Gain and phase of the open loop, and the sensitivity, stuck and sliding."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        figure, ((gain,), (phase,), (sensitivity,)) = new_figure(3, 1, (8, 9))
        for k, m in enumerate(tuned.margins):
            name = f"sliding at {m.speed:g} m/s" if m.speed else "stuck"
            style: dict[str, Any] = {"color": COLOURS[k], "ls": DASHES[k], "label": name}
            gain.loglog(m.frequency, np.abs(m.response), **style)
            angle = np.unwrap(np.angle(m.response))
            angle -= 2 * np.pi * np.ceil((angle[0] - np.pi / 4) / (2 * np.pi))  # -180, not 180
            phase.semilogx(m.frequency, np.degrees(angle), **style)
            sensitivity.loglog(m.frequency, np.abs(1 / (1 + m.response)), **style)
        gain.axhline(1, color="#555555", lw=0.8)
        phase.axhline(-180, color="#555555", lw=0.8)
        gain.set_ylabel("gain of the open loop")
        phase.set_ylabel("phase [degrees]")
        sensitivity.set_ylim(bottom=1e-3)
        sensitivity.set_ylabel("sensitivity |1/(1 + L)|")
        sensitivity.set_xlabel("frequency [Hz]")
        gain.set_title(f"{tuned.loop.title}, broken at the command")
        gain.legend()
        figure.align_ylabels()
    return figure

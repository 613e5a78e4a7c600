"""Run a closed loop in any form."""

from __future__ import annotations

from .closed_loop import run_pair
from .closed_loop_result import ClosedLoopResult
from .loop import Loop, SystemLoop
from .master import Progress
from .system import run_system


def run_closed_loop(loop: Loop | SystemLoop, progress: Progress | None = None) -> ClosedLoopResult:
    """Run a closed loop, with a verdict on its coupling.

    Raises
    ------
    FmuError, BadSystem, WiringError, CouplingError, BadParameter
        If the loop cannot be run; the message says why.
    StepFailed
        If a part rejects its initial values.
    """
    return run_system(loop, progress) if isinstance(loop, SystemLoop) else run_pair(loop, progress)

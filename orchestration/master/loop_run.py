"""A coupled run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .couplings import Coupling
from .verdict import Verdict

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LoopRun:
    """A coupled run."""

    time: Vector  # shape (k,); communication points [s]
    # shape (k,); the plant's outputs, under the names they are mapped to
    outputs: dict[str, Vector]
    # shape (k,); the controller's commands, under the names of the plant's inputs
    commands: dict[str, Vector]
    reference: Vector  # shape (k,)
    coupling: Coupling
    coupling_reason: str  # reason for the coupling, if it was chosen by rule
    corrected: bool
    residual_max: dict[str, float]  # largest coupling residual of each command, in its unit
    # largest effect of the residual on each output, per second; empty if there was no correction
    effect_rate_max: dict[str, float]
    macro_steps: int
    step_range: tuple[float, float]  # shortest and longest communication step [s]
    verdict: Verdict
    stopped: str = ""  # why the run ended early; empty if it did not
    diverged: bool = False  # whether it ended because an output diverged
    # shape (k,); the controller's other outputs, as ``controller.NAME``
    others: dict[str, Vector] = field(default_factory=dict)
    # of outputs and commands, if the parts declare them
    units: dict[str, str] = field(default_factory=dict)
    # sampling period of the controller and its instruments [s]; 0 if nothing is sampled
    sampling_period: float = 0.0
    # factor and offset from the set-point's SI unit to the unit of `reference` and the position
    scale: tuple[float, float] = (1.0, 0.0)
    limit: float = math.inf  # largest command that the plant lets through, in the command's unit
    # the same with points between the communication points, where equations are solved
    between: LoopRun | None = None

    @property
    def judged(self) -> dict[str, Vector]:
        """The outputs that the verdict covers."""
        judged = self.verdict.error_estimate
        return self.outputs | {n: values for n, values in self.others.items() if n in judged}

    @property
    def alone(self) -> bool:
        """Whether the plant ran without commands, and so without a set-point."""
        return not self.commands

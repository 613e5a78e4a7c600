"""A coupled run, and the loops and chunks that it is recorded in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..fmu.fmu_instance import StepFailed
from ..fmu.memory import check_memory
from .compiled import COURSE, FARTHEST
from .coupling import CoupledPair
from .couplings import Coupling
from .reference_signal import Reference
from .structs import Struct, struct
from .verdict import ACCURACY, Verdict

Vector = npt.NDArray[np.float64]

CHUNK = 4096  # most steps between two checks of the elapsed time
NEGLIGIBLE = 1e-7  # of the range: a smaller sum of effects is round-off
UNKNOWN = 1e12  # like FARTHEST, for outputs without a known nominal value
UNBOUNDED = StepFailed("").advice


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
    played: bool = False  # whether compiled code replaced the FMUs, see `run_loop`

    @property
    def judged(self) -> dict[str, Vector]:
        """The outputs that the verdict covers."""
        judged = self.verdict.error_estimate
        return self.outputs | {n: values for n, values in self.others.items() if n in judged}

    @property
    def alone(self) -> bool:
        """Whether the plant ran without commands, and so without a set-point."""
        return not self.commands


class RecordedLoop:
    """One loop with its records; `parts` as in `PAIR`."""

    def __init__(self, whole: Struct, loop: CoupledPair, parts: int) -> None:
        self.loop, self._whole = loop, whole
        self._room = np.empty((CHUNK, len(loop.outputs) + len(loop.other_names)))
        whole.set(parts=parts, recorded=self._room, failed=math.nan)
        self.outputs = [np.concatenate([loop.outputs, loop.others()])[None]]
        self.failure = ""

    def begin(self) -> None:
        """Read the controller's other outputs at the start again."""
        self.outputs[0][0, len(self.loop.outputs) :] = self.loop.others()

    @property
    def record(self) -> Any:
        """The pair as compiled code sees it."""
        return self._whole.record

    @property
    def address(self) -> int:
        return self._whole.address

    def collect(self) -> None:
        """Keep what the last chunk recorded."""
        self.outputs.append(self._room[: self.record.rows].copy())
        if not math.isnan(self.record.failed) and not self.failure:
            t = self.record.failed
            self.failure = f"the reference co-run loop failed at t = {t:.6g} s: {self.error()}"

    def close(self) -> None:
        """Close both instances."""
        self.loop.plant.close()
        self.loop.controller.close()

    def error(self) -> StepFailed:
        """Return the loop's StepFailed; raise any other error, such as an interruption."""
        error = self.loop.failure()
        assert error is not None
        if not isinstance(error, StepFailed):
            raise error
        return error


def bounds(nominal: Vector, start: Vector) -> Vector:
    """Largest outputs before a loop counts as diverged.

    A nominal value of 1 counts as missing, unless most of the others are given. Values in counts,
    in pascals or of absolute encoders are far above 1 at rest.
    """
    size = np.maximum(np.maximum(nominal, 1.0), np.abs(np.nan_to_num(start)))
    told = nominal != 1.0
    return np.where(told | (np.mean(told) > 0.5), FARTHEST, UNKNOWN) * size


def check_room(outputs: int, commands: int, co_runs: int, steps: float) -> None:
    """Refuse a run whose rows do not fit into memory.

    Each row exists twice while the chunks are joined; the verdict and the pictures need some more
    columns.
    """
    rows = 2 * (outputs * (1 + co_runs) + commands + 2) + 3 * outputs
    check_memory(
        8.0 * rows * steps,
        f"{steps:.3g} communication steps need",
        "use a longer --step or a shorter --stop",
    )


class RunLog:
    """The rows of a run in chunks, and the measurements during the run.

    Each of the set-points has one of `orders`; `outputs` are the plant's at the start, with their
    `nominal` values; `m` is the number of commands, kept at the end of each step if asked.
    """

    def __init__(
        self,
        reference: Reference,
        orders: Sequence[int],
        outputs: Vector,
        nominal: Vector,
        m: int,
        keeps_commands: bool = True,
    ) -> None:
        self._whole = struct(COURSE)
        self._rows = (
            np.empty(CHUNK),
            np.empty(CHUNK),
            np.empty((CHUNK, m * keeps_commands)),
        )
        self.bounds = bounds(nominal, outputs)
        self.residual, self.effect_rate = np.zeros(m), np.zeros(len(outputs))
        self._whole.set(
            times=self._rows[0],
            references=self._rows[1],
            commands=self._rows[2],
            nominal=nominal,
            bounds=self.bounds,
            low=outputs.copy(),
            high=outputs.copy(),
            residual=self.residual,
            effect_rate=self.effect_rate,
            apart=np.zeros(len(outputs)),
            goal_times=np.ascontiguousarray(reference.times, dtype=float),
            goal_pieces=np.stack([reference.pieces(k) for k in (0, *orders)], axis=1).ravel(),
            accuracy=ACCURACY,
            before=np.zeros(len(orders)),
            after=np.zeros(len(orders)),
        )
        self.start = reference.at(0.0)
        self.times, self.references = [np.zeros(1)], [np.array([self.start])]
        self.commands: list[Vector] = []

    @property
    def address(self) -> int:
        return self._whole.address

    def collect(self, rows: int) -> None:
        """Keep what the last chunk recorded."""
        for kept, room in zip(
            (self.times, self.references, self.commands), self._rows, strict=True
        ):
            kept.append(room[:rows].copy())

    @property
    def contraction(self) -> float:
        record = self._whole.record
        weight = record.contraction_weight
        return float(record.contraction / weight) if weight >= NEGLIGIBLE else 0.0

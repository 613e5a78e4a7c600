"""Runs of one loop with steps that are halves of each other, each done once, without a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...solver.arrays import Vector
from ..fmu.limits import check_memory
from ..fmu.wiring import CONTROLLER, PLANT, names_on
from .algebraic_loop import with_ring_named
from .coupling import Answer, CoupledPair
from .jumps import Setting, around_jumps, jumps
from .march import Clock, LoopRun, Progress, Record, Stop, march_on
from .sides import Sides, step_that_meets
from .verdict import ACCURACY, Rung, Verdict, apart, largest, scales

FEWEST = 4  # steps of a longer one that says anything


class Runs:
    """Runs of a loop with steps of ``first / 2^level`` seconds; levels may be negative.

    Parameters
    ----------
    sides : Sides
        The first run uses these instances themselves, all others open them again.
    first : float
        [s]; it is shortened if the controller's sampling period is no multiple of it.
    progress : function, optional
        Called repeatedly with the present time of a run.

    Raises
    ------
    StepFailed
        If a part rejects its parameters or initial values.
    """

    def __init__(self, sides: Sides, first: float, progress: Progress | None = None) -> None:
        self.sides, self._progress = sides, progress
        self._main: CoupledPair | None = sides.main()
        self._reason = sides.reason_of(self._main)
        self._period = self._main.controller.sample_time
        self._first = step_that_meets(self._period, first)
        if abs(self._first - first) > 1e-9 * first:
            self._reason += (
                f"; steps of {self._first:g} s meet its samples every {self._period:g} s"
            )
        self.varies = all(getattr(s, "steps_vary", True) for s in (sides.plant, sides.controller))
        self._breaks = sides.reference.jumps(sides.wiring.orders) if self.varies else np.zeros(0)
        # of results; in a network, the outputs of all elements are judged
        called = names_on(PLANT, [*sides.plant.outputs, *sides.plant.inputs], sides.mapping)
        self._outputs = [called[n] for n in sides.plant.outputs]
        self._commands = [called[theirs] for _, theirs in sides.wiring.commands]
        others = sides.wiring.others if sides.wiring.network else ()
        self.names = [*self._outputs, *others]
        self._runs: dict[int, LoopRun] = {}
        self._own: dict[int, Rung] = {}
        self._rungs: dict[int, Rung] = {}
        self._pairs: dict[int, CoupledPair] = {}

    def step(self, level: int) -> float:
        """The communication step [s]."""
        return self._first * 0.5**level

    def run(self, level: int) -> LoopRun:
        """The run as asked.

        Raises `UserError` if the rows of all steps do not fit.
        """
        if level not in self._runs:
            pair = self._main or self.sides.main(again=True)
            # the effect of the residual is that of a correction
            best = [] if pair.corrected == self.sides.reversible else [self.sides.best()]
            run, rungs = self._marched([pair, *best], level)
            self._runs[level], self._pairs[level] = run, pair
            self._own[level], self._rungs[level] = rungs[0], rungs[-1]
        return self._runs[level]

    def rung(self, level: int) -> Rung | None:
        """The run with corrections if possible; None if its step is too long for the loop."""
        step = self.step(level)
        if level not in self._rungs:
            meets = abs(step_that_meets(self._period, step) - step) <= 1e-9 * step
            if not (meets and FEWEST * step <= self.sides.stop):
                return None
            if self.sides.corrected == self.sides.reversible:
                self.run(level)
            else:
                self._rungs[level] = self._marched([self.sides.best()], level)[1][0]
        return self._rungs[level]

    def own(self, level: int) -> Rung:
        """The outputs of the run as asked."""
        self.run(level)
        return self._own[level]

    def adaptive(self) -> tuple[LoopRun, Rung, Rung]:
        """The run with steps up to the first, chosen by the effect of the residual.

        Its outputs follow, and those with half of each step.
        """
        main = self._main or self.sides.main(again=True)
        pairs = [main, self.sides.otherwise(main)]
        pairs.append(self.sides.again(main.corrected, main.averaged, 2))
        run, (own, _, half) = self._marched(pairs, 0, adaptive=True)
        self._runs[0], self._pairs[0] = run, main
        return run, own, half

    def otherwise(self, level: int) -> Rung:
        """The same steps with the other way of exchange, see `Sides.otherwise`."""
        self.run(level)
        return self._marched([self.sides.otherwise(self._pairs[level])], level)[1][0]

    def of_command_times(self, level: int, below: int) -> Vector | float:
        """Effect of commands that are late or early by a step of this level, (n,)."""
        answer = self._pairs[level].answer
        if not self.sides.times_commands(answer):
            return 0.0
        finest = self.rung(level + below)
        off = self._marched([self.sides.a_step_off(answer)], level + below)[1][0]
        return 2.0**below * apart(off, finest) if finest else 0.0

    def jumps(self, level: int) -> bool:
        """Whether an output of the plant jumps in the run."""
        return bool(jumps(self.own(level).outputs[:, : len(self._outputs)]).any())

    def switches(self, level: int) -> bool:
        """Whether a command jumps, and not at the sample instants, which are given."""
        if self._pairs[level].answer is Answer.SAMPLED:
            return False
        commands = list(self.run(level).commands.values())
        return bool(commands and jumps(np.column_stack(commands)).any())

    def bends(self, level: int) -> bool:
        """Whether the set-point is not straight within the steps."""
        step, orders = self.step(level), self.sides.wiring.orders
        return self.sides.reference.bends_within(step, self.sides.stop, orders, self._breaks)

    def around(self, level: int, finest: Rung) -> Vector:
        """Parts of the jumps of each output that may be on the other side of a point, (n,)."""
        own, n = self.own(level), len(self._outputs)
        rows = np.searchsorted(finest.times, own.times - 1e-6 * finest.step)
        distance = 2.0 * np.abs(own.outputs - finest.outputs[rows])[:, :n]
        setting = Setting(self.sides, self.step(level), self._breaks)
        found = np.zeros(len(self.names))
        run = own.outputs[:, :n]
        found[:n] = largest(around_jumps(setting, run, distance), run)
        return found

    def named(self, level: int, run: LoopRun) -> LoopRun:
        """The run; the verdict says if an algebraic loop is why it is not trusted."""
        return with_ring_named(run, self._pairs[level], self.sides, self.step(level))

    def _marched(
        self, pairs: Sequence[CoupledPair], level: int, adaptive: bool = False
    ) -> tuple[LoopRun, list[Rung]]:
        """The run of the first of the loops, and the outputs of each of them."""
        sides, main, step = self.sides, pairs[0], self.step(level)
        _check_room(main, len(pairs) + 1, sides.stop / step)
        record = Record(main, sides.reference, sides.wiring.orders)
        clock = Clock(sides.stop, step, adaptive, self._breaks)
        try:
            why = march_on(pairs, clock, record, self._progress)
        finally:
            for pair in pairs:
                if pair is not self._main:
                    pair.close()
        self._main = None
        times = np.concatenate(record.times)
        tables = [np.concatenate(pair.rows)[:, : len(self.names)] for pair in pairs]
        failures = [why.reason, *(pair.failure for pair in pairs[1:])]
        rungs = [
            Rung(step, times[: len(table)], table, failure)
            for table, failure in zip(tables, failures, strict=True)
        ]
        return self._concluded(main, record, clock, why), rungs

    def _concluded(self, main: CoupledPair, record: Record, clock: Clock, why: Stop) -> LoopRun:
        sides = self.sides
        commands = np.concatenate(record.commands)
        outputs, others = np.split(np.concatenate(main.rows), [len(self._outputs)], axis=1)
        effects = dict(zip(self._outputs, record.effect_rate.tolist(), strict=True))
        advice = why.advice if why.reason else self._advice(main, commands, clock)
        contraction = record.contraction if sides.reversible else np.nan
        prefix = "" if sides.wiring.network else f"{CONTROLLER}."
        return LoopRun(
            time=np.concatenate(record.times),
            outputs={n: outputs[:, k] for k, n in enumerate(self._outputs)},
            commands={n: commands[:, k] for k, n in enumerate(self._commands)},
            reference=np.concatenate(record.references),
            coupling=sides.scheme,
            coupling_reason=self._reason,
            corrected=main.corrected,
            residual_max=dict(zip(self._commands, record.residual.tolist(), strict=True)),
            effect_rate_max=effects if sides.reversible else {},
            macro_steps=len(commands) - 1,
            step_range=clock.used,
            verdict=Verdict(False, why.reason or "it was not judged", advice, {}, contraction),
            stopped=why.reason,
            diverged=why.diverged,
            others={f"{prefix}{n}": others[:, k] for k, n in enumerate(main.other_names)},
            sampling_period=self._period,
        )

    def _advice(self, main: CoupledPair, commands: Vector, clock: Clock) -> str:
        """What to do about a residual that is too large.

        With jacobi, its first step may hold a start value far from the first command.
        """
        smaller = "use a smaller --step"
        if not self.sides.scheme.law:
            smaller += ", or --coupling interface-jacobian if both sides support it"
        smaller += f"; this run used steps of {clock.used[1]:g} s"
        late = self.sides.scheme.late and main.answer is Answer.STEPPED
        if not late or not self._commands:
            return smaller
        off = np.abs(commands[0] - main.given) / scales(commands)
        worst = int(np.argmax(off))
        if not off[worst] > ACCURACY:
            return smaller
        return (
            f"{self._commands[worst]} starts at {main.given[worst]:.4g} and is "
            f"{commands[0, worst]:.4g} after the first step of the controller, which jacobi does "
            "not use: give it that start value, or use --coupling gauss-seidel"
        )


def _check_room(main: CoupledPair, runs: int, steps: float) -> None:
    """Refuse a run whose rows do not fit into memory.

    Each row exists twice while the chunks are joined; the verdict and the pictures need some more
    columns.
    """
    outputs, others = len(main.outputs), len(main.given) + len(main.other_names)
    rows = 2 * (outputs * runs + others + 2) + 3 * outputs
    check_memory(
        8.0 * rows * steps,
        f"{steps:.3g} communication steps need",
        "use a longer --step or a shorter --stop",
    )

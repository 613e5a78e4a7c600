"""Runs of one loop with steps that are halves of each other, each done once, without a verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...solver.arrays import Vector
from ..fmu.limits import check_memory
from ..fmu.wiring import CONTROLLER, PLANT, names_on
from .coupling import Answer, CoupledPair
from .jumps import around_jumps, jumps
from .march import Clock, LoopRun, Progress, Record, march_on
from .sides import Sides, step_that_meets
from .verdict import ACCURACY, WORST_CONTRACTION, Rung, Verdict, apart, largest, rows_at, scales

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

    def __init__(self, sides: Sides, first: float, progress: Progress = None) -> None:
        self.sides, self._progress = sides, progress
        self._main: CoupledPair | None = sides.main()
        self._reason = sides.reason_of(self._main)
        self._period = self._main.controller.sample_time
        self._first = step = step_that_meets(self._period, first)
        if abs(step - first) > 1e-9 * first:
            self._reason += f"; steps of {step:g} s meet its samples every {self._period:g} s"
        self.varies = all(getattr(s, "steps_vary", True) for s in (sides.plant, sides.controller))
        self._breaks = sides.reference.jumps(sides.wiring.orders) if self.varies else np.zeros(0)
        # of results; in a network, the outputs of all elements are judged
        called = names_on(PLANT, [*sides.plant.outputs, *sides.plant.inputs], sides.mapping)
        self._outputs = [called[n] for n in sides.plant.outputs]
        self._commands = [called[theirs] for _, theirs in sides.wiring.commands]
        self.names = [*self._outputs, *(sides.wiring.others if sides.wiring.network else ())]
        self._runs: dict[int, tuple[LoopRun, Rung, CoupledPair]] = {}
        self._rungs: dict[int, Rung] = {}

    def step(self, level: int) -> float:
        """The communication step [s]."""
        return self._first * 0.5**level

    def run(self, level: int) -> LoopRun:
        """The run as asked.

        Raises `UserError` if the rows of all steps do not fit.
        """
        return self._asked(level)[0]

    def own(self, level: int) -> Rung:
        """The outputs of the run as asked."""
        return self._asked(level)[1]

    def _asked(self, level: int) -> tuple[LoopRun, Rung, CoupledPair]:
        """The run as asked, its outputs, and its loop, which is closed."""
        if level not in self._runs:
            pair = self._main or self.sides.main()
            # the effect of the residual is that of a correction; without commands there is none
            known = pair.corrected == self.sides.reversible or not self._commands
            best = None if known else self.sides.best()
            run, own, self._rungs[level] = self._marched(pair, level, best)
            self._runs[level] = run, own, pair
        return self._runs[level]

    def rung(self, level: int) -> Rung | None:
        """The run with corrections if possible; None if its step is too long for the loop."""
        step = self.step(level)
        if level not in self._rungs:
            meets = abs(step_that_meets(self._period, step) - step) <= 1e-9 * step
            if not (meets and FEWEST * step <= self.sides.stop):
                return None
            if self.sides.corrected == self.sides.reversible:
                self._asked(level)
            else:
                self._rungs[level] = self._alone(self.sides.best(), level)
        return self._rungs[level]

    def otherwise(self, level: int) -> Rung:
        """The same steps with the other way of exchange, see `Sides.otherwise`."""
        return self._alone(self.sides.otherwise(self._asked(level)[2]), level)

    def of_command_times(self, level: int, below: int) -> Vector | float:
        """Effect of commands that are late or early by a step of this level, (n,)."""
        answer, finest = self._asked(level)[2].answer, self.rung(level + below)
        if finest is None or not self.sides.times_commands(answer):
            return 0.0
        off = self._alone(self.sides.a_step_off(answer), level + below)
        return 2.0**below * apart(off, finest)

    def jumps(self, level: int) -> bool:
        """Whether an output of the plant jumps in the run."""
        return bool(jumps(self.own(level).outputs[:, : len(self._outputs)]).any())

    def switches(self, level: int) -> bool:
        """Whether a command jumps, and not at the sample instants, which are given."""
        run, _, pair = self._asked(level)
        commands = list(run.commands.values())
        if not commands or pair.answer is Answer.SAMPLED:
            return False
        return bool(jumps(np.column_stack(commands)).any())

    def bends(self, level: int) -> bool:
        """Whether the set-point is not straight within the steps."""
        step, orders = self.step(level), self.sides.wiring.orders
        return self.sides.reference.bends_within(step, self.sides.stop, orders, self._breaks)

    def around(self, level: int, finest: Rung) -> Vector:
        """Parts of the jumps of each output that may be on the other side of a point, (n,)."""
        own, n = self.own(level), len(self._outputs)
        run = own.outputs[:, :n]
        distance = 2.0 * np.abs(run - finest.outputs[rows_at(own, finest), :n])
        around = around_jumps(self.sides, self.step(level), self._breaks, run, distance)
        return np.append(largest(around, run), np.zeros(len(self.names) - n))

    def named(self, level: int, run: LoopRun) -> LoopRun:
        """The run; the verdict says if an algebraic loop is why it is not trusted, with any step.

        If a plant updates its outputs when its inputs are set, the master solves the loop at every
        communication point (`settle` in ``c/coupling.c``). If one with direct feedthrough updates
        them in its step only, the master is always one step late.
        """
        sides, pair = self.sides, self._asked(level)[2]
        if unsolved := int(pair.whole.record.unsolved):
            found = f"has no solution at {unsolved} communication points"
        else:
            follows = any(sides.plant.follows_at_once(ours) for ours, _ in sides.wiring.signals)
            if run.verdict.trusted or not follows or pair.answer is not Answer.DIRECT:
                return run
            # corrected steps must halve the residual; others converge as long as it does not grow
            corrects = pair.plant.can_save and pair.controller.can_save
            gain = sides.loop_gain(self.step(level))
            if gain < (WORST_CONTRACTION if corrects else 1.0):
                return run
            found = f"has a loop gain of {gain:.3g}"
        why = (
            "the plant's outputs and the controller's commands depend on each other without "
            f"delay: this algebraic loop {found}, and a shorter step does not help"
        )
        advice = (
            "let the plant update its outputs as soon as its inputs are set, as in model exchange, "
            "add a filter or a delay to the loop, or combine the two FMUs into one"
        )
        verdict = replace(run.verdict, trusted=False, reason=why, advice=advice, step_helps=False)
        return replace(run, verdict=verdict)

    def _alone(self, pair: CoupledPair, level: int) -> Rung:
        return self._marched(pair, level)[1]

    def _marched(
        self, main: CoupledPair, level: int, best: CoupledPair | None = None
    ) -> tuple[LoopRun, Rung, Rung]:
        """A run, its outputs, and those of the co-run, or again its own."""
        sides, step = self.sides, self.step(level)
        pairs = [main, best] if best else [main]
        # each row exists twice while the chunks are joined; verdict and pictures need more columns
        columns = len(main.outputs) * (len(pairs) + 1) + len(main.given) + len(main.other_names) + 2
        size, count = 8.0 * (2 * columns + 3 * len(main.outputs)), sides.stop / step
        remedy = "use longer communication steps or a shorter run"
        check_memory(size * count, f"{count:.3g} communication steps need", remedy)
        record = Record(main, sides.reference, sides.wiring.orders)
        clock = Clock(sides.stop, step, self._breaks)
        try:
            march_on(main, clock, record, best, self._progress)
        finally:
            for pair in pairs:
                if pair is not self._main:
                    pair.close()
        self._main = None
        run, rungs = self._concluded(main, record, clock), list[Rung]()
        for pair in pairs:
            table = np.concatenate(pair.rows)[:, : len(self.names)]
            rungs.append(Rung(step, run.time[: len(table)], table, pair.failure))
        return run, rungs[0], rungs[-1]

    def _concluded(self, main: CoupledPair, record: Record, clock: Clock) -> LoopRun:
        sides, stopped = self.sides, main.failure
        times, references, commands = record.courses()
        outputs, others = np.split(np.concatenate(main.rows), [len(self._outputs)], axis=1)
        advice = record.advice if stopped else self._advice(main, commands, clock)
        contraction = record.contraction if sides.reversible else np.nan
        prefix = "" if sides.wiring.network else f"{CONTROLLER}."
        verdict = Verdict(False, stopped or "it was not judged", advice, {}, contraction)
        shown = {n: outputs[:, k] for k, n in enumerate(self._outputs)}
        given = {n: commands[:, k] for k, n in enumerate(self._commands)}
        seen = {f"{prefix}{n}": others[:, k] for k, n in enumerate(main.other_names)}
        residual = dict(zip(self._commands, record.residual.tolist(), strict=True))
        effects = dict(zip(self._outputs, record.effect_rate.tolist(), strict=True))
        known = times, shown, given, references, residual, effects if sides.reversible else {}
        run = LoopRun(*known, len(commands) - 1, clock.used, verdict, stopped, sides.scheme)
        run = replace(run, coupling_reason=self._reason, corrected=main.corrected, others=seen)
        return replace(run, sampling_period=self._period)

    def _advice(self, main: CoupledPair, commands: Vector, clock: Clock) -> str:
        """What to do about a residual that is too large.

        With jacobi, its first step may hold a start value far from the first command.
        """
        if self._commands and self.sides.scheme.late and main.answer is Answer.STEPPED:
            off = np.abs(commands[0] - main.given) / scales(commands)
            worst = int(np.argmax(off))
            if off[worst] > ACCURACY:
                start, first = main.given[worst], commands[0, worst]
                return (
                    f"{self._commands[worst]} starts at {start:.4g} and is {first:.4g} after the "
                    "first step of the controller, which jacobi does not use: give it that start "
                    "value, or use the coupling gauss-seidel"
                )
        better = ", or the coupling interface-jacobian if both sides support it"
        used = f"use shorter communication steps than {clock.used[1]:g} s"
        return used if self.sides.scheme.law else used + better

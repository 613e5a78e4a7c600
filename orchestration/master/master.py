"""The master: simulate a plant and a controller together, and judge the result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ...solver.errors import CouplingError
from ..fmu.fmu_instance import Instance, Value
from ..fmu.group import Group, initialize
from ..fmu.wiring import CONTROLLER, PLANT, Wiring, names_on, wire
from .algebraic_loop import with_ring_named
from .clock import Clock
from .compiled import (
    CALL_FAILED,
    COMMAND_FAILED,
    DIVERGES,
    GOES_ON,
    NOT_FINITE,
    PAIR,
    STEP_FAILED,
    library,
)
from .coupling import Answer, CoupledPair
from .coupling_choice import choose_coupling, late_start, tangent_reason
from .couplings import Coupling
from .loop_run import CHUNK, UNBOUNDED, LoopRun, RecordedLoop, RunLog, check_room
from .played import can_be_played, reopened_to_judge
from .reference_signal import Reference
from .second_look import Setting, with_second_look
from .structs import struct
from .verdict import Verdict, verdict_of

Vector = npt.NDArray[np.float64]
Progress = Callable[[float], None]

LONGEST_WAIT = 0.05  # s; after a chunk that took longer, the next one is shorter


def run_loop(  # noqa: PLR0913
    plant: Instance,
    controller: Instance,
    reference: Reference,
    stop: float,
    step: float,
    *,
    coupling: Coupling | None = None,
    corrections: int | None = None,
    adaptive: bool = False,
    plant_values: Mapping[str, Value] | None = None,
    controller_values: Mapping[str, Value] | None = None,
    mapping: Mapping[str, str] | None = None,
    wiring: Wiring | None = None,
    progress: Progress | None = None,
    look_again: bool = True,
    tries: bool = False,
) -> LoopRun:
    """Run a closed loop of two FMU instances.

    Parameters
    ----------
    plant, controller : Instance
        Not initialized yet.
    reference : Reference
        For the controller's set-point, see `wire`.
    stop, step : float
        End of the run and communication step [s]; for an adaptive run the longest step.
    coupling : Coupling, optional
        Default: tangent if the plant accepts a feedback law and derivatives of the controller
        are available, else gauss-seidel.
    corrections : {0, 1}, optional
        Default: 1 for interface-Jacobian coupling if both sides can save their states, else 0.
    adaptive : bool
        Whether the steps are chosen by the residual's effect.
    mapping : mapping of str to str, optional
        Names of ports, ``theirs -> ours``, see `wire`.
    wiring : Wiring, optional
        The connections. Default: ports of the same name, or as mapped; if given,
        `mapping` only names the results.
    progress : function, optional
        Called repeatedly with the present time.
    look_again : bool
        Whether an unclear verdict is checked by runs with finer steps.
    tries : bool
        Whether compiled code may replace the FMUs, see `played.py`; the numbers are the same.

    Returns
    -------
    LoopRun

    Raises
    ------
    CouplingError
        If the parts cannot be coupled in this way.
    StepFailed
        If a part rejects its parameters or initial values.
    UserError
        If the rows of all steps do not fit.
    """
    wiring = wiring or wire(plant, controller, mapping)
    missing = _missing(plant, controller, wiring)
    names, commands = _names(plant, wiring, mapping or {})
    values = (dict(plant_values or {}), dict(controller_values or {}))
    start = reference.all_at(0.0, wiring.orders)
    chosen, reason = choose_coupling(wiring, plant, controller, coupling)
    tangent = chosen.law
    corrected = _corrects(corrections, adaptive, tangent, missing)
    parts = _Parts(plant, controller, wiring, values, stop, start, chosen)
    played = tries and can_be_played(plant) and can_be_played(controller)
    main = parts.loop(corrected, tangent or corrected, fresh=False, judges=played)
    if coupling is None and tangent:
        reason = tangent_reason(main.loop, wiring)
    step, reason = _meet_samples(main.loop, step, reason)
    varies = all(getattr(side, "steps_vary", True) for side in (plant, controller))
    breaks = reference.jumps(wiring.orders) if varies else np.zeros(0)
    curved = reference.bends_within(step, stop, wiring.orders, breaks) or wiring.network
    curved = not missing and curved
    co_runs = parts.co_runs(main.loop, not missing, curved)
    check_room(len(names), len(commands) + len(wiring.others), len(co_runs), stop / step)
    nominal = np.array([plant.nominal(name) for name in plant.outputs])
    course = RunLog(reference, wiring.orders, main.loop.outputs, nominal, len(commands))
    try:
        clock = Clock(stop, step, adaptive, breaks)
        why = march_on(main, co_runs, clock, course, start, progress)
    finally:
        for co_run in co_runs:
            co_run.close()
    ended = _Ended(main, co_runs, course, clock, why, not missing)
    first = replace(_concluded(ended, names, commands, chosen, reason), played=played)
    if wiring.is_empty and first.verdict.trusted:
        own = (
            f"there is no coupling; this run does not check how accurate {plant.name}'s own "
            "solver is"
        )
        return replace(first, verdict=replace(first.verdict, reason=own))
    if not look_again or adaptive or why.reason or any(pair.failure for pair in co_runs):
        return with_ring_named(first, main.loop, parts.opened, wiring, start, step)
    setting = Setting(
        lambda cut: parts.loop(not missing, tangent or not missing, cut, judges=True),
        partial(march_on, progress=progress),
        reference,
        wiring.orders,
        breaks,
        start,
        nominal,
        len(commands),
        stop,
        step,
    )
    compared = co_runs[:1] if not missing else co_runs
    if wiring.network and not missing:  # the reverse order may be wrong where the run is right
        compared = co_runs[-1:]
    width = len(first.verdict.error_estimate)
    outputs, *finer = (np.concatenate(pair.outputs)[:, :width] for pair in (main, *compared))
    late = parts.late(main, bool(missing))
    judged = with_second_look(first, outputs, finer, _safety(main.loop), setting, late)
    return with_ring_named(judged, main.loop, parts.opened, wiring, start, step)


@dataclass(frozen=True)
class _Parts:
    """Opens the loops of a run, all from the same parts."""

    plant: Instance
    controller: Instance
    wiring: Wiring
    values: tuple[dict[str, Value], dict[str, Value]]
    stop: float
    start: Vector
    coupling: Coupling

    def opened(
        self, fresh: bool = True, judges: bool = False, turned: bool = False
    ) -> tuple[Instance, Instance]:
        """Plant and controller, initialized together; see `loop`."""
        p, c = self.plant, self.controller
        if turned:
            p, c = (s.reopened(True) if isinstance(s, Group) else s.reopened() for s in (p, c))
        elif judges:
            p, c = reopened_to_judge(p), reopened_to_judge(c)
        elif fresh:
            p, c = p.reopened(), c.reopened()
        initialize(p, c, self.wiring, self.values, self.stop, self.start)
        return p, c

    def loop(
        self,
        corrected: bool,
        averaged: bool,
        cut: int = 1,
        fresh: bool = True,
        other: Coupling | None = None,
        judges: bool = False,
        turned: bool = False,
    ) -> RecordedLoop:
        """Open a loop at its start, with new instances if `fresh`; `cut` is `parts` in `PAIR`.

        If it `judges`, compiled code may play its FMUs, see `played.py`; if it is `turned`, its
        groups begin with the reverse order.
        """
        p, c = self.opened(fresh, judges, turned)
        whole = struct(PAIR)
        part = whole.part("loop")
        wiring = self.wiring
        if fresh and not wiring.network:  # other outputs are judged in networks only
            wiring = replace(wiring, others=())
        loop = CoupledPair(
            p, c, wiring, other or self.coupling, corrected, averaged, self.start, part
        )
        return RecordedLoop(whole, loop, cut)

    def co_runs(self, main: CoupledPair, reversible: bool, curved: bool) -> list[RecordedLoop]:
        """Open the co-runs: the other scheme, or shorter steps if no states can be saved.

        The other scheme has the same error as the run if the set-point is `curved` within the
        steps; then a co-run with half of the step is added. In a network, the other scheme also
        steps the parts in reverse order.
        """
        tangent, turned = self.coupling.law, self.wiring.network
        if reversible:
            other = self.loop(not main.corrected, not tangent, judges=True, turned=turned)
            if not curved:
                return [other]
            return [other, self.loop(main.corrected, main.averaged, 2, judges=True)]
        return [self.loop(False, averaged=tangent, cut=cut, judges=True) for cut in (2, 4)]

    def late(self, main: RecordedLoop, blind: bool) -> Callable[[], RecordedLoop] | None:
        """Return a function that opens a loop with other command times; None if not useful."""
        tangent = self.coupling.law
        answer = main.loop.answer
        # the times of sampled commands are given; a law follows the signals within the step
        in_time = answer is Answer.SAMPLED or (tangent and answer is Answer.DIRECT)
        if in_time or not blind:
            return None
        if self.coupling.late:
            other = Coupling.GAUSS_SEIDEL
            return lambda: self.loop(False, averaged=False, other=other, judges=True)

        def opened() -> RecordedLoop:
            pair = self.loop(False, averaged=False, other=Coupling.JACOBI, judges=True)
            if answer is Answer.STEPPED:  # the first step of the run uses the first command, too
                pair.loop.begin_with_first_command()
            return pair

        return opened


def _names(
    plant: Instance, wiring: Wiring, mapping: Mapping[str, str]
) -> tuple[list[str], list[str]]:
    """Names of the plant's outputs and of the commands in the results."""
    ours = names_on(PLANT, [*plant.outputs, *plant.inputs], mapping)
    return [ours[n] for n in plant.outputs], [ours[theirs] for _, theirs in wiring.commands]


def _missing(plant: Instance, controller: Instance, wiring: Wiring) -> str:
    """What a loop lacks for repeating its steps; empty if nothing."""
    if not all(plant.is_real(theirs) for _, theirs in wiring.commands):
        return "real commands"
    can = plant.can_save and controller.can_save
    return "" if can else "both FMUs to save and restore their state"


def _corrects(wanted: int | None, adaptive: bool, tangent: bool, missing: str) -> bool:
    """Whether each step is corrected; default: if a law is applied and nothing is missing."""
    if wanted and missing:
        raise CouplingError(f"corrections need {missing}")
    if adaptive and missing:
        raise CouplingError(f"adaptive steps need {missing}")
    return (tangent and not missing) if wanted is None else bool(wanted)


def _meet_samples(loop: CoupledPair, step: float, reason: str) -> tuple[float, str]:
    period = loop.controller.sample_time
    met = step_that_meets(period, step)
    if abs(met - step) > 1e-9 * step:
        reason += f"; steps of {met:g} s meet its samples every {period:g} s"
    return met, reason


def step_that_meets(period: float, step: float) -> float:
    """The longest step [s], at most `step`, of which the sampling period is a multiple."""
    return period / max(1, math.ceil(period / step - 1e-9)) if period > 0 else step


@dataclass(frozen=True)
class Stop:
    """Reason for the early end of a run; empty if it did not end early."""

    reason: str = ""
    advice: str = UNBOUNDED
    diverged: bool = False


def march_on(
    main: RecordedLoop,
    co_runs: list[RecordedLoop],
    clock: Clock,
    course: RunLog,
    start: Vector,
    progress: Progress | None = None,
) -> Stop:
    """Move a loop, and up to two reference co-runs, from the clock's time to its end.

    `start` has the set-points at that time. Raises `StepFailed` if a loop cannot save or restore
    its state; other failures end the run.
    """
    course.commands.append(main.loop.command(0.0, clock.step_to_come, start)[None])
    pairs = main, *co_runs
    for pair in pairs:
        pair.begin()
    nobody = struct(PAIR)
    first, second = [*(p.address for p in co_runs), nobody.address, nobody.address][:2]
    why, most = GOES_ON, 1
    while why == GOES_ON and not clock.done:
        began = time.perf_counter()
        why = library().master_march(
            main.address, first, second, clock.address, course.address, most
        )
        if why == CALL_FAILED:  # a state could not be saved or restored
            raise next(p.error() for p in pairs if p.loop.failure())
        course.collect(main.record.rows)
        for pair in pairs:
            pair.collect()
        # short chunks: interruptions and progress are handled between two of them
        slow = time.perf_counter() - began > LONGEST_WAIT
        most = max(1, most // 2) if slow else min(2 * most, CHUNK)
        if progress:
            progress(clock.now)
    return _stop(why, clock.now, main, course.bounds)


def _stop(why: int, t: float, main: RecordedLoop, bounds: Vector) -> Stop:
    if why in (STEP_FAILED, COMMAND_FAILED):
        error = main.error()
        where = f"in the step from t = {t:.6g} s" if why == STEP_FAILED else f"at t = {t:.6g} s"
        return Stop(f"{error} ({where})", error.advice)
    if why == NOT_FINITE:
        return Stop(f"an output is not finite at t = {t:.6g} s", diverged=True)
    if why == DIVERGES:
        worst = int(np.argmax(np.abs(main.loop.outputs) / bounds))
        name = list(main.loop.plant.outputs)[worst]
        return Stop(f"the loop diverges: {name} exceeds its bound at t = {t:.6g} s", diverged=True)
    return Stop()


@dataclass(frozen=True)
class _Ended:
    """A run that has ended: its loops with their records, and the reason."""

    main: RecordedLoop
    co_runs: list[RecordedLoop]
    course: RunLog
    clock: Clock
    why: Stop
    reversible: bool

    def verdict(self, names: list[str], ours: list[str], coupling: Coupling) -> Verdict:
        outputs = np.concatenate(self.main.outputs)[:, : len(names)]
        others = [np.concatenate(pair.outputs)[:, : len(names)] for pair in self.co_runs]
        contraction = self.course.contraction
        if not self.reversible:
            contraction, others = _grid_contraction(outputs, *others), others[:1]
        smaller = "use a smaller --step"
        if not coupling.law:
            smaller += ", or --coupling interface-jacobian if both sides support it"
        smaller += f"; this run used steps of {self.clock.used[1]:g} s"
        loop = self.main.loop
        if coupling.late:
            smaller = late_start(loop, np.concatenate(self.course.commands), ours) or smaller
        return verdict_of(
            names,
            outputs,
            others,
            contraction,
            smaller,
            safety=_safety(loop),
            failure=self.why.reason or next((p.failure for p in self.co_runs if p.failure), ""),
            advice=self.why.advice,
        )


def _concluded(
    ended: _Ended, names: list[str], ours: list[str], coupling: Coupling, reason: str
) -> LoopRun:
    main, course = ended.main, ended.course
    table, commands = np.concatenate(main.outputs), np.concatenate(course.commands)
    outputs, others = np.split(table, [len(names)], axis=1)
    network = main.loop.wiring.network
    judged = [*names, *(main.loop.other_names if network else ())]
    return LoopRun(
        time=np.concatenate(course.times),
        outputs={n: outputs[:, k] for k, n in enumerate(names)},
        commands={n: commands[:, k] for k, n in enumerate(ours)},
        reference=np.concatenate(course.references),
        coupling=coupling,
        coupling_reason=reason,
        corrected=main.loop.corrected,
        residual_max=dict(zip(ours, course.residual.tolist(), strict=True)),
        effect_rate_max=(
            dict(zip(names, course.effect_rate.tolist(), strict=True)) if ended.reversible else {}
        ),
        macro_steps=len(commands) - 1,
        step_range=ended.clock.used,
        verdict=ended.verdict(judged, ours, coupling),
        stopped=ended.why.reason,
        diverged=ended.why.diverged,
        others={
            n if network else f"{CONTROLLER}.{n}": others[:, k]
            for k, n in enumerate(main.loop.other_names)
        },
        sampling_period=main.loop.controller.sample_time,
    )


def _safety(loop: CoupledPair) -> float:
    """Factor on the first estimate: 1 if the run is better than its co-run, else 2."""
    return 1.0 if loop.corrected and loop.averaged else 2.0


def _grid_contraction(coarse: Vector, half: Vector, quarter: Vector) -> float:
    """Ratio of the change from H/2 to H/4 to the change from H to H/2."""
    rows = min(len(coarse), len(half), len(quarter))
    scale = np.maximum(np.ptp(coarse[:rows], axis=0), 1e-12)
    first = float(np.max(np.abs(coarse[:rows] - half[:rows]) / scale))
    second = float(np.max(np.abs(half[:rows] - quarter[:rows]) / scale))
    return second / first if first > 1e-9 else 0.0

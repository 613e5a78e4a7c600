"""The master: move a plant and a controller through time together, and say what to believe."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .coupling import Answer, Coupling, Loop, StepReport
from .participant import Participant, StepFailed
from .reference_signal import Reference
from .verdict import ACCURACY, Verdict, judge
from .wiring import Wiring, wire

Vector = npt.NDArray[np.float64]
Progress = Callable[[float], None]

FINEST = 12  # adaptive steps go down to 2^-12 of the given one
LEAST_SHARE = 1e-3  # of the error that is allowed in all, to any one step
NEGLIGIBLE = 1e-7  # of the range: effects that add up to less are round-off
RUNAWAY = 1e4  # times an output's nominal value
UNBOUNDED = StepFailed("").advice


class CouplingError(ValueError):
    """The coupling asked for is impossible with these parts; the message says why."""


@dataclass(frozen=True)
class LoopRun:
    """A coupled run.

    Attributes
    ----------
    time : ndarray, shape (k,)
        Communication points [s].
    outputs : dict of str to ndarray, shape (k,)
        The plant's outputs, under the names they are mapped to.
    commands : dict of str to ndarray, shape (k,)
        The controller's commands, under the names of the plant's inputs.
    reference : ndarray, shape (k,)
    coupling : Coupling
    coupling_reason : str
        Why this coupling, where it was chosen by rule.
    corrected : bool
    defect_max : dict of str to float
        Largest interface defect of each command, in its unit.
    effect_rate_max : dict of str to float
        Largest effect of the defect on each output, per second; empty where nothing could be
        corrected.
    macro_steps : int
    step_range : tuple of two floats
        Shortest and longest communication step [s].
    verdict : Verdict
    stopped : str
        Why the run ended before its time; empty if it did not.
    """

    time: Vector
    outputs: dict[str, Vector]
    commands: dict[str, Vector]
    reference: Vector
    coupling: Coupling
    coupling_reason: str
    corrected: bool
    defect_max: dict[str, float]
    effect_rate_max: dict[str, float]
    macro_steps: int
    step_range: tuple[float, float]
    verdict: Verdict
    stopped: str = ""


@dataclass
class _Pair:
    """One loop with everything recorded along its way."""

    loop: Loop
    outputs: list[Vector] = field(default_factory=list)
    report: StepReport | None = None
    failure: str = ""


def run_loop(
    plant: Participant,
    controller: Participant,
    reference: Reference,
    stop: float,
    step: float,
    *,
    coupling: Coupling | None = None,
    corrections: int | None = None,
    adaptive: bool = False,
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    mapping: Mapping[str, str] | None = None,
    wiring: Wiring | None = None,
    progress: Progress | None = None,
) -> LoopRun:
    """Run a closed loop of two participants.

    Parameters
    ----------
    plant, controller : Participant
        Not initialized yet.
    reference : Reference
        For every input of the controller that the plant does not drive.
    stop, step : float
        End of the run and communication step [s]; for an adaptive run the longest step.
    coupling : Coupling, optional
        Default: tangent where the plant accepts a feedback law and derivatives of the controller
        are to be had, else gauss-seidel.
    corrections : {0, 1}, optional
        Default: 1 for tangent coupling where both sides can save their states, else 0.
    adaptive : bool
        Let the defect's effect choose the steps.
    mapping : mapping of str to str, optional
        Names of ports, ``theirs -> ours``.
    wiring : Wiring, optional
        Who is connected to whom. Default: ports of the same name, or as mapped; where it is given,
        `mapping` only names the results.
    progress : function, optional
        Called with the present time now and then.

    Returns
    -------
    LoopRun

    Raises
    ------
    CouplingError, WiringError
        If the parts cannot be coupled so.
    StepFailed
        If a part refuses its parameters or initial values.
    """
    wiring = wiring or wire(plant, controller, mapping)
    reversible = plant.can_save and controller.can_save
    ours = dict(mapping or {})
    names = [ours.get(n, n) for n in plant.outputs]
    commands = [ours.get(theirs, theirs) for _, theirs in wiring.commands]
    values = (dict(plant_values or {}), dict(controller_values or {}))

    def opened(fresh: bool, how: Coupling, corrected: bool, averaged: bool) -> Loop:
        p, c = (plant.reopened(), controller.reopened()) if fresh else (plant, controller)
        p.initialize(values[0], stop)
        c.initialize(values[1], stop)
        return Loop(p, c, wiring, how, corrected, averaged, start)

    start = np.full(len(wiring.references), reference.at(0.0))
    chosen, reason = _choose(wiring, plant, controller, coupling)
    if corrections is None:
        corrections = 1 if chosen is Coupling.TANGENT and reversible else 0
    if corrections and not reversible:
        raise CouplingError("corrections need both FMUs to save and restore their state")
    if adaptive and not reversible:
        raise CouplingError("adaptive steps need both FMUs to save and restore their state")
    tangent = chosen is Coupling.TANGENT
    main = _Pair(opened(False, chosen, bool(corrections), averaged=tangent or bool(corrections)))
    if coupling is None and tangent:
        reason = _tangent_reason(main.loop, wiring)
    step, reason = _meet_samples(main.loop, step, reason)
    companions = (
        [_Pair(opened(True, chosen, not corrections, averaged=not tangent))]
        if reversible
        else [_Pair(opened(True, chosen, False, tangent)) for _ in range(2)]
    )
    try:
        clock = _Clock(stop, step, adaptive)
        record = _march(main, companions, reversible, clock, reference, progress)
    finally:
        for companion in companions:
            companion.loop.plant.participant.close()
            companion.loop.controller.participant.close()
    return _concluded(record, main, companions, reversible, names, commands, chosen, reason, clock)


def _choose(
    wiring: Wiring, plant: Participant, controller: Participant, wanted: Coupling | None
) -> tuple[Coupling, str]:
    if wanted is Coupling.MONOLITHIC:
        raise CouplingError("the monolithic coupling runs no FMUs; see run_monolithic")
    if wanted is Coupling.TANGENT and not wiring.accepts_law:
        raise CouplingError(
            f"tangent coupling needs law ports on {plant.name} (u_gain_..., u_ref_..., u_rate) and "
            "there are none; use gauss-seidel"
        )
    if wanted is not None:
        return wanted, "as asked"
    if wiring.accepts_law:
        return Coupling.TANGENT, "both sides allow it"
    return Coupling.GAUSS_SEIDEL, f"{plant.name} has no law ports"


def _tangent_reason(loop: Loop, wiring: Wiring) -> str:
    side = loop.controller
    if side.answer is Answer.SAMPLED:
        return "the plant has law ports; the controller is sampled and holds by itself"
    if wiring.reports_law:
        return "the plant accepts the feedback law and the controller reports it"
    if side.answer is Answer.DIRECT or side.participant.can_save:
        return "the plant accepts the feedback law; the controller's derivatives are probed"
    return "the plant has law ports, but the controller's derivatives cannot be had: it is held"


def _meet_samples(loop: Loop, step: float, reason: str) -> tuple[float, str]:
    period = loop.controller.participant.sample_time
    if period <= 0:
        return step, reason
    met = step_that_meets(period, step)
    if abs(met - step) > 1e-9 * step:
        reason += f"; steps of {met:g} s meet its samples every {period:g} s"
    return met, reason


def step_that_meets(period: float, step: float) -> float:
    """The longest step [s], at most `step`, of which the sampling period is a multiple."""
    return period / max(1, math.ceil(period / step - 1e-9)) if period > 0 else step


class _Clock:
    """Communication points as multiples of one tick, so that time does not drift."""

    def __init__(self, stop: float, step: float, adaptive: bool) -> None:
        self.adaptive = adaptive
        self.tick = step / 2**FINEST if adaptive else step
        self.size = self.longest = 2**FINEST if adaptive else 1
        self.count = 0
        self.stop = stop
        self.last = max(1, math.ceil(stop / self.tick - 1e-9))
        self.shortest_used, self.longest_used = math.inf, 0.0

    def time(self, count: int) -> float:
        return min(count * self.tick, self.stop)

    @property
    def now(self) -> float:
        return self.time(self.count)

    @property
    def done(self) -> bool:
        return self.count >= self.last

    def next_count(self) -> int:
        return min(self.count + self.size, self.last)

    def step(self) -> float:
        """Length of the step to come: a multiple of the tick, but for a last, shorter one."""
        following = self.next_count()
        whole = (following - self.count) * self.tick
        return self.stop - self.now if following * self.tick > self.stop else whole

    def accept(self) -> None:
        step = self.step()
        self.shortest_used = min(self.shortest_used, step)
        self.longest_used = max(self.longest_used, step)
        self.count = self.next_count()

    def adapt(self, share: float) -> None:
        """Halve or double so that steps stay aligned with multiples of themselves."""
        if share > 1.0 and self.size > 1:
            self.size //= 2
        elif share < 0.1 and self.size < self.longest and self.count % (2 * self.size) == 0:
            self.size *= 2


@dataclass
class _Record:
    times: list[float]
    commands: list[Vector]
    references: list[float]
    defect: Vector
    effect_rate: Vector
    contraction_sum: float = 0.0
    contraction_weight: float = 0.0
    stopped: str = ""
    advice: str = UNBOUNDED

    def note_contraction(self, value: float, weight: float) -> None:
        if np.isfinite(value) and weight > 0:
            self.contraction_sum += value * weight
            self.contraction_weight += weight

    @property
    def contraction(self) -> float:
        if self.contraction_weight < NEGLIGIBLE:
            return 0.0
        return self.contraction_sum / self.contraction_weight


def _march(
    main: _Pair,
    companions: list[_Pair],
    reversible: bool,
    clock: _Clock,
    reference: Reference,
    progress: Progress | None,
) -> _Record:
    loop = main.loop
    plant = loop.plant.participant
    nominal = np.array([plant.nominal(name) for name in plant.outputs])
    width = len(loop.controller.wiring.references)
    for pair in (main, *companions):
        pair.outputs.append(pair.loop.outputs.copy())
    before = np.full(width, reference.at(0.0))
    record = _Record(
        [0.0],
        [loop.command(0.0, clock.step(), before)],
        [reference.at(0.0)],
        np.zeros(loop.plant.m),
        np.zeros(len(nominal)),
    )
    low, high = loop.outputs.copy(), loop.outputs.copy()
    apart_before = np.zeros(len(nominal))
    shown = 0.0
    while not clock.done:
        t, h, end = clock.now, clock.step(), clock.time(clock.next_count())
        after = np.full(width, reference.at(end))
        saved = _saved([main, *companions]) if clock.adaptive else []
        try:
            report = loop.step(t, h, before, after)
        except StepFailed as error:
            _drop(saved)
            record.stopped = f"{error} (in the step from t = {t:.6g} s)"
            record.advice = error.advice
            break
        _step_companions(companions, reversible, t, h, before, after)
        low, high = np.minimum(low, report.outputs), np.maximum(high, report.outputs)
        scale = np.maximum(high - low, 1e-2 * nominal)
        effect, contraction = _measured(report, companions, reversible)
        weight = float(np.max(effect / scale)) if len(effect) else 0.0
        if clock.adaptive:
            apart = _apart(companions, report.outputs)
            share = max(weight, float(np.max(np.abs(apart - apart_before) / scale)))
            share /= ACCURACY * max(h / clock.stop, LEAST_SHARE)
            if share > 1.0 and clock.size > 1:
                _take_back(saved)
                clock.adapt(share)
                continue
            _drop(saved)
        clock.accept()
        record.note_contraction(contraction, weight)
        before = after
        main.outputs.append(report.outputs)
        record.times.append(end)
        record.references.append(reference.at(end))
        record.defect = np.maximum(record.defect, np.abs(report.defect))
        record.effect_rate = np.maximum(record.effect_rate, effect / h)
        if clock.adaptive:
            apart_before = apart
            clock.adapt(share)
        try:
            following = h if clock.done else clock.step()
            record.commands.append(loop.command(end, following, after, last=clock.done))
        except StepFailed as error:
            record.stopped = f"{error} (at t = {end:.6g} s)"
            record.advice = error.advice
            for kept in (main.outputs, record.times, record.references):
                kept.pop()  # a row without its command is no row
            break
        if not np.isfinite(report.outputs).all():
            record.stopped = f"an output is not finite at t = {end:.6g} s"
            break
        if np.any(np.abs(report.outputs) > RUNAWAY * nominal):
            name = list(plant.outputs)[int(np.argmax(np.abs(report.outputs) / nominal))]
            record.stopped = f"the loop runs away: {name} leaves every bound at t = {end:.6g} s"
            break
        if progress and end - shown >= 0.01 * clock.stop:
            shown = end
            progress(end)
    return record


def _step_companions(
    companions: list[_Pair],
    reversible: bool,
    t: float,
    h: float,
    before: Vector,
    after: Vector,
) -> None:
    """Move the companions over the same step; in 2, 4, ... parts where nothing can be undone."""
    for k, pair in enumerate(companions):
        if pair.failure:
            continue
        parts = 1 if reversible else 2 ** (k + 1)
        try:
            for j in range(parts):
                pair.report = pair.loop.step(
                    t + j * h / parts,
                    h / parts,
                    before + (after - before) * j / parts,
                    before + (after - before) * (j + 1) / parts,
                )
            pair.outputs.append(pair.loop.outputs.copy())
        except StepFailed as error:
            pair.failure = f"the companion loop failed at t = {t:.6g} s: {error}"


def _apart(companions: list[_Pair], outputs: Vector) -> Vector:
    """How far the run and its companion are from each other."""
    pair = companions[0]
    return np.zeros_like(outputs) if pair.failure else outputs - pair.outputs[-1]


def _measured(
    report: StepReport, companions: list[_Pair], reversible: bool
) -> tuple[Vector, float]:
    """Effect and contraction of this step's correction, from whichever loop was corrected."""
    if np.isfinite(report.contraction):
        return report.effect, report.contraction
    other = companions[0].report
    if reversible and other is not None and not companions[0].failure:
        return other.effect, other.contraction
    return np.zeros_like(report.effect), math.nan


def _saved(pairs: Sequence[_Pair]) -> list[tuple[_Pair, Any, int]]:
    """Checkpoints of all loops that still run, and how much they had recorded."""
    return [(p, p.loop.checkpoint(), len(p.outputs)) for p in pairs if not p.failure]


def _take_back(saved: list[tuple[_Pair, Any, int]]) -> None:
    for pair, checkpoint, recorded in saved:
        pair.loop.take_back(checkpoint)
        del pair.outputs[recorded:]
        pair.failure = ""


def _drop(saved: list[tuple[_Pair, Any, int]]) -> None:
    for pair, checkpoint, _ in saved:
        pair.loop.drop(checkpoint)


def _concluded(
    record: _Record,
    main: _Pair,
    companions: list[_Pair],
    reversible: bool,
    names: list[str],
    ours: list[str],
    coupling: Coupling,
    reason: str,
    clock: _Clock,
) -> LoopRun:
    outputs = np.array(main.outputs)
    others = [np.array(pair.outputs) for pair in companions]
    contraction = record.contraction
    if not reversible:
        contraction = _grid_contraction(outputs, *others)
    failure = record.stopped or next((p.failure for p in companions if p.failure), "")
    verdict = judge(
        names,
        outputs,
        others[0],
        contraction,
        clock.longest_used,
        safety=1.0 if main.loop.corrected and main.loop.averaged else 2.0,
        failure=failure,
        advice=record.advice,
    )
    commands = np.array(record.commands)
    return LoopRun(
        time=np.array(record.times),
        outputs={n: outputs[:, k] for k, n in enumerate(names)},
        commands={n: commands[:, k] for k, n in enumerate(ours)},
        reference=np.array(record.references),
        coupling=coupling,
        coupling_reason=reason,
        corrected=main.loop.corrected,
        defect_max=dict(zip(ours, record.defect.tolist(), strict=True)),
        effect_rate_max=(
            dict(zip(names, record.effect_rate.tolist(), strict=True)) if reversible else {}
        ),
        macro_steps=len(record.times) - 1,
        step_range=(clock.shortest_used, clock.longest_used),
        verdict=verdict,
        stopped=record.stopped,
    )


def _grid_contraction(coarse: Vector, half: Vector, quarter: Vector) -> float:
    """How much smaller the change from H/2 to H/4 is than that from H to H/2."""
    rows = min(len(coarse), len(half), len(quarter))
    scale = np.maximum(np.ptp(coarse[:rows], axis=0), 1e-12)
    first = float(np.max(np.abs(coarse[:rows] - half[:rows]) / scale))
    second = float(np.max(np.abs(half[:rows] - quarter[:rows]) / scale))
    return second / first if first > 1e-9 else 0.0

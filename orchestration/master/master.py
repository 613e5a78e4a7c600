"""The master: simulate a plant and a controller together, and judge the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..fmu.limits import check_memory
from ..fmu.wiring import CONTROLLER, PLANT, names_on
from .algebraic_loop import with_ring_named
from .coupling import Answer, CoupledPair
from .march import Clock, LoopRun, Progress, Record, Stop, march_on
from .second_look import Setting, with_second_look
from .sides import Sides, step_that_meets
from .verdict import ACCURACY, Verdict, scales, verdict_of

Vector = npt.NDArray[np.float64]


def run_loop(
    sides: Sides,
    step: float,
    *,
    progress: Progress | None = None,
    look_again: bool | Callable[[LoopRun], bool] = True,
) -> LoopRun:
    """Run a closed loop of two FMU instances.

    Parameters
    ----------
    sides : Sides
    step : float
        Communication step [s]; for an adaptive run the longest step.
    progress : function, optional
        Called repeatedly with the present time.
    look_again : bool or function of the run
        Whether an unclear verdict is checked by runs with finer steps.

    Returns
    -------
    LoopRun

    Raises
    ------
    StepFailed
        If a part rejects its parameters or initial values.
    UserError
        If the rows of all steps do not fit.
    """
    plant, controller, wiring = sides.plant, sides.controller, sides.wiring
    main = sides.main()
    step, reason = _meet_samples(main, step, sides.reason_of(main))
    varies = all(getattr(side, "steps_vary", True) for side in (plant, controller))
    breaks = sides.reference.jumps(wiring.orders) if varies else np.zeros(0)
    curved = sides.reference.bends_within(step, sides.stop, wiring.orders, breaks)
    co_runs = sides.co_runs(main, curved or wiring.network)
    _check_room(main, len(co_runs), sides.stop / step)
    record = Record(main, sides.reference, wiring.orders)
    clock = Clock(sides.stop, step, sides.adaptive, breaks)
    try:
        why = march_on([main, *co_runs], clock, record, progress)
    finally:
        for co_run in co_runs:
            co_run.close()
    first = _concluded(sides, [main, *co_runs], record, clock, why)
    first = replace(first, coupling_reason=reason)
    if wiring.is_empty and first.verdict.trusted:
        own = (
            f"there is no coupling; this run does not check how accurate {plant.name}'s own "
            "solver is"
        )
        return replace(first, verdict=replace(first.verdict, reason=own))
    ended = why.reason or any(pair.failure for pair in co_runs)
    asked = look_again if isinstance(look_again, bool) else look_again(first)
    if asked and not sides.adaptive and not ended:
        # in a network the reverse order may be wrong where the run is right
        judges = co_runs[-1:] if wiring.network else co_runs[:1]
        judges = judges if sides.reversible else co_runs
        setting = Setting(sides, step, breaks, progress)
        first = with_second_look(first, main, judges, setting)
    return with_ring_named(first, main, sides, step)


def _meet_samples(main: CoupledPair, step: float, reason: str) -> tuple[float, str]:
    period = main.controller.sample_time
    met = step_that_meets(period, step)
    if abs(met - step) > 1e-9 * step:
        reason += f"; steps of {met:g} s meet its samples every {period:g} s"
    return met, reason


def _check_room(main: CoupledPair, co_runs: int, steps: float) -> None:
    """Refuse a run whose rows do not fit into memory.

    Each row exists twice while the chunks are joined; the verdict and the pictures need some more
    columns.
    """
    outputs, others = len(main.outputs), len(main.given) + len(main.other_names)
    rows = 2 * (outputs * (1 + co_runs) + others + 2) + 3 * outputs
    check_memory(
        8.0 * rows * steps,
        f"{steps:.3g} communication steps need",
        "use a longer --step or a shorter --stop",
    )


def _concluded(
    sides: Sides, pairs: Sequence[CoupledPair], record: Record, clock: Clock, why: Stop
) -> LoopRun:
    """The run of the first of the pairs, with the verdict that the others give it."""
    main, network = pairs[0], sides.wiring.network
    called = names_on(PLANT, [*sides.plant.outputs, *sides.plant.inputs], sides.mapping)
    names = [called[n] for n in sides.plant.outputs]
    ours = [called[theirs] for _, theirs in sides.wiring.commands]
    judged = [*names, *(main.other_names if network else ())]
    commands = np.concatenate(record.commands)
    outputs, others = np.split(np.concatenate(main.rows), [len(names)], axis=1)
    effects = dict(zip(names, record.effect_rate.tolist(), strict=True))
    return LoopRun(
        time=np.concatenate(record.times),
        outputs={n: outputs[:, k] for k, n in enumerate(names)},
        commands={n: commands[:, k] for k, n in enumerate(ours)},
        reference=np.concatenate(record.references),
        coupling=sides.scheme,
        coupling_reason="",
        corrected=main.corrected,
        residual_max=dict(zip(ours, record.residual.tolist(), strict=True)),
        effect_rate_max=effects if sides.reversible else {},
        macro_steps=len(commands) - 1,
        step_range=clock.used,
        verdict=_first_verdict(
            sides,
            pairs,
            judged,
            record.contraction,
            why,
            _advice(sides, main, commands, ours, clock),
        ),
        stopped=why.reason,
        diverged=why.diverged,
        others={
            n if network else f"{CONTROLLER}.{n}": others[:, k]
            for k, n in enumerate(main.other_names)
        },
        sampling_period=main.controller.sample_time,
    )


def _first_verdict(
    sides: Sides,
    pairs: Sequence[CoupledPair],
    names: list[str],
    contraction: float,
    why: Stop,
    smaller: str,
) -> Verdict:
    """From the co-runs that accompany the run; `smaller` says what to do about its step."""
    run, *others = (np.concatenate(pair.rows)[:, : len(names)] for pair in pairs)
    if not sides.reversible:
        contraction, others = _grid_contraction(run, *others), others[:1]
    failure = why.reason or next((p.failure for p in pairs[1:] if p.failure), "")
    safety = pairs[0].safety
    return verdict_of(names, run, others, contraction, smaller, safety, failure, why.advice)


def _advice(
    sides: Sides, main: CoupledPair, commands: Vector, names: list[str], clock: Clock
) -> str:
    """What to do about a residual that is too large.

    With jacobi, its first step may hold a start value far from the first command.
    """
    smaller = "use a smaller --step"
    if not sides.scheme.law:
        smaller += ", or --coupling interface-jacobian if both sides support it"
    smaller += f"; this run used steps of {clock.used[1]:g} s"
    if not sides.scheme.late or main.answer is not Answer.STEPPED or not names:
        return smaller
    off = np.abs(commands[0] - main.given) / scales(commands)
    worst = int(np.argmax(off))
    if not off[worst] > ACCURACY:
        return smaller
    return (
        f"{names[worst]} starts at {main.given[worst]:.4g} and is {commands[0, worst]:.4g} after "
        "the first step of the controller, which jacobi does not use: give it that "
        "start value, or use --coupling gauss-seidel"
    )


def _grid_contraction(coarse: Vector, half: Vector, quarter: Vector) -> float:
    """Ratio of the change from H/2 to H/4 to the change from H to H/2."""
    rows = min(len(coarse), len(half), len(quarter))
    scale = np.maximum(np.ptp(coarse[:rows], axis=0), 1e-12)
    first = float(np.max(np.abs(coarse[:rows] - half[:rows]) / scale))
    second = float(np.max(np.abs(half[:rows] - quarter[:rows]) / scale))
    return second / first if first > 1e-9 else 0.0

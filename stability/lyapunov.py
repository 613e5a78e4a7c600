"""Lyapunov exponents of a model or a closed loop, with a verdict and its evidence."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..orchestration.fmu.limits import TOLERANCE
from ..orchestration.loop.loop import Loop
from ..orchestration.loop.whole_loop import loop_kernel, stored_loop, whole_loop
from ..solver.arrays import Vector
from ..solver.core import REACHED, System
from ..solver.files import write_atomically, write_json
from ..solver.for_tangents import NODES
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..solver.spectrum import Spectrum, follow_returns, follow_tangents
from .attractor import Attractor, Kind, agree, bars, ended
from .classify import RESOLVED, classify_attractor
from .equilibria import sample_after

if TYPE_CHECKING:
    from ..solver.component import Component

Maker = Callable[[float], Model]
"""Makes the same model, at its start, with a relative tolerance."""

TIGHTER = 0.1
JUDGED = 100.0  # times the tolerance are sufficient for the long-term motion
COARSEST = 1e-6
SAMPLES = 400
TOLD = 0.5  # seconds between two reports of the progress
BRIEF, PARTS = 20_000, 50  # samples of a motion without exponents; checks of the time
MORE_TIME = "more time for computing (--budget), a shorter --stop, or a coarser --tolerance"
ONE_SOLVER = "one solver"
AVERAGED = (
    "one solver; exponents of the quantizers' average with dither, verdict of the exact quantizers"
)
BITS = 1.0 / math.log(2.0)  # per nat
DIGITS = 52  # bits of a number: less is left of a direction that vanishes within a sample
FIRST = ("x", "v")  # states of the axis that come first in the frame, as in the thesis


@dataclass(frozen=True)
class LyapunovRun:
    """Exponents of one motion.

    Attributes
    ----------
    names : list of str
        The states.
    spectrum : Spectrum
        Motion and tangents at the given tolerance.
    tighter : Spectrum or None
        The same at a tenth of it; None if the computing time was not sufficient.
    motion : Attractor
        The long-term motion.
    tolerance : float
    label : str
    method : str
        Method for the tangents.
    loop : Loop, optional
        The loop of this motion.
    sample_time : float
        Of a sampled loop [s], else 0.
    """

    names: list[str]
    spectrum: Spectrum
    tighter: Spectrum | None
    motion: Attractor
    tolerance: float
    label: str = ""
    method: str = ONE_SOLVER
    loop: Loop | None = None
    sample_time: float = 0.0

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the last time reached, largest first [nats/s].

        Minus infinity for a direction that vanishes at once: within a sample, or at an event.
        """
        return np.sort(self.spectrum.exponents)[::-1]

    @property
    def error(self) -> Vector:
        """A bound of the error of each of them [nats/s], see `bars`; NaN: not known.

        Three times the change at a tenth of the tolerance, and at least 1e-5 of the exponent.
        """
        if self.tighter is None:
            return np.full(len(self.exponents), np.nan)
        return bars(self.exponents, np.sort(self.tighter.exponents)[::-1])

    @property
    def decided(self) -> bool:
        return self.motion.kind is not Kind.UNDECIDED

    @property
    def lowest(self) -> float | None:
        """Exponents that are minus infinity are below this one [nats/s]; None without samples."""
        return -DIGITS / (BITS * self.sample_time) if self.sample_time else None

    def shown(self, nats: float) -> str:
        """An exponent or a limit in bits/s; below a number if it is minus infinity, see `note`."""
        if nats != -np.inf:
            return f"{nats * BITS:.6g}"
        return "at once" if self.lowest is None else f"below {self.lowest * BITS:.3g}"

    @property
    def note(self) -> str:
        """What minus infinity means here; empty if no exponent or limit is minus infinity."""
        limits = [] if self.motion.limit is None else self.motion.limit.tolist()
        if not np.isneginf([*self.exponents, *limits]).any():
            return ""
        where = "within one sample" if self.sample_time else "at an event, such as sticking"
        return f"{self.shown(-np.inf)}: a direction that is contracted {where}"

    def sum_rule_error(self) -> float | None:
        """Difference of the exponents' sum and the mean trace, relative to the larger of both.

        None if not all exponents were computed, one is minus infinity, or the trace is not known.
        """
        growth, trace = self.spectrum.growth[-1], float(self.spectrum.trace[-1])
        all_known = np.isfinite([*growth, trace]).all() and len(growth) == len(self.names)
        if len(self.spectrum.time) < 2 or not all_known:
            return None
        total = float(growth.sum())
        largest = max(abs(total), abs(trace))
        return abs(total - trace) / largest if largest > 0.0 else 0.0

    def figures(self) -> dict[str, Any]:
        """Content of ``lyapunov.json``, where minus infinity becomes null."""
        run, motion = self.spectrum, self.motion
        span = float(run.time[-1] - run.time[0])
        rest = motion.equilibrium

        def bits(values: Vector | None) -> list[float] | None:
            return None if values is None else (values * BITS).tolist()

        return {
            "label": self.label,
            "states": self.names,
            "time_s": float(run.time[-1]),
            "exponents_bits_per_s": bits(self.exponents),
            "exponents_nats_per_s": self.exponents.tolist(),
            "exponents_error_bits_per_s": bits(self.error),
            "contracted_at_once": int(np.isneginf(self.exponents).sum()),
            "contracted_below_bits_per_s": self.lowest and self.lowest * BITS,
            "asymptotic_bits_per_s": bits(motion.limit),
            "asymptotic_error_bits_per_s": bits(motion.limit_error),
            "mean_trace_bits_per_s": float(run.trace[-1]) / span * BITS if span > 0 else None,
            "sum_rule_error": self.sum_rule_error(),
            "lambda1_times_t_bits": float(run.growth[-1].max()) * BITS,
            "verdict": motion.kind.value,
            "evidence": motion.evidence,
            "would_decide": motion.would_decide,
            "neutral_directions": rest and rest.neutral,
            "rest": rest and dict(zip(self.names, rest.state.tolist(), strict=True)),
            "period_s": motion.period,
            "amplitude": motion.amplitude,
            "return_error": motion.return_error,
            "diverges_at_s": motion.since,
            "tolerance": self.tolerance,
            "method": self.method,
            "events": run.events,
        }

    def estimates_csv(self) -> str:
        """The running estimates, in bits/s, on the grid of times."""
        stream = io.StringIO()
        count = self.spectrum.growth.shape[1]
        header = ["time", *(f"lambda{k + 1}_bits_per_s" for k in range(count)), "trace_bits_per_s"]
        stream.write(",".join(header) + "\n")
        for t, rates, trace in zip(*self.running(), strict=True):
            row = [t, *rates * BITS, trace * BITS]
            stream.write(",".join(f"{value:.12g}" for value in row) + "\n")
        return stream.getvalue()

    def running(self) -> tuple[Vector, npt.NDArray[np.float64], Vector]:
        """Times, estimates in the order of the tangents, mean trace [nats/s]; without the start."""
        run = self.spectrum
        span = (run.time - run.time[0])[1:]
        return run.time[1:], run.growth[1:] / span[:, None], run.trace[1:] / span

    def save(self, folder: Path | str) -> None:
        """Write lyapunov.json and lyapunov.csv."""
        folder = Path(folder)
        write_atomically(folder / "lyapunov.csv", self.estimates_csv().encode())
        write_json(folder / "lyapunov.json", self.figures())


class Watching:
    """Reports the progress of a computation, and ends it when its processor time is used up [s]."""

    def __init__(
        self, progress: Callable[[str], None] | None = None, budget: float | None = None
    ) -> None:
        self.budget, self.progress = budget, progress
        self.end = math.inf if budget is None else time.process_time() + budget
        self.doing, self.shown_at = "", 0.0
        self.over = False

    def says(self, model: Model, doing: str) -> None:
        """Report the next step of the work, which uses this model."""
        self.doing, model.watch = doing, self
        if self.progress:
            self.progress(doing)

    def __call__(self, reached: float, growth: Vector | None) -> bool:
        self.over = time.process_time() >= self.end
        now = time.monotonic()
        if self.progress and growth is not None and reached > 0.0 and now >= self.shown_at + TOLD:
            self.shown_at = now
            so_far = np.sort(growth / reached * BITS)[:-4:-1]
            values = ", ".join(f"{value:.4g}" for value in so_far)
            self.progress(f"{self.doing}: t = {reached:.4g} s, first exponents {values} bits/s")
        return self.over


def lyapunov(
    make: Maker,
    stop: float,
    tolerance: float = TOLERANCE,
    count: int | None = None,
    order: Sequence[int] | None = None,
    label: str = "",
    watching: Watching | None = None,
    average: Maker | None = None,
) -> LyapunovRun:
    """Exponents of a model's motion from its start, and its long-term motion.

    Everything is computed at `tolerance` and at a tenth of it. A verdict that differs between the
    two is undecided.

    Parameters
    ----------
    make : function of a relative tolerance, returning a Model
    stop : float
        [s]
    count : int, optional
        Number of exponents, the largest ones; all if left out.
    order : sequence of int, optional
        Order of the states in the first frame; their own if left out.
    watching : Watching, optional
        When its time is used up, the exponents are those of the time that was reached, and the
        verdict is from the motion alone, as in maps; this gets half as much time.
    average : Maker, optional
        Of a quantized model: its dithered average. The exponents are the average's. The long-term
        motion is computed with the exact quantizers.

    Raises
    ------
    ValueError
        For an invalid time or tolerance.
    """
    if not (stop > 0.0 and math.isfinite(stop)):
        raise ValueError(f"the stop time is {stop} s, expected more than 0")
    if not 1e-13 <= tolerance <= 1e-3:
        raise ValueError(f"the tolerance is {tolerance:g}, expected 1e-13 to 1e-3")
    runs: list[Spectrum] = []
    motions: list[Attractor] = []
    watch = watching or Watching()
    for share in (1.0, TIGHTER):
        maker = average or make
        model = maker(tolerance * share)
        n = len(model.x)
        watch.says(model, f"exponents over {stop:g} s at tolerance {tolerance * share:g}")
        frame = np.eye(n)[list(order) if order is not None else range(n)][: count or n]
        run = follow_tangents(model, np.linspace(0.0, stop, SAMPLES + 1), len(frame), frame)
        if watch.over:
            runs = runs or [run]
            break
        if run.failure and len(run.time) == 1:  # it ends before the first time of the grid
            grid = np.linspace(0.0, model.info[REACHED], SAMPLES + 1)
            model = maker(tolerance * share)
            run = follow_tangents(model, grid, len(frame), frame)
        runs.append(run)
        if run.failure:
            motions.append(ended(run.failure, run.diverged, float(model.info[REACHED])))
            continue
        onward = make(COARSEST * share if average else min(tolerance * JUDGED * share, COARSEST))
        if average:  # it is judged by the motion alone, as a cell of a map
            follow_returns(onward, 0.0, stop, 0, np.inf, 0)
        else:
            onward.x[:], onward.u[:] = model.x, model.u
        watch.says(onward, f"the long-term motion after {stop:g} s")
        apart = np.abs(run.states - run.states[-1]) / model.kernel.nominal
        resolved = np.flatnonzero(apart.max(axis=1) > RESOLVED * onward.tolerance)
        earlier = run.states[resolved[-1]] if len(resolved) else None
        motions.append(
            classify_attractor(onward, stop, stop, exponents=average is None, earlier=earlier)
        )
        if watch.over:
            break
    motion = _by_motion(make, stop, runs[0], watch) if watch.over else agree(*motions)
    return LyapunovRun(
        [s.name for s in model.kernel.states],
        runs[0],
        runs[1] if len(runs) > 1 else None,
        motion,
        tolerance,
        label,
        AVERAGED if average else ONE_SOLVER,
        sample_time=model.sample_time,
    )


def _by_motion(make: Maker, stop: float, run: Spectrum, watch: Watching) -> Attractor:
    """The verdict from the motion alone, at two tolerances, if exponents take too long."""
    assert watch.budget is not None
    spent = f"the exponents were computed until t = {run.time[-1]:.4g} s of {stop:g} s, when "
    spent += f"{watch.budget:g} s of computing time were used up"
    more = Watching(watch.progress, 0.5 * watch.budget)
    motions: list[Attractor] = []
    for share in (1.0, TIGHTER):
        model = make(COARSEST * share)
        more.says(model, "the long-term motion, without exponents")
        # sampled motions are slow to compute: a part of the run is sufficient, as in a map
        length = min(stop, BRIEF * model.sample_time) if model.sample_time else stop
        for now, then in pairwise(np.linspace(0.0, length, PARTS + 1).tolist()):
            passes = follow_returns(model, now, then, 0, np.inf, 0)
            if passes.failure:
                break
        if passes.diverged:
            motions.append(ended(passes.failure, True, passes.end))
        elif passes.failure or more.over:
            return Attractor(Kind.UNDECIDED, spent, MORE_TIME)
        else:
            start = sample_after(model, length)
            motions.append(classify_attractor(model, start, length, exponents=False, brief=True))
    motion = agree(*motions)
    would = MORE_TIME if motion.kind is Kind.UNDECIDED else motion.would_decide
    text = f"{spent}; from the motion alone: {motion.evidence}"
    return replace(motion, evidence=text, would_decide=would)


def held_loop_kernel(
    plant: str | Component, controller: str | Component, averaged: bool = False
) -> Kernel:
    """As `loop_kernel`, with discrete states and delayed signals among the states.

    See `with_held_states`, `with_delay_states`, and for `averaged` quantizers `dithered_average`;
    `ContractError` for a loop that has both.
    """
    kernel = loop_kernel(plant, controller)
    averaged = averaged and bool(kernel.quantized)
    if not (kernel.discrete or kernel.delays or averaged):
        return kernel

    def make() -> Component:
        from ..solver.for_tangents import dithered_average, with_delay_states, with_held_states

        loop = whole_loop(plant, controller)
        loop = dithered_average(loop) if averaged else loop
        if loop.delays:
            return with_delay_states(loop)
        return with_held_states(loop) if loop.discrete else loop

    kind = f"{'averaged' if averaged else 'held'}_loop"
    return stored_loop(kind, make, (plant, controller), __name__)


def model_of(kernel: Kernel, loop: Loop, tolerance: float, system: System | None = None) -> Model:
    """A loop's equations around its constant set-point; `system`, if given, is used again."""
    model = Model(kernel, loop.values, tolerance, system)
    for i in kernel.inputs:
        if i.role == "reference":
            model.set_input(i.name, loop.set_point)
    return model


def loop_maker(loop: Loop, averaged: bool = False) -> Maker:
    """A `Maker` of a closed loop around its constant set-point.

    With `averaged`, quantizers are replaced by their mean over all positions of their steps.
    KeyError for a parameter that does not exist.
    """
    kernel = held_loop_kernel(loop.plant.name, loop.controller.name, averaged)
    kernel.compile()  # takes half a second, less than two tolerances and the long-term motion
    return lambda tolerance: model_of(kernel, loop, tolerance)


def loop_order(kernel: Kernel) -> list[int]:
    """The thesis' order of states: x, v, the friction law's, the current, the controller's."""
    names = [s.name for s in kernel.states]

    def place(k: int) -> tuple[int, int]:
        name = names[k]
        if name.startswith(CONTROLLER):
            return 3, k
        own = name.removeprefix(PLANT)
        if own in FIRST:
            return 0, FIRST.index(own)
        return (2 if own == "i" else 1), k  # the current

    return sorted(range(len(names)), key=place)


def loop_lyapunov(
    loop: Loop, tolerance: float = TOLERANCE, watching: Watching | None = None
) -> LyapunovRun:
    """Exponents of a closed loop; `tolerance` and `watching` as in `lyapunov`.

    Raises
    ------
    UserError, KeyError, ValueError
    """
    parts = loop.plant.name, loop.controller.name
    kernel = held_loop_kernel(*parts)
    make = loop_maker(loop)
    average = loop_maker(loop, averaged=True) if kernel.quantized else None
    order = loop_order(kernel)
    run = lyapunov(make, loop.stop, tolerance, None, order, loop.title, watching, average)
    if loop_kernel(*parts).delays:
        text = f"{run.method}; {NODES} nodes along each delay, whose own exponents are last"
        run = replace(run, method=text)
    return replace(run, loop=loop)

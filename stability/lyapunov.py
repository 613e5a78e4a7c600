"""Lyapunov exponents of a closed loop, with a verdict and its evidence."""

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
from ..solver.core import REACHED
from ..solver.files import write_atomically, write_json
from ..solver.kernel import Model
from ..solver.spectrum import Spectrum, follow_returns, follow_tangents
from .attractor import CLOSED, RESOLVED, Attractor, Kind, classify_attractor
from .budget import becomes
from .equilibria import sample_after

if TYPE_CHECKING:
    from ..orchestration.loop.loop import Loop

Vector = npt.NDArray[np.float64]
Maker = Callable[[float], Model]


"""Makes the same model, at its start, with a relative tolerance."""


TIGHTER = 0.1
JUDGED = 100.0  # times the tolerance are sufficient for the long-term motion
COARSEST = 1e-6
SAMPLES = 400
TOLD = 0.5  # seconds between two reports of the progress
BRIEF, PARTS = 20_000, 50  # samples of a motion without exponents; checks of the time
MORE_TIME = "more time for computing (--budget), a shorter --stop, or a coarser --tolerance"
WIDER, LEAST = 3.0, 1e-5  # times a change, and share of an exponent, in half of a 95 % interval
SAME = 1e-2  # relative difference up to which periods and amplitudes are the same
ONE_SOLVER = "one solver"
AVERAGED = (
    "one solver; exponents of the quantizers' average with dither, verdict of the exact quantizers"
)
_BITS = 1.0 / math.log(2.0)
FIRST = ("x", "v")  # states of the axis that come first in the frame, as in the thesis
LAST = ("i",)


def bars(estimates: Vector, others: Vector, least: float = LEAST) -> Vector:
    """Half of 95 % intervals of estimates from those of a second run; zero for minus infinity.

    A tenth of the tolerance does not always lower an error to a tenth: of 420 finite-time exponents
    of iol, nctf and pid 38 % are within the plain change of those at 1e-13, all within these bars.
    """
    with np.errstate(invalid="ignore"):
        found = np.maximum(WIDER * np.abs(estimates - others), least * np.abs(others))
    return np.where(np.isfinite(found), found, 0.0)


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
    motion : Motion
        The long-term motion.
    tolerance : float
    label : str
    method : str
        Method for the tangents.
    loop : Loop, optional
        The loop of this motion.
    """

    names: list[str]
    spectrum: Spectrum
    tighter: Spectrum | None
    motion: Attractor
    tolerance: float
    label: str = ""
    method: str = ONE_SOLVER
    loop: Loop | None = None

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the last time reached, largest first [nats/s]."""
        return np.sort(self.spectrum.exponents)[::-1]

    @property
    def error(self) -> Vector:
        """Half of a 95 % interval for each of them [nats/s]; NaN: not known.

        Three times the change at a tenth of the tolerance, and at least 1e-5 of the exponent.
        """
        if self.tighter is None:
            return np.full(len(self.exponents), np.nan)
        return bars(self.exponents, np.sort(self.tighter.exponents)[::-1])

    @property
    def decided(self) -> bool:
        return self.motion.kind is not Kind.UNDECIDED

    def sum_rule_error(self) -> float | None:
        """Difference of the exponents' sum and the mean trace, relative to the larger of both.

        None if not all exponents were computed, one is minus infinity, or the trace is not known.
        """
        growth, trace = self.spectrum.growth[-1], float(self.spectrum.trace[-1])
        if (
            len(self.spectrum.time) < 2
            or len(growth) < len(self.names)
            or not np.isfinite([*growth, trace]).all()
        ):
            return None
        total = float(growth.sum())
        largest = max(abs(total), abs(trace))
        return abs(total - trace) / largest if largest > 0.0 else 0.0

    def figures(self) -> dict[str, Any]:
        """Content of ``lyapunov.json``."""
        run, motion = self.spectrum, self.motion
        span = float(run.time[-1] - run.time[0])
        exponents = self.exponents
        limit = motion.limit
        return {
            "label": self.label,
            "states": self.names,
            "time_s": float(run.time[-1]),
            "exponents_bits_per_s": (exponents * _BITS).tolist(),
            "exponents_nats_per_s": exponents.tolist(),
            "exponents_error_bits_per_s": (self.error * _BITS).tolist(),
            "asymptotic_bits_per_s": None if limit is None else (limit * _BITS).tolist(),
            "asymptotic_error_bits_per_s": None
            if motion.limit_error is None
            else (motion.limit_error * _BITS).tolist(),
            "mean_trace_bits_per_s": float(run.trace[-1]) / span * _BITS if span > 0 else None,
            "sum_rule_error": self.sum_rule_error(),
            "lambda1_times_t_bits": float(run.growth[-1].max()) * _BITS,
            "verdict": motion.kind.value,
            "evidence": motion.evidence,
            "would_decide": motion.would_decide,
            "neutral_directions": None
            if motion.equilibrium is None
            else motion.equilibrium.neutral,
            "rest": None
            if motion.equilibrium is None
            else dict(zip(self.names, motion.equilibrium.state.tolist(), strict=True)),
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
            row = [t, *rates * _BITS, trace * _BITS]
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
    """Reports the progress of a computation, and ends it when its time is used up.

    Parameters
    ----------
    progress : function of a text, optional
        Called with the current step of the work.
    budget : float, optional
        Processor time [s]; no limit if left out.
    """

    def __init__(
        self, progress: Callable[[str], None] | None = None, budget: float | None = None
    ) -> None:
        self.budget, self.progress = budget, progress
        self.end = math.inf if budget is None else time.process_time() + budget
        self.doing, self.told = "", 0.0
        self.over = False

    def says(self, model: Model, doing: str) -> None:
        """Report the next step of the work, which uses this model."""
        self.doing, model.watch = doing, self
        if self.progress:
            self.progress(doing)

    def __call__(self, reached: float, growth: Vector | None) -> bool:
        self.over = time.process_time() >= self.end
        now = time.monotonic()
        if self.progress and growth is not None and reached > 0.0 and now >= self.told + TOLD:
            self.told = now
            so_far = np.sort(growth / reached * _BITS)[:-4:-1]
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
            motions.append(_ended(run, model))
            continue
        onward = make(min(tolerance * JUDGED * share, COARSEST))
        if average:
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
    motion = _by_motion(make, stop, runs[0], watch) if watch.over else agree(motions[0], motions[1])
    return LyapunovRun(
        [s.name for s in model.kernel.states],
        runs[0],
        runs[1] if len(runs) > 1 else None,
        motion,
        tolerance,
        label,
        AVERAGED if average else ONE_SOLVER,
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
        brief = min(stop, BRIEF * model.sample_time) if model.sample_time else stop
        for now, then in pairwise(np.linspace(0.0, brief, PARTS + 1).tolist()):
            passes = follow_returns(model, now, then, 0, np.inf, 0)
            if passes.failure:
                break
        if passes.diverged:
            motions.append(Attractor(Kind.DIVERGES, passes.failure, since=passes.end))
        elif passes.failure or more.over:
            return Attractor(Kind.UNDECIDED, spent, MORE_TIME)
        else:
            motions.append(becomes(model, sample_after(model, brief), brief))
    motion = agree(motions[0], motions[1])
    would = MORE_TIME if motion.kind is Kind.UNDECIDED else motion.would_decide
    text = f"{spent}; from the motion alone: {motion.evidence}"
    return replace(motion, evidence=text, would_decide=would)


def _ended(run: Spectrum, model: Model) -> Attractor:
    """The verdict on a motion that could not be followed to its end."""
    if run.diverged:
        return Attractor(Kind.DIVERGES, run.failure, since=float(model.info[REACHED]))
    return Attractor(Kind.UNDECIDED, run.failure, "a solver that can continue beyond this point")


def agree(first: Attractor, second: Attractor) -> Attractor:
    """The second verdict, at a tenth of the tolerance, if the first one agrees; else undecided."""
    same = first.kind is second.kind
    text = f"{first.kind.value} ({first.evidence}) against {second.kind.value}"
    if same and first.period and second.period:
        shorter, longer = sorted((first.period, second.period))
        periods = longer / shorter  # a cycle also closes after several periods
        swings = [
            abs(second.amplitude[n] - a) / max(a, abs(second.amplitude[n]))
            for n, a in first.amplitude.items()
            if a > 0.0
        ]
        whole = abs(periods - round(periods)) <= SAME * periods
        allowed = SAME if round(periods) == 1 else CLOSED  # subharmonics begin small
        same = whole and max(swings, default=0.0) <= allowed
        text = f"periods of {first.period:.6g} and {second.period:.6g} s, or their amplitudes"
        second = replace(second, period=shorter) if same and round(periods) > 1 else second
    if not same:
        return Attractor(
            Kind.UNDECIDED,
            f"a tenth of the tolerance changes the verdict: {text}",
            "tighter ones, until two in succession agree",
        )
    if first.limit is None or second.limit is None or second.limit_error is None:
        return second
    error = np.maximum(second.limit_error, bars(first.limit, second.limit, 0.0))
    if second.kind is Kind.CHAOS:  # two orbits of one attractor have random differences
        error = second.limit_error
    return Attractor(**{**vars(second), "limit_error": error})

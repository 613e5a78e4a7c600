"""Lyapunov exponents of a closed loop of two FMUs, by name or by file, and its verdict."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..fmus.ports import tangent_states
from ..orchestration.fmu.fmu_instance import FmuInstance
from ..orchestration.fmu.isolated import IsolatedInstance, open_fmu
from ..orchestration.fmu.trials import check_state
from ..orchestration.fmu.wiring import PLANT, names_on, with_aliases
from ..orchestration.loop.catalogue import (
    catalogued_model,
    fmu_kernel,
    kept_fmu,
    stored_fmu,
    way_of_making,
)
from ..orchestration.loop.loop import Loop
from ..orchestration.loop.parts import Part
from ..solver.arrays import Vector
from ..solver.compilers import CompilerFailed, compiler_for, own_platform
from ..solver.errors import FmuError, UserError
from ..solver.spectrum import Spectrum
from .attractor import Attractor, Kind
from .cycles import closings
from .lyapunov import SAMPLES, LyapunovRun, Watching, held_loop_kernel, loop_lyapunov
from .tangent_sides import ordinary
from .tangents_over_fmus import ACCURACY, TangentRun, follow_over_fmus

NATIVE, READABLE = "native", "readable"
_Instance = FmuInstance | IsolatedInstance

FINER = 0.1  # of the accuracy of the tangents, with half the step: the change is the error
TRIAL = 1.0, 1e-3  # s: stop time and step of the trial of saved states
WINDOW = 0.1  # of the run: its last three windows are compared
SETTLED = 1e-7  # of a signal's range: a smaller swing counts as zero
STILL = 1e-12  # of a signal's range: a smaller change from row to row counts as zero
SMALL = 1e-3  # of a signal's range: largest swing near rest, and distance of a closed cycle
FALLING = 0.5  # largest ratio of the swings of two windows, if the motion comes to rest
LEAST = 1e-6  # of its nominal value: smallest range of a signal
SHRUNK = 0.5  # share of its size that a cycle may lose over the second half of the run
NEUTRAL, DECAYED = 1e-2, 0.1  # nats: most growth of a neutral tangent, least fall of a decaying one


def loop_lyapunov_over_fmus(
    loop: Loop, progress: Callable[[str], None] | None = None
) -> LyapunovRun:
    """Exponents of a closed loop from its FMUs and their master.

    For two parts with equations, the errors of the exponents are their differences from those of
    one solver, and the verdict comes from the equations, whose motion is computed far beyond
    `stop`. A loop with an FMU file has no equations: the errors are the changes by a finer run, the
    verdict comes from the signals until the end of the run, and no limits are known.

    Parameters
    ----------
    loop : Loop
        With a communication step. Its plant has tangents; a controller without tangents is probed.
    progress : function of str, optional

    Raises
    ------
    UserError
        If this is not possible for the loop.
    FmuError, CouplingError, StepFailed
        If a file is not an FMU that can run here, or the parts do not fit or reject their values.
    """
    stop, step, known = loop.stop, loop.step, None
    assert step is not None
    if loop.plant.has_equations and loop.controller.has_equations:
        if held_loop_kernel(loop.plant.name, loop.controller.name).sample_time:
            raise UserError(
                f"{loop.controller.own_name} is sampled, and FMUs of sampled parts "
                "have no tangents; use the equations, --via model"
            )
        known = loop_lyapunov(loop, watching=Watching(progress))
    with _opened(loop) as parts:
        if progress:
            progress(f"the FMUs over {stop:g} s")
        run = parts.follow(loop, step, ACCURACY)
        method = f"{parts.description}, {run.method}; {run.accuracy}"
        if known:
            return replace(known, spectrum=_spectrum(run), tighter=known.spectrum, method=method)
        if progress:
            progress(f"the FMUs over {stop:g} s, again with finer steps")
        return LyapunovRun(
            list(run.states),
            _spectrum(run),
            _spectrum(parts.follow(loop, 0.5 * step, FINER * ACCURACY)),
            signal_motion(run, parts.nominal(loop.mapping), run.growth[:, 0]),
            math.nan,
            loop.title,
            f"{method}; finite-time only: without equations the motion is not known beyond "
            f"{stop:g} s",
            loop=loop,
        )


def _spectrum(run: TangentRun) -> Spectrum:
    """The run on a grid of few times; the states of the FMUs are not known."""
    keep = np.unique(np.linspace(0, len(run.time) - 1, SAMPLES + 1).astype(int))
    growth, count = run.growth[keep], run.growth.shape[1]
    states = np.full(growth.shape, np.nan)
    trace, frame = run.trace[keep], np.eye(count)
    return Spectrum(run.time[keep], states, growth, trace, frame, 0, run.stopped, run.diverged)


@dataclass(frozen=True)
class _Parts:
    """Both FMUs of a loop, opened and not initialized; `description` describes them."""

    plant: _Instance
    controller: _Instance
    description: str

    def follow(self, loop: Loop, step: float, accuracy: float) -> TangentRun:
        """A run of new instances with tangents; arguments and errors as `follow_over_fmus`."""
        with contextlib.ExitStack() as opened:
            plant, controller = self.plant.reopened(), self.controller.reopened()
            opened.callback(plant.close)
            opened.callback(controller.close)
            return follow_over_fmus(
                plant,
                controller,
                loop.set_point,
                loop.stop,
                step,
                plant_values=loop.plant_values,
                controller_values=loop.controller_values,
                mapping=with_aliases(plant, controller, loop.mapping),
                accuracy=accuracy,
            )

    def nominal(self, mapping: Mapping[str, str]) -> dict[str, float]:
        """Nominal values of the plant's outputs except tangents, by their names in results."""
        names = ordinary(self.plant).outputs
        ours = names_on(PLANT, names, with_aliases(self.plant, self.controller, mapping))
        return {ours[n]: self.plant.nominal(n) for n in names}


@contextlib.contextmanager
def _opened(loop: Loop) -> Iterator[_Parts]:
    """Open the FMUs of a loop with a tangent for each state of both parts.

    Names become native FMUs if there is a compiler. A file from elsewhere runs in its own process.
    """
    if loop.sampled:
        raise FmuError(f"{loop.controller}: exponents cannot sample an FMU")
    with contextlib.ExitStack() as opened:
        sides: dict[str, Part] = {"plant": loop.plant, "controller": loop.controller}
        instances: dict[str, _Instance] = {}
        builds = dict.fromkeys(sides, "third-party")
        tangents = 0
        for side, part in sides.items():
            if part.has_equations:
                tangents += len(part.kernel.states)
                continue
            file = open_fmu(part.fmu(), side)
            opened.callback(file.close)
            check_state(file, {}, *TRIAL)
            # a controller without tangents is probed, with one state
            tangents += len(tangent_states(list(file.parameters))[0]) or 1
            instances[side] = file
        for side in sides.keys() - instances.keys():
            path, builds[side] = ready_fmu(sides[side].name, tangents)
            instances[side] = named = FmuInstance(path, side)
            opened.callback(named.close)
        description = f"{builds['plant']} variational FMUs"
        if builds["plant"] != builds["controller"]:
            description = f"plant: {builds['plant']} FMU, controller: {builds['controller']} FMU"
        yield _Parts(instances["plant"], instances["controller"], description)


def ready_fmu(name: str, tangents: int = 0) -> tuple[Path, str]:
    """As `fmu`, and its build: `NATIVE` if there is a C compiler, else `READABLE`."""
    kernel = fmu_kernel(name, tangents=tangents)

    def write(path: Path) -> None:
        from ..fmus.native.export import write_native

        platform = own_platform()
        if not platform or not compiler_for(platform):
            raise CompilerFailed("there is no C compiler")
        write_native(catalogued_model(name, tangents=tangents), path, 2, [platform])

    try:
        content = kernel.to_json() + way_of_making()
        return kept_fmu(f"{kernel.name}_native", content, write), NATIVE
    except CompilerFailed:
        return stored_fmu(kernel), READABLE


def signal_motion(
    run: TangentRun, nominal: Mapping[str, float], growth: Vector | None = None
) -> Attractor:
    """Long-term motion of a coupled run, from its signals only.

    Rest is judged from the last three tenths of the run, cycles from its second half. Only the
    first tangent shows whether an equilibrium is one of a line: it neither grows nor falls at rest
    if a direction is neutral. If the outputs stopped for as long before and moved again, it is not
    at rest: for example a mass that sticks until its force swings back.

    Parameters
    ----------
    run : TangentRun
        Its times, outputs, and how it ended.
    nominal : mapping of str to float
        Nominal values of the outputs.
    growth : ndarray, shape (m,), optional
        Logarithm of the length of the first tangent at the times of the run [nats].
    """
    if run.diverged:
        return Attractor(Kind.DIVERGES, run.stopped, since=float(run.time[-1]))
    if run.stopped:
        return Attractor(Kind.UNDECIDED, run.stopped, "a run that continues beyond this point")
    names, table = list(run.outputs), np.column_stack(list(run.outputs.values()))
    least = LEAST * np.array([nominal[n] for n in names])
    scale = np.maximum(np.ptp(table, axis=0), least)
    end = run.time[-1]
    swings = []
    for k in (3, 2, 1):
        first, behind = np.searchsorted(
            run.time, [(1 - k * WINDOW) * end, (1 - (k - 1) * WINDOW) * end]
        )
        swings.append(np.ptp(table[first : behind + 1], axis=0) / scale)
    before, middle, last = (float(s.max()) for s in swings)
    falls = middle <= FALLING * before and last <= FALLING * middle and last <= SMALL
    if falls or max(middle, last) <= SETTLED:
        earlier, present = _stands(run.time, table / scale)
        if earlier >= present > 0.0:
            text = (
                f"all outputs have been constant for {present:.4g} s; before this they were "
                f"constant for {earlier:.4g} s and then moved again"
            )
            return Attractor(Kind.UNDECIDED, text, "a longer run")
        text = (
            f"over the last tenth of the run no output moves by more than {last:.2g} of its range"
        )
        if falls:
            text += f", after {middle:.2g} and {before:.2g} in the tenths before"
        return _rest(run, text, growth)
    widest = int(np.argmax(swings[-1]))
    cycle = _cycle(run, names, table, widest)
    return cycle or Attractor(
        Kind.UNDECIDED,
        "no rest and no periodic returns: over the last tenth of the run "
        f"{names[widest]} moves by {last:.2g} of its range",
        "a longer run, or the equations (--via model)",
    )


def _stands(time: Vector, rows: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Longest rest of the outputs before, without the start, and that at the end [s]."""
    still = np.concatenate([[False], np.abs(np.diff(rows, axis=0)).max(axis=1) <= STILL, [False]])
    ends = np.flatnonzero(np.diff(still.astype(np.int8)))
    begins, ends = ends[::2], ends[1::2]
    lasts = time[ends] - time[begins]
    present = float(lasts[-1]) if len(ends) and ends[-1] == len(time) - 1 else 0.0
    before = lasts[(begins > 0) & (ends < len(time) - 1)]
    return float(before.max(initial=0.0)), present


def _rest(run: TangentRun, moves: str, growth: Vector | None) -> Attractor:
    if growth is None:
        return Attractor(Kind.REST, moves)
    begin = (1.0 - WINDOW) * run.time[-1]
    grown = float(growth[-1] - np.interp(begin, run.time, growth))
    text = f"{moves}; the first tangent grows by {grown:.2g} nats meanwhile"
    if abs(grown) <= NEUTRAL:
        return Attractor(Kind.LINE, f"{text}: a direction is neutral")
    if grown < -DECAYED:
        return Attractor(Kind.FIXED_POINT, f"{text}: no direction is neutral")
    if grown > 0.0:
        return Attractor(Kind.UNDECIDED, f"{text}: a disturbance may grow", "a longer run")
    return Attractor(Kind.REST, text)


def _cycle(
    run: TangentRun, names: list[str], table: npt.NDArray[np.float64], widest: int
) -> Attractor | None:
    """A cycle, if outputs of the second half, one period apart, are equal; else None."""
    half = run.time >= 0.5 * run.time[-1]
    time, rows = run.time[half], table[half]
    low, high = rows.min(axis=0), rows.max(axis=0)
    above = rows[:, widest] - 0.5 * (low + high)[widest]
    at = np.flatnonzero((above[:-1] < 0.0) & (above[1:] >= 0.0))
    if len(at) < 2:
        return None
    share = -above[at] / (above[at + 1] - above[at])
    returns = rows[at] + share[:, None] * (rows[at + 1] - rows[at])
    times = time[at] + share * (time[at + 1] - time[at])
    size = np.where(high > low, high - low, np.inf)
    # with few outputs, a return is compared together with its duration and its extremes
    between = np.diff(times)
    extremes = np.maximum.reduceat(rows, at)[:-1], np.minimum.reduceat(rows, at)[:-1]
    whole = np.column_stack([returns[1:], *extremes, between])
    sizes = np.concatenate([size, size, size, [between.mean()]])
    for lag, error in closings(whole, sizes, SMALL):
        period = float(times[-1] - times[-1 - lag])
        wide = np.ptp(rows[time >= times[-1] - period], axis=0)
        if np.max(np.abs(wide - size) / size, where=np.isfinite(size), initial=0.0) > SHRUNK:
            continue
        amplitude = dict(zip(names, (0.5 * (high - low)).tolist(), strict=True))
        text = (
            f"outputs {period:.6g} s apart ({lag} return{'s' if lag > 1 else ''}) differ by "
            f"{error:.2g} of the motion's size, {names[widest]} swings by "
            f"{amplitude[names[widest]]:.4g} to either side"
        )
        return Attractor(Kind.CYCLE, text, period=period, amplitude=amplitude, return_error=error)
    return None

"""Tune one controller for one machine: a study of one controller, with margins.

The search, the price of a run, the ranges of gains and the figures are those of a study. A run
costs its rms error, divided by that with modest gains; commands beyond the machine's limit add to
it, and so does a sensitivity above 2, the limit for a robust loop (K. J. Astrom and T. Hagglund,
"Advanced PID Control", ISA (2006), section 4.6). See ``docs/howto/tune.md``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers import CONTROLLERS, tunable
from ...fmus.units import base_exponents
from ...solver.errors import BadParameter
from ...solver.files import finite_or_null, write_atomically
from ...solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..loop.catalogue import component
from ..loop.loop import Loop
from ..loop.machine import (
    Linear,
    Machine,
    Margins,
    gain_ranges,
    gains_of,
    is_stable,
    linearized,
    margins_of,
    model_values,
    open_loop,
    response_of,
)
from ..loop.reference_motions import read_set_point
from ..loop.whole_loop import follow, loop_kernel
from ..master.reference_signal import Reference
from .figures import Figures, measured
from .loop import STEP, AnyLoop, Course, FmuLoop, StudyLoop, of_side
from .tuning import FAILED, OVER_LIMIT, price, tune

FILE = "tuning.json"
BUDGET, SEED = 100, 1
TOLERANCE, TIGHTER = 1e-6, 1e-8  # of the solver, in two runs that should agree
AGREE = 0.01  # share of the rms error
REST = 0.5  # s, after the end of a motion
COUNT = 1e-6  # m, resolution of the position for the detection of hunting
MOST_SENSITIVE = 2.0  # Ms
SENSITIVITY_POINTS = 300  # of the frequency response of a candidate
MORE = 0.1  # share of the cost: a larger gain by twice the budget is reported
SLIDE = 2.0  # s, until a loop slides steadily
NEVER_AT_LIMIT = {"saturated_share": 0.0}
NOT_LINEAR = {
    "relay": "a relay has no slope at the set-point",
    "fuzzy_pd_i": "its rules have a kink at the set-point",
    "sliding_mode": "it switches at its surface",
    "super_twisting": "it switches at its surface",
    "adaptive_friction": "its gain depends on its adapted estimate",
}

Gains = Mapping[str, float]
Signal = tuple[Reference, float]
"""A motion, and the length of its run [s]."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Gain:
    """A tuned parameter."""

    name: str
    value: float
    start: float  # of the search
    unit: str
    low: float  # ends of the range that was searched
    high: float
    at_end: str  # "low" or "high" if the value is within 1 % of this end, else empty


@dataclass(frozen=True)
class Motion:
    """A motion under the tuned gains."""

    name: str
    reference: str
    tuned_on: bool  # whether it was used for tuning, not for judging
    figures: Figures
    peak_command: float  # largest magnitude of the requested command [its unit]
    converged: bool  # whether a hundredth of the tolerance gives the same rms error within 1 %
    course: Course


@dataclass(frozen=True)
class TunedController:
    """Gains of one controller for one machine, and what they achieve."""

    loop: Loop  # with the gains; its set-point is the judging motion
    limit: float  # largest command that the machine gives
    command_unit: str
    gains: tuple[Gain, ...]
    start_cost: float
    cost: float
    doubled_cost: float  # the lowest within twice the budget
    budget: int
    seed: int
    motions: tuple[Motion, ...]  # the judging motion is the last
    margins: tuple[Margins, ...]  # of the loop linearized stuck and sliding
    no_margins: tuple[str, ...]  # why margins are missing

    @property
    def weaknesses(self) -> tuple[str, ...]:
        """Limitations of the result, in words; empty if there are none."""
        found = []
        for motion in self.motions:
            if motion.figures.failed:
                found.append(f"the {motion.name} could not be run to its end")
            elif not motion.converged:
                found.append(f"the run of the {motion.name} is not converged")
            if motion.peak_command > self.limit * (1 + 1e-9):
                found.append(f"the {motion.name} demands more than the limit")
            elif motion.figures.saturated_share > 0:
                share = 100 * motion.figures.saturated_share
                found.append(f"the command is at its limit for {share:.2g} % of the {motion.name}")
        for m in self.margins:
            if not m.stable:
                found.append(f"unstable while {m.state}")
            elif m.sensitivity > MOST_SENSITIVE * (1 + AGREE):
                found.append(f"Ms is more than {MOST_SENSITIVE:g} while {m.state}")
        found += [f"{g.name} is at the {g.at_end} end of its range" for g in self.gains if g.at_end]
        if self.doubled_cost < (1 - MORE) * self.cost:
            gain = 100 * (1 - self.doubled_cost / self.cost)
            found.append(f"twice the budget would gain {gain:.0f} %")
        return tuple(found)

    @property
    def trusted(self) -> bool:
        """Whether all runs converged, and the linearized loops are stable."""
        runs = all(m.converged and not m.figures.failed for m in self.motions)
        return runs and all(m.stable for m in self.margins)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tuning.json``."""
        motions, loops = ([vars(m) for m in of] for of in (self.motions, self.margins))
        return {
            "controller": self.loop.controller.label,
            "plant": self.loop.plant.label,
            **{n: getattr(self, n) for n in _TOLD},
            "gains": [asdict(g) for g in self.gains],
            "set": [f"controller.{g.name}={g.value!r}" for g in self.gains],
            "motions": [
                {n: m[n] for n in _OF_MOTION} | {n: getattr(m["figures"], n) for n in _FIGURES}
                for m in motions
            ],
            "loops": [{n: v for n, v in m.items() if n not in _CURVES} for m in loops],
            "no_margins": list(self.no_margins),
            "weaknesses": list(self.weaknesses),
        }

    def save(self, folder: Path | str) -> None:
        """Write ``tuning.json``, and ``parameters.toml`` with the gains for the next command."""
        text = json.dumps(finite_or_null(self.to_dict()), indent=1)
        write_atomically(Path(folder) / FILE, text.encode())
        told = self.loop.parameters()
        label, gains = self.loop.controller.label, {g.name for g in self.gains}
        values = {
            n: replace(v, source="tuned for this machine") if n in gains else v
            for n, v in told.controllers[label].items()
        }
        replace(told, controllers={**told.controllers, label: values}).save(folder)


# in tuning.json: of a tuning, of a motion, of its figures; and what of the margins is not
_TOLD = "limit command_unit start_cost cost doubled_cost budget seed".split()
_OF_MOTION = "name reference tuned_on peak_command converged".split()
_FIGURES = (
    "rms_error peak_error reversal_error overshoot settling_2pct steady_error saturated_share "
    "hunting_amplitude failed"
).split()
_CURVES = ("frequency", "response")


def tune_loop(
    loop: Loop,
    reference: str | None = None,
    stop: float | None = None,
    limit: float | None = None,
    budget: int = BUDGET,
    seed: int = SEED,
    progress: Progress | None = None,
) -> TunedController:
    """Find the gains of a loop's controller for its plant; see `ballscrew.tune`.

    The controller's gains are one of the two starting points; its other values stay. The motion for
    the tuning is `reference` for `stop` seconds, else a step and a reversing move that the limit
    allows. `budget` candidates are for the result, as many again show what more would gain.
    `progress` gets the number of finished candidates and that of all.

    Raises `BadParameter` if the controller has no ranges for its gains, or the machine has no
    limit; `CouplingError`, `FmuError`, `ContractError` if the parts do not fit.
    """
    _check(loop)
    machine = Machine.of(loop.plant, loop.plant_values, limit)
    tried = _TunedLoop(loop, machine)
    step, move, judge = machine.motions()
    motions = {"step": step, "move": move} if reference is None else {"motion": reference}
    signals = {name: _signal(text, stop) for name, text in motions.items()}
    ranges, modest = gain_ranges(loop.controller, machine)
    scales = {name: tried.size(modest, signal) for name, signal in signals.items()}
    own = {n: loop.controller_values.get(n, loop.controller.parameters[n].default) for n in ranges}
    count = 2 * budget + 2
    done = 0

    def cost(gains: Gains) -> float:
        nonlocal done
        done += 1
        if progress:
            progress(min(done, count), count)
        prices = [tried.price(gains, signals[name], scales[name]) for name in signals]
        return sum(prices) / len(prices) + tried.fragility(gains)

    start = min(own, modest, key=cost)
    found = tune(cost, start, ranges, budget, seed)
    shown = [tried.motion(found.values, n, motions[n], signals[n], True) for n in motions]
    signal, length = _signal(judge)
    shown.append(tried.motion(found.values, "judging move", judge, (signal, length), False))
    margins, without = tried.margins(found.values)
    gains = []
    for name, (low, high) in ranges.items():
        value, unit = found.values[name], loop.controller.parameters[name].unit
        near = "low" if value - low < high - value else "high"
        at_end = near if name in found.at_bound else ""
        gains.append(Gain(name, value, start[name], unit, low, high, at_end))
    return TunedController(
        loop=replace(
            loop,
            plant_values=dict(machine.values),
            controller_values={**loop.controller_values, **tried.values(found.values)},
            reference=signal,
            stop=length,
        ),
        limit=machine.limit,
        command_unit=machine.plant.command_unit,
        gains=tuple(gains),
        start_cost=found.published_cost,
        cost=found.cost,
        doubled_cost=found.doubled_cost,
        budget=budget,
        seed=seed,
        motions=tuple(shown),
        margins=margins,
        no_margins=without,
    )


def _check(loop: Loop) -> None:
    """Make sure that there is something to tune; raises `BadParameter`."""
    if not gains_of(loop.controller):
        names = ", ".join(n for n in CONTROLLERS if tunable(n))
        raise BadParameter(
            f"{loop.controller} has no gains to tune: no parameter with a minimum and a maximum; "
            f"controllers with gains are {names}"
        )
    if not loop.plant.has_equations:
        raise BadParameter(
            f"{loop.plant} has no equations for tuning; expected a plant with equations"
        )
    loop.check_values()


def _signal(text: str, stop: float | None = None) -> Signal:
    signal = read_set_point(text)
    return signal, float(signal.times[-1]) + REST if stop is None else stop


class _TunedLoop:
    """A closed loop that is run and linearized, stuck and sliding, with other gains."""

    def __init__(self, loop: Loop, machine: Machine) -> None:
        self.part, self.machine = loop.controller, machine
        self.loop: AnyLoop = FmuLoop(loop)
        self.missing = "an FMU has no equations"
        if self.part.has_equations:
            self.loop = StudyLoop(self._kernel)
            self.missing = NOT_LINEAR.get(self.part.bare, "")
        gains = gains_of(self.part)
        own = {n: v for n, v in loop.controller_values.items() if n not in gains}
        self.fixed = {**model_values(self.part, machine), **own}

    def values(self, gains: Gains) -> dict[str, float]:
        """All values of the controller with these gains."""
        return {**self._tracking(gains), **self.fixed, **gains}

    def _tracking(self, gains: Gains) -> dict[str, float]:
        """The tracking time of the anti-windup: the integral time that follows from the gains."""
        known = self.part.parameters if self.part.bare in CONTROLLERS else {}
        if "Tt" not in known or "Ki" not in gains:
            return {}
        powers = base_exponents(known["Ki"].unit)
        powers["s"] = powers.get("s", 0) + 1
        wanted = {n: p for n, p in powers.items() if p}
        for name, value in gains.items():
            if base_exponents(known[name].unit) == wanted:
                time = value / max(gains["Ki"], 1e-12)
                return {"Tt": float(np.clip(time, STEP, known["Tt"].maximum))}
        return {}

    def _of_loop(self, gains: Gains) -> dict[str, float]:
        """All values of both parts, by the loop's names."""
        values = {PLANT + n: v for n, v in self.machine.values.items()}
        return values | {CONTROLLER + n: v for n, v in self.values(gains).items()}

    def run(
        self, gains: Gains, signal: Signal, tolerance: float = TOLERANCE
    ) -> tuple[Course, Figures]:
        return measured(self.loop, self._of_loop(gains), signal, tolerance, COUNT)

    def size(self, modest: Gains, signal: Signal) -> float:
        """The rms error with modest gains, for which the price is 1 [m]."""
        error = self.run(modest, signal)[1].rms_error
        return error if error > 0 else float(np.abs(signal[0].values).max()) or 1.0

    def price(self, gains: Gains, signal: Signal, size: float) -> float:
        """Price of a run; commands beyond the limit add to that of a study."""
        course, found = self.run(gains, signal)
        if found.failed:
            return FAILED
        over = max(0.0, float(np.abs(course.command).max()) / self.machine.limit - 1)
        return price(found, size, NEVER_AT_LIMIT) + min(OVER_LIMIT * over, FAILED)

    def motion(self, gains: Gains, name: str, text: str, signal: Signal, tuned_on: bool) -> Motion:
        (course, found), (_, other) = (self.run(gains, signal, t) for t in (TOLERANCE, TIGHTER))
        same = abs(found.rms_error - other.rms_error) <= AGREE * other.rms_error
        peak = float(np.abs(course.command).max(initial=0.0))
        return Motion(name, text, tuned_on, found, peak, same, course)

    def fragility(self, gains: Gains) -> float:
        """Cost added if the loop has Ms above 2; 1 if it is unstable.

        A law that is not linear is linearized at rest without an error.
        """
        paid = 0.0
        for _, _, plant, _ in self._states:
            loop = self._open(gains, plant, self.machine.stuck())
            largest = float(np.abs(1 / (1 + response_of(loop, SENSITIVITY_POINTS)[1])).max())
            excess = OVER_LIMIT * max(0.0, largest / MOST_SENSITIVE - 1)
            paid += min(1.0, excess) if is_stable(loop) else 1.0
        return paid

    def margins(self, gains: Gains) -> tuple[tuple[Margins, ...], tuple[str, ...]]:
        """Margins of the loop, stuck and sliding, and reasons for missing ones."""
        if self.missing:
            return (), (f"{self.part}: no margins, {self.missing}",)
        found, without = [], []
        if self.machine.plant.kernel.modes:
            without.append("stuck: this friction law has no bristles, so the body does not move")
        for state, speed, plant, own in self._states:
            at = self._followed(gains, speed, own) if speed else own
            if at is None:
                without.append(f"sliding at {speed:g} m/s: there is no steady sliding of the loop")
            else:
                found.append(margins_of(self._open(gains, plant, at), state, speed))
        return tuple(found), tuple(without)

    @cached_property
    def _states(self) -> list[tuple[str, float, Linear, dict[str, float]]]:
        """Points of linearization: name, speed, linear plant, and its states."""
        machine = self.machine
        if self.missing:
            return []
        at = {"stuck": (0.0, machine.stuck())} if not machine.plant.kernel.modes else {}
        at["sliding"] = (machine.speed, machine.sliding(machine.speed))
        return [(s, v, machine.linear(self._seen, own), own) for s, (v, own) in at.items()]

    def _followed(
        self, gains: Gains, speed: float, plant: Mapping[str, float]
    ) -> dict[str, float] | None:
        """States and inputs when the loop follows a ramp steadily; None if it does not."""
        model = self._model(gains)
        ramp = Reference.of_pieces([0.0, 2 * SLIDE], [[0.0, speed], [2 * SLIDE * speed, 0.0]])
        step = model.sample_time or STEP
        time = np.arange(round(SLIDE / step) + 1, dtype=np.float64) * step
        y, stopped = follow(model, ramp, time)
        if stopped or abs(y["v"][-1] / speed - 1) > AGREE:
            return None
        kernel, first = model.kernel, len(model.kernel.inputs)
        names = [s.name for s in (*kernel.states, *kernel.discrete)]
        all_of = dict(zip(names, [*model.x, *model.u[first:]], strict=False))
        own = of_side(CONTROLLER, all_of)
        return {**plant, **own, "x": float(y["x"][-1]), "x_d": SLIDE * speed, "v_d": speed}

    def _model(self, gains: Gains) -> Model:
        return Model(self._kernel, self._of_loop(gains), TOLERANCE)

    @cached_property
    def _kernel(self) -> Kernel:
        return loop_kernel(self.machine.plant.name, self.part.name)

    @cached_property
    def _seen(self) -> tuple[str, ...]:
        """The machine's outputs that the controller measures."""
        used = {str(s) for s in component(self.part.name).used_symbols()}
        return tuple(n for n in self.machine.outputs if n in used)

    def _open(self, gains: Gains, plant: Linear, at: Mapping[str, float]) -> Any:
        law = linearized(self.part, self._seen, ("u",), self.values(gains), at)
        return open_loop(plant, law, self._model(gains).sample_time)

"""Tune one controller for one machine, test it on another motion, and linearize the loop twice.

The search minimizes the rms error of the tuning motions, each divided by its error with modest
gains. As in studies, commands beyond the machine's limit add to the cost; so does a sensitivity
above 2, the limit for a robust loop (K. J. Astrom and T. Hagglund, "Advanced PID Control", ISA
(2006), section 4.6). See ``docs/howto/tune.md``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..controllers import CONTROLLERS, tunable
from ..fmus.units import base_exponents
from ..instruments import bare
from ..solver.files import finite_or_null, write_atomically
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from .catalogue import component
from .limits import BadParameter
from .linear_loop import (
    Linear,
    Margins,
    is_stable,
    linear_kernel,
    linearized,
    margins_of,
    open_loop,
    response_of,
)
from .loop import Loop
from .machine import LIMIT, Machine, gain_ranges, gains_of, limit_of, model_values
from .reference_motions import read_set_point
from .reference_signal import Reference
from .study.figures import Figures, figures_of
from .study.loop import STEP, Course, FmuLoop, StudyLoop, of_side
from .study.study import FAILED, OVER_LIMIT
from .study.tuning import Tuned
from .study.tuning import tune as optimized
from .whole_loop import follow, loop_kernel

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
NOT_LINEAR = {
    "relay": "a relay has no slope at the set-point",
    "fuzzy_pd_i": "its rules have a kink at the set-point",
    "sliding_mode": "it switches at its surface",
    "super_twisting": "it switches at its surface",
    "adaptive_friction": "its gain depends on its adapted estimate",
}

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Gain:
    """A tuned parameter.

    Attributes
    ----------
    name : str
    value, start : float
        The value found, and the start of the search.
    unit : str
    low, high : float
        The range that was searched.
    at_end : {"", "low", "high"}
        The end of the range, if the value is within 1 % of it.
    """

    name: str
    value: float
    start: float
    unit: str
    low: float
    high: float
    at_end: str


@dataclass(frozen=True)
class Motion:
    """A motion under the tuned gains.

    Attributes
    ----------
    name, reference : str
    tuned_on : bool
        Whether it was used for tuning, not for judging.
    figures : Figures
    peak_command : float
        Largest magnitude of the requested command [unit of the command].
    converged : bool
        Whether a run with a hundredth of the tolerance has the same rms error within 1 %.
    course : Course
    """

    name: str
    reference: str
    tuned_on: bool
    figures: Figures
    peak_command: float
    converged: bool
    course: Course


@dataclass(frozen=True)
class TunedController:
    """Gains of one controller for one machine, and what they achieve.

    Attributes
    ----------
    loop : Loop
        With the gains; its set-point is the judging motion.
    limit : float
        Largest command that the machine gives.
    command_unit : str
    gains : tuple of Gain
    start_cost, cost, doubled_cost : float
        Cost at the start, with the gains, and the lowest cost within twice the budget.
    budget, seed : int
    motions : tuple of Motion
        The judging motion is the last.
    margins : tuple of Margins
        Of the loop linearized stuck and sliding.
    no_margins : tuple of str
        Why margins are missing.
    """

    loop: Loop
    limit: float
    command_unit: str
    gains: tuple[Gain, ...]
    start_cost: float
    cost: float
    doubled_cost: float
    budget: int
    seed: int
    motions: tuple[Motion, ...]
    margins: tuple[Margins, ...]
    no_margins: tuple[str, ...]

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
        skipped = ("frequency", "response")
        return {
            "controller": self.loop.controller.label,
            "plant": self.loop.plant.label,
            "limit": self.limit,
            "command_unit": self.command_unit,
            "gains": [asdict(g) for g in self.gains],
            "set": [f"controller.{g.name}={g.value!r}" for g in self.gains],
            "start_cost": self.start_cost,
            "cost": self.cost,
            "doubled_cost": self.doubled_cost,
            "budget": self.budget,
            "seed": self.seed,
            "motions": [
                {
                    "name": m.name,
                    "reference": m.reference,
                    "tuned_on": m.tuned_on,
                    "peak_command": m.peak_command,
                    "converged": m.converged,
                    **{n: getattr(m.figures, n) for n in _TOLD},
                }
                for m in self.motions
            ],
            "loops": [
                {f.name: getattr(m, f.name) for f in fields(m) if f.name not in skipped}
                for m in self.margins
            ],
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


_TOLD = (
    "rms_error peak_error reversal_error overshoot settling_2pct steady_error saturated_share "
    "hunting_amplitude failed"
).split()


def tune_loop(
    loop: Loop,
    reference: str | None = None,
    stop: float | None = None,
    limit: float | None = None,
    budget: int = BUDGET,
    seed: int = SEED,
    progress: Progress | None = None,
) -> TunedController:
    """Find the gains of a loop's controller for its plant.

    Parameters
    ----------
    loop : Loop
        Its controller's gains are one of the two starting points; its other values stay.
    reference : str, optional
        Motion for the tuning. Default: a step and a reversing move that the limit allows.
    stop : float, optional
        Length of that motion [s]. Default: its end and half a second.
    limit : float, optional
        Largest command. Default: the plant's ``voltage_limit``; 36 V for an axis.
    budget, seed : int
        Number of candidates; as many again show what more candidates would improve.
    progress : function of int and int, optional
        Called with the number of finished candidates and the number of all.

    Raises
    ------
    BadParameter
        If the controller has no ranges for its gains, or the machine has no limit.
    WiringError, CouplingError, FmuError
        If an FMU does not fit.
    ContractError
        If plant and controller do not fit together.
    """
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
    most = limit_of(loop.plant, loop.plant_values, limit)
    machine = Machine(loop.plant, {**loop.plant_values, LIMIT: most}, most)
    work = _Work(loop, machine)
    step, move, judge = machine.motions()
    motions = [("step", step, True), ("move", move, True)]
    if reference is not None:
        motions = [("motion", reference, True)]
    ranges, modest = gain_ranges(loop.controller, machine)
    runs = [work.scaled(modest, *_signal(text, stop)) for _, text, _ in motions]
    own = {n: loop.controller_values.get(n, loop.controller.parameters[n].default) for n in ranges}
    count = 2 * budget + 2
    done = 0

    def cost(gains: Mapping[str, float]) -> float:
        nonlocal done
        done += 1
        if progress:
            progress(min(done, count), count)
        errors = [work.price(gains, *run) for run in runs]
        return sum(errors) / len(errors) + work.fragility(gains)

    start = min(own, modest, key=cost)
    found = optimized(cost, start, ranges, budget, seed)
    gains = found.values
    motions.append(("judging move", judge, False))
    shown = tuple(
        work.motion(gains, name, text, tuned_on, stop if tuned_on else None)
        for name, text, tuned_on in motions
    )
    margins, without = work.margins(gains)
    kept = {**loop.controller_values, **work.values(gains)}
    signal, length = _signal(judge)
    return TunedController(
        replace(
            loop,
            plant_values=dict(machine.values),
            controller_values=kept,
            reference=signal,
            stop=length,
        ),
        most,
        work.command_unit,
        _gains(loop, found, start, ranges),
        found.published_cost,
        found.cost,
        found.doubled_cost,
        budget,
        seed,
        shown,
        margins,
        without,
    )


def _gains(
    loop: Loop,
    found: Tuned,
    start: Mapping[str, float],
    ranges: Mapping[str, tuple[float, float]],
) -> tuple[Gain, ...]:
    gains = []
    for name, (low, high) in ranges.items():
        value = found.values[name]
        near = "low" if value - low < high - value else "high"
        unit = loop.controller.parameters[name].unit
        at_end = near if name in found.at_bound else ""
        gains.append(Gain(name, value, start[name], unit, low, high, at_end))
    return tuple(gains)


def _signal(text: str, stop: float | None = None) -> tuple[Reference, float]:
    """A motion, and the length of its run [s]."""
    signal = read_set_point(text)
    return signal, float(signal.times[-1]) + REST if stop is None else stop


class _Work:
    """One closed loop that is run many times, and the controller's model of the machine."""

    def __init__(self, loop: Loop, machine: Machine) -> None:
        self.loop, self.machine = loop, machine
        self.course: StudyLoop | FmuLoop = FmuLoop(loop)
        if loop.controller.has_equations:
            self.course = StudyLoop(loop_kernel(loop.plant.name, loop.controller.name))
        gains = gains_of(loop.controller)
        own = {n: v for n, v in loop.controller_values.items() if n not in gains}
        self.fixed = {**model_values(loop.controller, machine), **own}

    @property
    def command_unit(self) -> str:
        return self.machine.plant.command_unit

    def values(self, gains: Mapping[str, float]) -> dict[str, float]:
        """All values of the controller with these gains."""
        return {**self._tracking(gains), **self.fixed, **gains}

    def _tracking(self, gains: Mapping[str, float]) -> dict[str, float]:
        """The tracking time of the anti-windup: the integral time that follows from the gains."""
        part = self.loop.controller
        known = part.parameters if bare(part.name) in CONTROLLERS else {}
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

    def of_loop(self, gains: Mapping[str, float]) -> dict[str, float]:
        """All values of the loop with these gains, by the loop's names."""
        values = {PLANT + n: v for n, v in self.machine.values.items()}
        return values | {CONTROLLER + n: v for n, v in self.values(gains).items()}

    def model(self, gains: Mapping[str, float]) -> Model:
        """The loop with these gains; its controller has equations."""
        assert isinstance(self.course, StudyLoop)
        return Model(self.course.kernel, self.of_loop(gains), TOLERANCE)

    def run(
        self, gains: Mapping[str, float], signal: Reference, stop: float, tolerance: float
    ) -> Course:
        return self.course.run(self.of_loop(gains), signal, stop, tolerance)

    def figures(self, course: Course) -> Figures:
        return figures_of(course, COUNT, self.machine.limit)

    def scaled(
        self, modest: Mapping[str, float], signal: Reference, stop: float
    ) -> tuple[Reference, float, float]:
        """A motion, its length, and its rms error with modest gains, for which the cost is 1."""
        error = self.figures(self.run(modest, signal, stop, TOLERANCE)).rms_error
        return signal, stop, error if error > 0 else float(np.abs(signal.values).max()) or 1.0

    def price(
        self, gains: Mapping[str, float], signal: Reference, stop: float, scale: float
    ) -> float:
        course = self.run(gains, signal, stop, TOLERANCE)
        found = self.figures(course)
        if found.failed:
            return FAILED
        over = max(0.0, float(np.abs(course.command).max()) / self.machine.limit - 1)
        excess = OVER_LIMIT * (min(over, FAILED / OVER_LIMIT) + found.saturated_share)
        return min(FAILED, found.rms_error / scale) + excess

    def motion(
        self, gains: Mapping[str, float], name: str, text: str, tuned_on: bool, stop: float | None
    ) -> Motion:
        signal, length = _signal(text, stop)
        course, again = (self.run(gains, signal, length, t) for t in (TOLERANCE, TIGHTER))
        found, other = self.figures(course), self.figures(again)
        same = abs(found.rms_error - other.rms_error) <= AGREE * other.rms_error
        peak = float(np.abs(course.command).max(initial=0.0))
        return Motion(name, text, tuned_on, found, peak, same, course)

    def fragility(self, gains: Mapping[str, float]) -> float:
        """Cost added for gains whose loop has Ms above 2; 1 if the loop is unstable.

        A law that is not linear is linearized at rest without an error.
        """
        price = 0.0
        for _, _, plant, _ in self._states:
            loop = self._open(gains, plant, self.machine.stuck())
            largest = float(np.abs(1 / (1 + response_of(loop, SENSITIVITY_POINTS)[1])).max())
            excess = OVER_LIMIT * max(0.0, largest / MOST_SENSITIVE - 1)
            price += min(1.0, excess) if is_stable(loop) else 1.0
        return price

    def margins(self, gains: Mapping[str, float]) -> tuple[tuple[Margins, ...], tuple[str, ...]]:
        """Margins of the loop, stuck and sliding, and reasons for missing ones."""
        part = self.loop.controller
        if reason := self._not_linear:
            return (), (f"{part}: no margins, {reason}",)
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

    @property
    def _not_linear(self) -> str:
        """Why the controller has no linear part; empty if it has one."""
        part = self.loop.controller
        return (
            NOT_LINEAR.get(bare(part.name), "") if part.has_equations else "an FMU has no equations"
        )

    @cached_property
    def _states(self) -> list[tuple[str, float, Linear, dict[str, float]]]:
        """Points of linearization: name, speed, linear plant, and its states."""
        machine = self.machine
        if self._not_linear:
            return []
        at = {"stuck": (0.0, machine.stuck())} if not machine.plant.kernel.modes else {}
        at["sliding"] = (machine.speed, machine.sliding(machine.speed))
        return [(s, v, machine.linear(self._seen, own), own) for s, (v, own) in at.items()]

    def _followed(
        self, gains: Mapping[str, float], speed: float, plant: Mapping[str, float]
    ) -> dict[str, float] | None:
        """States and inputs when the loop follows a ramp steadily; None if it does not."""
        model = self.model(gains)
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

    @cached_property
    def _seen(self) -> tuple[str, ...]:
        """The machine's outputs that the controller measures."""
        used = {str(s) for s in component(self.loop.controller.name).used_symbols()}
        return tuple(n for n in self.machine.outputs if n in used)

    @cached_property
    def _law(self) -> Kernel:
        return linear_kernel(self.loop.controller, self._seen, ("u",))

    def _open(self, gains: Mapping[str, float], plant: Linear, at: Mapping[str, float]) -> Any:
        count = len(self.loop.controller.kernel.discrete)
        values = self.values(gains)
        law = linearized(self._law, self._seen, ("u",), values, at, sampled=count)
        return open_loop(plant, law, self.model(gains).sample_time)

"""Tune one controller for one machine: a study of one controller, with margins.

The search, the price of a run and the loop are those of a study; an error as large as with modest
gains has the price 1. A sensitivity above 2, the limit for a robust loop, adds to the cost
(K. J. Astrom and T. Hagglund, "Advanced PID Control", ISA (2006), section 4.6). See
``docs/howto/tune.md``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers import CONTROLLERS, tunable
from ...controllers import margins as stability
from ...fmus.units import base_exponents
from ...solver.errors import BadParameter
from ...solver.files import write_json
from ...solver.kernel import CONTROLLER, Model
from ..loop.catalogue import component
from ..loop.loop import Loop, of_side
from ..loop.machine import Machine, gain_ranges, linearized, model_values
from ..loop.reference_motions import as_reference
from ..loop.whole_loop import follow, loop_kernel
from ..master.reference_signal import Reference
from .plan import Duty, Entrant, Plan, Tuning
from .run import STEP, Course, Figures, FmuLoop, StudyLoop
from .tuning import OVER_LIMIT, Contender, Gains, Tuned, tune

TIGHTER = 1e-8  # tolerance of the solver in another run, which should agree
AGREE = 0.01  # share of the rms error
REST = 0.5  # s, after the end of a motion
MOST_SENSITIVE = 2.0  # Ms
SENSITIVITY_POINTS = 300  # of the frequency response of a candidate
MORE = 0.1  # share of the cost: a larger gain by twice the budget is reported
SLIDE = 2.0  # s, until a loop slides steadily
NOT_LINEAR = ("relay", "fuzzy_pd_i", "sliding_mode", "super_twisting", "adaptive_friction")
_FIGURES = (
    "peak_command rms_error peak_error reversal_error overshoot settling_2pct steady_error "
    "saturated_share hunting_amplitude failed"
).split()


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
class MotionRun:
    """A motion under the tuned gains."""

    duty: Duty
    course: Course
    figures: Figures
    converged: bool  # whether a hundredth of the tolerance gives the same rms error within 1 %


@dataclass(frozen=True, repr=False)
class TunedController:
    """Gains of one controller for one machine, and what they achieve."""

    loop: Loop  # with the gains; its set-point is the judging motion
    plan: Plan  # its study of one controller, with the limit, budget and seed
    tuned: Tuned
    gains: tuple[Gain, ...]
    motions: tuple[MotionRun, ...]  # the judging motion is the last
    margins: tuple[stability.Margins, ...]  # of the loop linearized stuck and sliding
    no_margins: tuple[str, ...]  # why margins are missing

    @property
    def limit(self) -> float:
        """Largest command that the machine gives, in the unit of the plan's command."""
        return self.plan.command_limit or math.inf

    def doubts(self) -> list[str]:
        """What weakens it; empty if nothing does."""
        found = []
        for m in self.motions:
            name, share = m.duty.name, m.figures.saturated_share
            if m.figures.failed:
                found.append(f"the {name} could not be run to its end")
            elif not m.converged:
                found.append(f"the run of the {name} is not converged")
            if m.figures.peak_command > self.limit * (1 + 1e-9):
                found.append(f"the {name} demands more than the limit")
            elif share > 0:
                found.append(f"the command is at its limit for {100 * share:.2g} % of the {name}")
        for loop in self.margins:
            if not loop.stable:
                found.append(f"unstable while {loop.state}")
            elif loop.sensitivity > MOST_SENSITIVE * (1 + AGREE):
                found.append(f"Ms is more than {MOST_SENSITIVE:g} while {loop.state}")
        found += [f"{g.name} is at the {g.at_end} end of its range" for g in self.gains if g.at_end]
        doubled, cost = self.tuned.doubled_cost, self.tuned.cost
        if doubled < (1 - MORE) * cost:
            found.append(f"twice the budget would gain {100 * (1 - doubled / cost):.0f} %")
        return found

    @property
    def trusted(self) -> bool:
        """Whether all runs converged, and the linearized loops are stable."""
        runs = all(m.converged and not m.figures.failed for m in self.motions)
        return runs and all(m.stable for m in self.margins)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``tuning.json``."""
        tuned, curves = self.tuned, ("frequency", "response")
        motions = []
        for m in self.motions:
            about = {"name": m.duty.name, "reference": m.duty.reference, "tuned_on": m.duty.tune}
            figures = {name: getattr(m.figures, name) for name in _FIGURES}
            motions.append({**about, "converged": m.converged, **figures})
        return {
            "controller": self.loop.controller.label,
            "plant": self.loop.plant.label,
            "limit": self.limit,
            "command_unit": self.plan.command_unit,
            "start_cost": tuned.published_cost,
            "cost": tuned.cost,
            "doubled_cost": tuned.doubled_cost,
            "budget": self.plan.tuning.budget,
            "seed": self.plan.seed,
            "gains": [asdict(g) for g in self.gains],
            "set": [f"controller.{g.name}={g.value!r}" for g in self.gains],
            "motions": motions,
            "loops": [{n: v for n, v in vars(m).items() if n not in curves} for m in self.margins],
            "no_margins": list(self.no_margins),
            "weaknesses": self.doubts(),
        }

    def write(self, folder: Path) -> None:
        """Write ``tuning.json``, and ``parameters.toml`` with the gains for the next command."""
        write_json(folder / "tuning.json", self.to_dict())
        file, label = self.loop.parameters(), self.loop.controller.label
        values = dict(file.controllers[label])
        for g in self.gains:
            values[g.name] = replace(values[g.name], source="tuned for this machine")
        replace(file, controllers={**file.controllers, label: values}).save(folder)


def tune_loop(
    loop: Loop,
    reference: str | None = None,
    stop: float | None = None,
    limit: float | None = None,
    budget: int = 100,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> TunedController:
    """Find the gains of a loop's controller for its plant; see `ballscrew.tune`.

    The controller's gains are one of the two starting points; its other values stay. The motion for
    the tuning is `reference` for `stop` seconds, else a step and a reversing move that the limit
    allows. `budget` candidates are for the result, as many again show what more would gain.
    `progress` gets the number of finished candidates and that of all.

    Raises `BadParameter` if the controller has no ranges for its gains, or the machine has no
    limit; `CouplingError`, `FmuError`, `ContractError` if the parts do not fit.
    """
    part = loop.controller
    if not loop.plant.has_equations:
        raise BadParameter(f"{loop.plant} has no equations; tuning needs a plant with equations")
    loop.check_values()
    machine = Machine.of(loop.plant, loop.plant_values, limit)
    ranges, modest = gain_ranges(part, machine)
    if not ranges:
        raise BadParameter(
            f"{part} has no gains to tune: no parameter with a minimum and a maximum; "
            f"controllers with gains are {', '.join(n for n in CONTROLLERS if tunable(n))}"
        )
    known, given = part.parameters, loop.controller_values
    fixed = model_values(part, machine) | {n: v for n, v in given.items() if n not in ranges}

    def every(gains: Gains) -> dict[str, float]:
        """All values of the controller with these gains."""
        return {**_tracking(loop, gains), **fixed, **gains}

    limits = {"saturated_share": 0.0, "peak_command": machine.limit}
    plan = _plan(loop, machine, reference, stop)
    plan = replace(plan, tuning=Tuning(budget, 0, 1, limits), seed=seed)
    own = StudyLoop(loop_kernel(plan.plant, part.name)) if part.has_equations else FmuLoop(loop)
    contender = Contender(plan, plan.entrants[0], own)
    contender.check_plants()
    linear = _Linearized(contender, loop, machine)
    sizes = {d.name: _size(contender, every(modest), d) for d in plan.tuning_duties}
    done = 0

    def cost(gains: Gains) -> float:
        nonlocal done
        done += 1
        if progress:
            progress(min(done, 2 * budget + 2), 2 * budget + 2)
        return contender.cost(every(gains), sizes) + linear.fragility(every(gains))

    start = {n: given.get(n, known[n].default) for n in ranges}
    start = min(start, modest, key=cost)
    tuned = tune(cost, start, ranges, budget, seed)
    best = every(tuned.values)
    judging, length = plan.duties[-1].motion
    result = replace(loop, reference=judging, stop=length, controller_values={**given, **best})
    result = replace(result, plant_values=dict(machine.values))
    gains = []
    for n, value in tuned.values.items():
        low, high = ranges[n]
        near = "low" if value - low < high - value else "high"
        end = near if n in tuned.at_bound else ""
        gains.append(Gain(n, value, start[n], known[n].unit, low, high, end))
    motions = tuple(_shown(contender, best, duty) for duty in plan.duties)
    return TunedController(result, plan, tuned, tuple(gains), motions, *linear.margins(best))


def _plan(loop: Loop, machine: Machine, reference: str | None, stop: float | None) -> Plan:
    """A study of one controller on the nominal plant, judged on another motion."""
    step, move, judge = machine.motions()
    motions = {"step": step, "move": move} if reference is None else {"motion": reference}
    duties = []
    for name, text in {**motions, "judging move": judge}.items():
        end = float(as_reference(text).times[-1]) + REST
        length = stop if name in motions and stop is not None else end
        duties.append(Duty(name, text, length, name in motions, machine.values))
    entrant = Entrant(loop.controller.label, loop.controller.name)
    plan = Plan(loop.plant.name, (entrant,), tuple(duties), plants=0, period=0.0)
    return replace(plan, command_limit=machine.limit)


def _size(contender: Contender, modest: Gains, duty: Duty) -> float:
    """The rms error with modest gains [m], for which the price is 1."""
    error = contender.run(modest, duty, (), 0)[1].rms_error
    return error if error > 0 else float(np.abs(duty.motion[0].values).max()) or 1.0


def _shown(contender: Contender, gains: Gains, duty: Duty) -> MotionRun:
    course, figures = contender.run(gains, duty, (), 0)
    tighter = replace(contender, plan=replace(contender.plan, tolerance=TIGHTER))
    other = tighter.run(gains, duty, (), 0)[1].rms_error
    return MotionRun(duty, course, figures, abs(figures.rms_error - other) <= AGREE * other)


def _tracking(loop: Loop, gains: Gains) -> dict[str, float]:
    """The tracking time of the anti-windup: the integral time that follows from the gains."""
    known = loop.controller.parameters
    if loop.controller.bare not in CONTROLLERS or "Tt" not in known or "Ki" not in gains:
        return {}
    wanted = base_exponents(f"{known['Ki'].unit}*s")
    of_gains = (v for n, v in gains.items() if base_exponents(known[n].unit) == wanted)
    time = next(of_gains, math.nan) / max(gains["Ki"], 1e-12)
    return {} if math.isnan(time) else {"Tt": float(np.clip(time, STEP, known["Tt"].maximum))}


class _Linearized:
    """The loop of a controller and a machine, linearized stuck and sliding, with any gains."""

    def __init__(self, contender: Contender, loop: Loop, machine: Machine) -> None:
        self.contender, self.part, self.machine = contender, loop.controller, machine
        self.states: list[tuple[str, float, stability.Linear, dict[str, float]]] = []
        self.missing = ""
        if not isinstance(contender.loop, StudyLoop):
            self.missing = "an FMU has no equations"
            return
        if self.part.bare in NOT_LINEAR:
            self.missing = "it switches or adapts, and has no slope at the set-point"
            return
        self.kernel = contender.loop.kernel
        used = {str(s) for s in component(self.part.name).used_symbols()}
        self.seen = tuple(n for n in machine.outputs if n in used)
        at = {} if machine.plant.kernel.modes else {"stuck": (0.0, machine.stuck())}
        at["sliding"] = (machine.speed, machine.sliding(machine.speed))
        for name, (speed, own) in at.items():
            self.states.append((name, speed, machine.linear(self.seen, own), own))

    def fragility(self, gains: Gains) -> float:
        """Cost added if the loop has Ms above 2; 1 if it is unstable.

        A law that is not linear is linearized at rest without an error.
        """
        paid = 0.0
        for _, _, plant, _ in self.states:
            loop = self._open(gains, plant, self.machine.stuck())
            _, response = stability.response_of(loop, SENSITIVITY_POINTS)
            largest = float(np.abs(1 / (1 + response)).max())
            excess = OVER_LIMIT * max(0.0, largest / MOST_SENSITIVE - 1)
            paid += min(1.0, excess) if stability.is_stable(loop) else 1.0
        return paid

    def margins(self, gains: Gains) -> tuple[tuple[stability.Margins, ...], tuple[str, ...]]:
        """Margins of the loop, stuck and sliding, and reasons for missing ones."""
        if self.missing:
            return (), (f"{self.part}: no margins, {self.missing}",)
        found, without = [], []
        if self.machine.plant.kernel.modes:
            without.append("stuck: this friction law has no bristles, so the body does not move")
        for state, speed, plant, own in self.states:
            at = self._followed(gains, speed, own) if speed else own
            if at is None:
                without.append(f"sliding at {speed:g} m/s: there is no steady sliding of the loop")
            else:
                found.append(stability.margins_of(self._open(gains, plant, at), state, speed))
        return tuple(found), tuple(without)

    def _followed(
        self, gains: Gains, speed: float, plant: Mapping[str, float]
    ) -> dict[str, float] | None:
        """States and inputs when the loop follows a ramp steadily; None if it does not."""
        model = self._model(gains)
        ramp = Reference.of_pieces([0.0, 2 * SLIDE], [[0.0, speed], [2 * SLIDE * speed, 0.0]])
        step = model.sample_time or STEP
        y, stopped = follow(model, ramp, np.arange(round(SLIDE / step) + 1, dtype=float) * step)
        if stopped or abs(y["v"][-1] / speed - 1) > AGREE:
            return None
        kernel, first = model.kernel, len(model.kernel.inputs)
        names = [s.name for s in (*kernel.states, *kernel.discrete)]
        all_of = dict(zip(names, [*model.x, *model.u[first:]], strict=False))
        own = of_side(CONTROLLER, all_of)
        return {**plant, **own, "x": float(y["x"][-1]), "x_d": SLIDE * speed, "v_d": speed}

    def _model(self, gains: Gains) -> Model:
        c = self.contender
        values = c.values(gains, c.plan.duties[-1], (), 0)
        return Model(self.kernel, values, c.plan.tolerance)

    def _open(self, gains: Gains, plant: stability.Linear, at: Mapping[str, float]) -> Any:
        law = linearized(self.part, self.seen, ("u",), gains, at)
        return stability.open_loop(plant, law, self._model(gains).sample_time)

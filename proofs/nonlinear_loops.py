"""Random loops that stick and slip, hit stops, switch, or are sampled, cut into two parts.

The verdict is tested on them and on linear loops; they are independent of the ball screw. A mass
has stick-slip friction or bounces between stops, with or without excitation, a fast drive, and
friction compensation by the controller. The controller is continuous, a relay, or sampled, with or
without a quantizer. The truth is the solution of both components as one system of equations, with
two tolerances. If the two solutions differ, the truth is not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import sympy as sp

from ballscrew.fmus.feedback_law import STEP_START, accept_law, report_law
from ballscrew.orchestration.fmu.fmu_instance import StepFailed
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    DiscreteState,
    Event,
    ForceBalance,
    ForceTerm,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.core import DONE
from ballscrew.solver.interconnect import connect
from ballscrew.solver.kernel import (
    CONTROLLER,
    MAX_STEPS,
    PLANT,
    IntegrationError,
    Kernel,
    Model,
    describe_failure,
)

Vector = np.ndarray

FAMILIES = ("stick-slip", "impacts", "relays", "sampled")
WITHIN = 1e-10  # tolerance of the parts, so that errors of a run are coupling errors
TRUE, TRUER = 1e-11, 1e-12
KNOWN = 1e-2  # largest difference of the two references, over the tolerance
FEWEST, MOST = 20, 3000  # communication steps
OUTPUTS = ("x", "v")
ROUND_OFF = 1e-9

x, v, u, q, goal = (symbol(name) for name in ("x", "v", "u", "q", "x_d"))


class ModelInstance:
    """A component's model for the master; its own solution is exact up to `WITHIN`.

    Parameters
    ----------
    name : str
    kernel : Kernel
    values : mapping of str to float
        Parameters and initial states.
    can_save : bool
    answers_in_step : bool
        Whether outputs are those at the start of the last step, as in FMUs that compute them there.
    """

    def __init__(
        self,
        name: str,
        kernel: Kernel,
        values: Mapping[str, float],
        can_save: bool = True,
        answers_in_step: bool = False,
    ) -> None:
        self.name, self.can_save, self.answers_in_step = name, can_save, answers_in_step
        self._kernel, self._values = kernel, dict(values)
        self._places = {i.name: k for k, i in enumerate(kernel.inputs)}
        self._rows = {o.name: k for k, o in enumerate(kernel.outputs)}
        self.inputs: Sequence[str] = [i.name for i in kernel.inputs if i.role != "internal"]
        self.outputs: Sequence[str] = list(self._rows)
        self.sample_time = 0.0

    def nominal(self, name: str) -> float:
        return 1.0

    def is_real(self, name: str) -> bool:
        return True

    def follows_at_once(self, name: str) -> bool:
        return not self.answers_in_step

    def initially_from(self, name: str) -> Sequence[str]:
        return self.inputs

    def leave_initialization(self) -> None:
        pass

    def enter_initialization(self, values: Mapping[str, float], stop: float) -> None:
        self._model = Model(self._kernel, {**self._values, **values}, WITHIN)
        self.sample_time = self._model.sample_time
        self._now, self._samples = 0.0, 0
        self._y = np.zeros(len(self._kernel.outputs))
        model = self._model
        kept = (model.x, model.u, model.p, self._y, model.atol, model.info)
        self._bound = model.system.instance(*kept)
        model.settle(0.0)
        self._bound.out(0.0)

    def writer(self, names: Sequence[str]) -> Any:
        places = [self._places[n] for n in names]

        def write(values: Vector) -> None:
            self._model.u[places] = values

        return write

    def reader(self, names: Sequence[str]) -> Any:
        rows = [self._rows[n] for n in names]

        def read() -> Vector:
            if not self.answers_in_step:
                self._bound.out(self._now)
            return self._y[rows]

        return read

    def step(self, t: float, h: float) -> None:
        model = self._model
        if STEP_START in self._places:
            model.set_input(STEP_START, t)
        if self.answers_in_step:
            self._bound.out(t)
        if self.sample_time > 0 and t > (self._samples - ROUND_OFF) * self.sample_time:
            model.sample(t)
            self._samples += 1
        if len(model.x):
            status = self._bound.advance(t, t + h, WITHIN, MAX_STEPS)
            if status != DONE:
                why = describe_failure(self.name, status, model.info, t + h)
                raise StepFailed(why)
        self._now = t + h

    def save(self) -> Any:
        model = self._model
        parts = (model.x, model.u, model.info, self._y)
        return tuple(part.copy() for part in parts), self._now, self._samples

    def restore(self, state: Any) -> None:
        model = self._model
        parts, self._now, self._samples = state
        for kept, part in zip((model.x, model.u, model.info, self._y), parts, strict=True):
            kept[:] = part

    def release(self, state: Any) -> None:
        pass

    def reopened(self) -> ModelInstance:
        return ModelInstance(
            self.name, self._kernel, self._values, self.can_save, self.answers_in_step
        )

    def close(self) -> None:
        pass


# -- components -----------------------------------------------------------------------------------


def _parameters(**defaults: float) -> tuple[Parameter, ...]:
    return tuple(Parameter(n, d, "1", n, "drawn") for n, d in defaults.items())


def _mass(friction: bool, driven: bool) -> Component:
    """An excited mass on a spring with viscous friction; `driven`: behind a drive with a lag."""
    names = ("m", "k", "c", "shake", "shake_w", *(("lag",) if driven else ()))
    shaken = symbol("shake") * sp.sin(symbol("shake_w") * TIME)
    damping = 0 if friction else symbol("c") * v
    force = (q if driven else u) + shaken - symbol("k") * x - damping
    terms = ForceTerm("applied", force, "all but dry friction"), *((classical(v),) * friction)
    drive = (State("q", "N", "force of the drive", (u - q) / symbol("lag")),) if driven else ()
    return Component(
        f"{'rubbing' if friction else 'free'}{'_driven' if driven else ''}",
        "a mass on a spring",
        parameters=_parameters(**{n: 1.0 for n in names if not (friction and n == "c")}),
        inputs=(Input("u", "N", "command", law=OUTPUTS),),
        states=(State("x", "m", "position", v), State("v", "m/s", "velocity"), *drive),
        outputs=(Output("x", "m", "position", x), Output("v", "m/s", "velocity", v)),
        balances=(ForceBalance("v", symbol("m"), terms),),
    )


def _sticking(driven: bool) -> Component:
    """The mass with friction; friction and `stuck`, which jump with each mode, are not outputs."""
    whole = with_sticking(_mass(True, driven))
    (balance,) = whole.balances
    terms = tuple(
        ForceTerm(t.name, t.force, t.meaning, t.states, t.parameters) for t in balance.terms
    )
    modes = tuple(Mode(m.name, m.derivatives, {}, m.events) for m in whole.modes)
    return whole.substituted(
        {}, balances=(ForceBalance(balance.state, balance.inertia, terms),), modes=modes
    )


def _between_stops(driven: bool) -> Component:
    """The mass between two stops; if it rebounds slower than `slow`, it rests at the stop."""
    free = _mass(False, driven)
    gap, slow = symbol("gap"), symbol("slow")
    back = -symbol("restitution") * v
    kept = sp.Piecewise((back, sp.Abs(back) > slow), (0, True))
    force = free.balances[0].terms[0].force.xreplace({v: sp.Integer(0)})
    modes = [
        Mode(
            "free",
            events=tuple(
                Event(
                    f"hits_{name}",
                    x - side * gap,
                    direction=side,
                    reset={"x": side * gap, "v": kept},
                    next_mode=name,
                )
                for name, side in (("upper", 1), ("lower", -1))
            ),
        )
    ]
    for name, side in (("upper", 1), ("lower", -1)):
        events = (
            Event("rebounds", v, direction=-side, next_mode="free"),
            Event("is_pulled_off", force, direction=-side, next_mode="free"),
        )
        at_rest = {"x": sp.Integer(0), "v": sp.Integer(0)}
        modes.append(Mode(name, derivatives=at_rest, events=events))
    more = _parameters(gap=1.0, slow=1e-3, restitution=0.5)
    return free.substituted(
        {},
        name="between_stops" + driven * "_driven",
        parameters=free.parameters + more,
        modes=tuple(modes),
    )


def _inputs(*measured: str) -> tuple[Input, ...]:
    signals = tuple(Input(n, "1", "measured", role="measurement") for n in measured)
    return (*signals, Input("x_d", "m", "set-point", role="reference"))


def _pid(filtered: bool) -> Component:
    """A PID with a measured velocity, or with the filtered difference of the position."""
    speed = (x - symbol("d")) / symbol("filter") if filtered else v
    slow = (State("d", "m", "filtered position", speed),) if filtered else ()
    gains = _parameters(Kp=1.0, Ki=0.0, Kd=1.0, **({"filter": 1.0} if filtered else {}))
    command = symbol("Kp") * (goal - x) + symbol("Ki") * symbol("w") - symbol("Kd") * speed
    return Component(
        "pid_filtered" if filtered else "pid",
        "PID",
        parameters=gains,
        inputs=_inputs(*(OUTPUTS[:1] if filtered else OUTPUTS)),
        states=(State("w", "m*s", "integral", goal - x), *slow),
        outputs=(Output("u", "N", "command", command),),
    )


def _relay(rests: bool) -> Component:
    """Full force in one of both directions, switched with hysteresis; or zero in a dead zone."""
    seen = goal - x - symbol("lead") * v
    width, level, zone = symbol("width"), symbol("level"), symbol("zone")

    def mode(name: str, force: sp.Expr, *events: tuple[sp.Expr, int, str]) -> Mode:
        left = tuple(
            Event(f"{name}_{to}", at, direction=way, next_mode=to) for at, way, to in events
        )
        return Mode(name, outputs={"u": force}, events=left)

    modes: tuple[Mode, ...] = (
        mode("push", level, (seen + width, -1, "pull")),
        mode("pull", -level, (seen - width, 1, "push")),
    )
    if rests:
        modes = (
            mode("rest", sp.Integer(0), (seen - zone - width, 1, "push"),
                 (seen + zone + width, -1, "pull")),
            mode("push", level, (seen - zone, -1, "rest")),
            mode("pull", -level, (seen + zone, 1, "rest")),
        )  # fmt: skip
    return Component(
        "relay_resting" if rests else "relay",
        "a relay with hysteresis",
        parameters=_parameters(level=1.0, lead=0.1, width=0.1, **({"zone": 0.1} if rests else {})),
        inputs=_inputs(*OUTPUTS),
        states=(State("n", "1", "no state that matters", sp.Integer(0)),),
        outputs=(Output("u", "N", "command", level),),
        modes=modes,
    )


def _sampled(quantized: bool) -> Component:
    """A PID with the backward difference of the position; PI and PD have gains of zero."""
    period = symbol("sample_time")
    seen = sp.floor(x / symbol("count") + sp.Rational(1, 2)) * symbol("count") if quantized else x
    total = symbol("w") + period * (goal - seen)
    speed = (seen - symbol("x_last")) / period
    command = symbol("Kp") * (goal - seen) + symbol("Ki") * total - symbol("Kd") * speed
    return Component(
        "sampled_counting" if quantized else "sampled",
        "a digital PID",
        parameters=_parameters(Kp=1.0, Ki=0.0, Kd=1.0, **({"count": 1e-3} if quantized else {})),
        inputs=_inputs("x"),
        discrete=(
            DiscreteState("w", "m*s", "sum", total),
            DiscreteState("x_last", "m", "last position", seen),
            DiscreteState("u_held", "N", "command", command),
        ),
        outputs=(Output("u", "N", "command", symbol("u_held")),),
        sample_time=Parameter("sample_time", 1e-3, "s", "period", "drawn", minimum=1e-9),
    )


_PLANTS = {"linear": lambda d: _mass(False, d), "sticking": _sticking, "stops": _between_stops}
_CONTROLLERS = {"pid": _pid, "relay": _relay, "sampled": _sampled}


@dataclass(frozen=True)
class Structure:
    """The equations of a loop; its parameters are drawn separately.

    ``variant`` is that of the controller: filtered, resting, or quantized.
    """

    plant: str
    driven: bool
    controller: str
    variant: bool

    def parts(self) -> tuple[Component, Component]:
        return _PLANTS[self.plant](self.driven), _CONTROLLERS[self.controller](self.variant)


@cache
def _plant_kernel(plant: str, driven: bool, lawful: bool) -> Kernel:
    component = _PLANTS[plant](driven)
    return generate(accept_law(component) if lawful else component)


@cache
def _controller_kernel(controller: str, variant: bool, reports: bool) -> Kernel:
    component = _CONTROLLERS[controller](variant)
    return generate(report_law(component) if reports else component)


@cache
def _whole_kernel(structure: Structure) -> Kernel:
    return generate(connect(*structure.parts()))


# -- cases ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A loop with its parameters and its coupling."""

    family: str
    structure: Structure
    plant: ModelInstance
    controller: ModelInstance
    plant_values: dict[str, float]
    controller_values: dict[str, float]
    goal: float
    stop: float
    step: float
    coupling: Coupling

    def exact(self, times: Vector, tolerance: float) -> Vector:
        """Plant outputs by one solver, shape (k, n).

        Raises
        ------
        IntegrationError
        """
        kernel = _whole_kernel(self.structure)
        values = {PLANT + n: value for n, value in self.plant_values.items()}
        values |= {CONTROLLER + n: value for n, value in self.controller_values.items()}
        model = Model(kernel, values, tolerance)
        model.set_input("x_d", self.goal)
        model.settle(0.0)
        rows = [[o.name for o in kernel.outputs].index(n) for n in OUTPUTS]
        table, period = np.empty((len(times), len(kernel.outputs))), model.sample_time
        for k, t in enumerate(times):
            if k:
                model.advance(times[k - 1], t)
            model.system.out(t, model.x, model.u, model.p, table[k])
            if period > 0 and abs(t / period - round(t / period)) < 1e-6:
                model.sample(t)
        return table[:, rows]


def random_case(seed: int) -> Case:  # noqa: PLR0915
    """Draw a loop of the family `seed` modulo four, and a step that may be far too long."""
    random = np.random.default_rng([seed, 4])
    family = FAMILIES[seed % len(FAMILIES)]

    def spread(low: float, high: float) -> float:
        """Random number, logarithmically uniform between two powers of ten."""
        return float(10.0 ** random.uniform(low, high))

    plant, controller = {
        "stick-slip": ("sticking", "pid"),
        "impacts": ("stops", "pid"),
        "relays": (str(random.choice(["linear", "sticking"])), "relay"),
        "sampled": (str(random.choice(["linear", "sticking"])), "sampled"),
    }[family]
    driven, variant = bool(random.random() < 0.5), bool(random.random() < 0.4)
    structure = Structure(plant, driven, controller, variant)
    mass, w, goal_ = spread(-1, 1), spread(0, 1), float(random.choice([0.0, 0.5, 1.0]))
    stiffness = mass * w**2
    ours = {"m": mass, "k": stiffness * random.choice([0.0, 0.1, 1.0])}
    ours |= {"shake": stiffness * random.choice([0.0, 0.3, 1.0]), "shake_w": w * spread(-0.7, 0.3)}
    viscous = mass * w * spread(-2, 3 if controller == "pid" else 0)
    if driven:
        ours["lag"] = spread(-3.5, -1.0) / w
    if plant == "sticking":
        coulomb = stiffness * spread(-1.5, -0.3)
        ours |= {"sigma2": viscous, "Fc": coulomb, "Fs": coulomb * random.uniform(1.0, 1.8)}
        ours["Vs"] = w * spread(-2.5, -0.5)
    else:
        ours["c"] = viscous
    if plant == "stops":
        ours |= {"gap": random.uniform(0.3, 0.9), "restitution": random.uniform(0.1, 0.9)}
        ours["slow"] = 1e-3 * w
    # the controller compensates most of the friction, as linearizing controllers do
    share = float(random.choice([1.0, 0.99, 0.9, 0.0])) if controller == "pid" else 0.0
    gains = {"Kp": stiffness * spread(-0.5, 0.5)}
    gains["Ki"] = float(random.choice([0.0, 0.1, 0.4])) * gains["Kp"] * w
    gains["Kd"] = 2 * random.uniform(0.2, 1.2) * mass * w - share * viscous
    speed = max(
        w, viscous / mass, abs(gains["Kd"]) / mass, *(1 / ours[n] for n in ("lag",) if driven)
    )
    stop = random.uniform(2, 6) / w
    theirs = dict(gains)
    if controller == "pid" and variant:
        theirs["filter"] = spread(-2.5, -0.7) / w
        theirs["Kd"] = 2 * random.uniform(0.2, 1.2) * mass * w
        speed = max(speed, 1 / theirs["filter"])
    if controller == "relay":
        theirs = {"level": stiffness * spread(-0.3, 0.5), "lead": spread(-1.5, -0.2) / w}
        theirs["width"] = spread(-2.5, -0.7)
        theirs |= {"zone": spread(-2, -0.5)} if variant else {}
    if controller == "sampled":
        theirs["sample_time"] = spread(-2.3, -0.5) / w
        theirs |= {"count": spread(-5, -1.5)} if variant else {}
    steps = float(np.clip(stop * speed * 10.0 ** random.uniform(-1.0, 3.0), FEWEST, MOST))
    step = stop / math.ceil(steps)
    ours |= {"x_start": random.uniform(-0.25, 0.25), "v_start": w * random.uniform(-0.3, 0.3)}
    lawful = bool(random.random() < 0.6)
    known = [
        Coupling.JACOBI,
        *([Coupling.GAUSS_SEIDEL] * 2),
        *([Coupling.INTERFACE_JACOBIAN] * 4 if lawful else []),
    ]
    coupling = known[random.integers(len(known))]
    can_save = bool(random.random() < 0.8)
    plant_saves = can_save or bool(random.random() < 0.5)
    reports = bool(random.random() < 0.5) and controller == "pid"
    late = bool(random.random() < 0.2) and controller == "pid" and not reports
    return Case(
        family,
        structure,
        ModelInstance("plant", _plant_kernel(plant, driven, lawful), ours, plant_saves),
        ModelInstance(
            "controller",
            _controller_kernel(controller, variant, reports and lawful),
            theirs,
            can_save,
            late,
        ),
        ours,
        theirs,
        goal_,
        stop,
        step,
        coupling,
    )


@dataclass(frozen=True)
class Outcome:
    """Verdict of the run and the truth.

    Attributes
    ----------
    error : float
        Largest error of any output as a share of its range; not finite if the run ended early.
    doubt : float
        Difference of the two references, in the same way; if it is more than `KNOWN` times the
        tolerance, the truth is not known.
    """

    seed: int
    family: str
    trusted: bool
    error: float
    doubt: float
    coupling: str
    contraction: float
    reason: str = field(compare=False)


def outcome(seed: int) -> Outcome:
    """Run one case and compare with the two references."""
    case = random_case(seed)
    with np.errstate(all="ignore"):
        goal = Reference.constant(case.goal)
        sides = Sides(case.plant, case.controller, goal, case.stop, case.coupling)
        run = run_loop(sides, case.step)
        table = np.column_stack([run.outputs[n] for n in OUTPUTS])
        try:
            exact, other = (case.exact(run.time, tolerance) for tolerance in (TRUER, TRUE))
        except IntegrationError:
            exact, other = np.zeros_like(table), np.full_like(table, np.inf)
    scale = np.maximum(np.ptp(exact, axis=0), 1e-9)
    doubt = float(np.max(np.abs(exact - other).max(axis=0) / scale))
    error = float(np.max(np.abs(table - exact).max(axis=0) / scale))
    return Outcome(
        seed,
        case.family,
        run.verdict.trusted,
        error if math.isfinite(error) and not run.stopped else math.inf,
        doubt,
        case.coupling.value,
        run.verdict.contraction,
        run.verdict.reason,
    )

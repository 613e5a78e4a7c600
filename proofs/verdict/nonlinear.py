"""Random loops that stick and slip, hit stops, switch, or are sampled, cut into two parts.

They are independent of the ball screw. A mass has stick-slip friction or bounces between stops,
with or without excitation, a fast drive, and friction compensation by the controller. The
controller is continuous, a relay, or sampled, with or without a quantizer. The truth is the
solution of both components as one system of equations, with two tolerances. If the two solutions
differ, the truth is not known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from runner import Row

import ballscrew as bs
from ballscrew.fmus.feedback_law import accept_law, report_law
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides
from ballscrew.plant.classical import classical, with_sticking
from ballscrew.solver.codegen import generate
from ballscrew.solver.interconnect import connect
from ballscrew.solver.kernel import CONTROLLER, PLANT, IntegrationError, Kernel, Model
from verdict.parts import ComponentSlave, Vector, off, row_of

FAMILIES = ("stick-slip", "impacts", "relays", "sampled")
TRUE, TRUER = 1e-11, 1e-12
FEWEST, MOST = 20, 3000  # communication steps
OUTPUTS = ("x", "v")

x, v, u, q, goal = (bs.symbol(name) for name in ("x", "v", "u", "q", "x_d"))


def _parameters(**defaults: float) -> tuple[bs.Parameter, ...]:
    return tuple(bs.Parameter(n, d, "1", n, "drawn") for n, d in defaults.items())


def mass(driven: bool, rubs: bool = False) -> bs.Component:
    """An excited mass on a spring with viscous friction; `driven`: behind a drive with a lag."""
    names = ("m", "k", *(() if rubs else ("c",)), "shake", "shake_w", *(("lag",) if driven else ()))
    shaken = bs.symbol("shake") * sp.sin(bs.symbol("shake_w") * bs.TIME)
    damping = 0 if rubs else bs.symbol("c") * v
    force = (q if driven else u) + shaken - bs.symbol("k") * x - damping
    terms = bs.ForceTerm("applied", force, "all but dry friction"), *((classical(v),) * rubs)
    states = bs.State("x", "m", "position", v), bs.State("v", "m/s", "velocity")
    drive = bs.State("q", "N", "force of the drive", (u - q) / bs.symbol("lag"))
    return bs.Component(
        f"{'rubbing' if rubs else 'free'}{'_driven' if driven else ''}",
        "a mass on a spring",
        parameters=_parameters(**dict.fromkeys(names, 1.0)),
        inputs=(bs.Input("u", "N", "command", law=OUTPUTS),),
        states=(*states, drive) if driven else states,
        outputs=(bs.Output("x", "m", "position", x), bs.Output("v", "m/s", "velocity", v)),
        balances=(bs.ForceBalance("v", bs.symbol("m"), terms),),
    )


def sticking(driven: bool) -> bs.Component:
    """The mass with friction; friction and `stuck`, which jump with each mode, are not outputs."""
    whole = with_sticking(mass(driven, rubs=True))
    (balance,) = whole.balances
    terms = tuple(replace(t, outputs=()) for t in balance.terms)
    modes = tuple(bs.Mode(m.name, m.derivatives, {}, m.events) for m in whole.modes)
    return whole.substituted({}, balances=(replace(balance, terms=terms),), modes=modes)


def between_stops(driven: bool) -> bs.Component:
    """The mass between two stops; if it rebounds slower than `slow`, it rests at the stop."""
    free = mass(driven)
    gap, back = bs.symbol("gap"), -bs.symbol("restitution") * v
    kept = sp.Piecewise((back, sp.Abs(back) > bs.symbol("slow")), (0, True))
    force = free.balances[0].terms[0].force.xreplace({v: sp.Integer(0)})
    at_rest = {"x": sp.Integer(0), "v": sp.Integer(0)}
    hits, rests = [], []
    for name, side in (("upper", 1), ("lower", -1)):
        reset, left = {"x": side * gap, "v": kept}, {"direction": -side, "next_mode": "free"}
        hit = bs.Event(f"hits_{name}", x - side * gap, direction=side, reset=reset, next_mode=name)
        ends = bs.Event("rebounds", v, **left), bs.Event("is_pulled_off", force, **left)
        hits.append(hit)
        rests.append(bs.Mode(name, derivatives=at_rest, events=ends))
    return free.substituted(
        {},
        name="between_stops" + driven * "_driven",
        parameters=free.parameters + _parameters(gap=1.0, slow=1e-3, restitution=0.5),
        modes=(bs.Mode("free", events=tuple(hits)), *rests),
    )


def _inputs(*measured: str) -> tuple[bs.Input, ...]:
    signals = tuple(bs.Input(n, "1", "measured", role="measurement") for n in measured)
    return (*signals, bs.Input("x_d", "m", "set-point", role="reference"))


def pid(filtered: bool) -> bs.Component:
    """A PID with a measured velocity, or with the filtered difference of the position."""
    speed = (x - bs.symbol("d")) / bs.symbol("filter") if filtered else v
    slow = (bs.State("d", "m", "filtered position", speed),) if filtered else ()
    gains = _parameters(Kp=1.0, Ki=0.0, Kd=1.0, **({"filter": 1.0} if filtered else {}))
    Kp, Ki, Kd, w = (bs.symbol(name) for name in ("Kp", "Ki", "Kd", "w"))
    command = Kp * (goal - x) + Ki * w - Kd * speed
    return bs.Component(
        "pid_filtered" if filtered else "pid",
        "PID",
        parameters=gains,
        inputs=_inputs(*(OUTPUTS[:1] if filtered else OUTPUTS)),
        states=(bs.State("w", "m*s", "integral", goal - x), *slow),
        outputs=(bs.Output("u", "N", "command", command),),
    )


def relay(rests: bool) -> bs.Component:
    """Full force in one of both directions, switched with hysteresis; or zero in a dead zone."""
    seen = goal - x - bs.symbol("lead") * v
    width, level, zone = bs.symbol("width"), bs.symbol("level"), bs.symbol("zone")
    forces = {"rest": sp.Integer(0), "push": level, "pull": -level}
    switches = {  # mode: where it ends, in which direction, and the next one
        "rest": ((seen - zone - width, 1, "push"), (seen + zone + width, -1, "pull")),
        "push": ((seen - zone, -1, "rest"),) if rests else ((seen + width, -1, "pull"),),
        "pull": ((seen + zone, 1, "rest"),) if rests else ((seen - width, 1, "push"),),
    }
    modes = []
    for name in switches if rests else ("push", "pull"):
        ends = switches[name]
        events = (bs.Event(f"{name}_{to}", at, direction=d, next_mode=to) for at, d, to in ends)
        modes.append(bs.Mode(name, outputs={"u": forces[name]}, events=tuple(events)))
    return bs.Component(
        "relay_resting" if rests else "relay",
        "a relay with hysteresis",
        parameters=_parameters(level=1.0, lead=0.1, width=0.1, **({"zone": 0.1} if rests else {})),
        inputs=_inputs(*OUTPUTS),
        states=(bs.State("n", "1", "no state that matters", sp.Integer(0)),),
        outputs=(bs.Output("u", "N", "command", level),),
        modes=tuple(modes),
    )


def sampled(quantized: bool) -> bs.Component:
    """A PID with the backward difference of the position; PI and PD have gains of zero."""
    period = bs.symbol("sample_time")
    seen, count = x, bs.symbol("count")
    if quantized:
        seen = sp.floor(x / count + sp.Rational(1, 2)) * count
    total = bs.symbol("w") + period * (goal - seen)
    speed = (seen - bs.symbol("x_last")) / period
    command = bs.symbol("Kp") * (goal - seen) + bs.symbol("Ki") * total - bs.symbol("Kd") * speed
    last = bs.DiscreteState("x_last", "m", "last position", seen)
    held = bs.DiscreteState("u_held", "N", "command", command)
    return bs.Component(
        "sampled_counting" if quantized else "sampled",
        "a digital PID",
        parameters=_parameters(Kp=1.0, Ki=0.0, Kd=1.0, **({"count": 1e-3} if quantized else {})),
        inputs=_inputs("x"),
        discrete=(bs.DiscreteState("w", "m*s", "sum", total), last, held),
        outputs=(bs.Output("u", "N", "command", bs.symbol("u_held")),),
        sample_time=bs.Parameter("sample_time", 1e-3, "s", "period", "drawn", minimum=1e-9),
    )


PLANTS = {"linear": mass, "sticking": sticking, "stops": between_stops}
CONTROLLERS = {"pid": pid, "relay": relay, "sampled": sampled}  # their variants: see there


@cache
def kernel_of(part: str, variant: bool, law: bool) -> Kernel:
    """A part, with the ports of the feedback law or without."""
    component = (PLANTS | CONTROLLERS)[part](variant)
    with_law = accept_law if part in PLANTS else report_law
    return generate(with_law(component) if law else component)


@cache
def whole_kernel(plant: str, driven: bool, controller: str, variant: bool) -> Kernel:
    return generate(connect(PLANTS[plant](driven), CONTROLLERS[controller](variant)))


def exact(kernel: Kernel, values: dict[str, float], x_d: float, t: Vector, tol: float) -> Vector:
    """Plant outputs of the whole loop by one solver, shape (k, n); raises `IntegrationError`."""
    model = Model(kernel, values, tol)
    model.set_input("x_d", x_d)
    model.settle(0.0)
    samples = t / (model.sample_time or math.inf)
    course = model.simulate(t, sampled=np.abs(samples - np.rint(samples)) < 1e-6)
    return np.column_stack([course.outputs[n] for n in OUTPUTS])


def spread(random: np.random.Generator, low: float, high: float) -> float:
    """Random number, logarithmically uniform between two powers of ten."""
    return float(10.0 ** random.uniform(low, high))


def random_plant(random: Any, kinds: tuple[str, bool, str], m: float, w: float) -> dict[str, float]:
    """Parameters of a plant with a mass and a frequency."""
    plant, driven, controller = kinds
    stiffness = m * w**2
    values = {"m": m, "k": stiffness * random.choice([0.0, 0.1, 1.0])}
    values["shake"] = stiffness * random.choice([0.0, 0.3, 1.0])
    values["shake_w"] = w * spread(random, -0.7, 0.3)
    viscous = m * w * spread(random, -2, 3 if controller == "pid" else 0)
    if driven:
        values["lag"] = spread(random, -3.5, -1.0) / w
    values["sigma2" if plant == "sticking" else "c"] = viscous
    if plant == "sticking":
        coulomb = stiffness * spread(random, -1.5, -0.3)
        values |= {"Fc": coulomb, "Fs": coulomb * random.uniform(1.0, 1.8)}
        values["Vs"] = w * spread(random, -2.5, -0.5)
    if plant == "stops":
        values |= {"gap": random.uniform(0.3, 0.9), "restitution": random.uniform(0.1, 0.9)}
        values["slow"] = 1e-3 * w
    return values


def random_loop(random: Any, family: str) -> tuple[Any, ...]:
    """Kinds, variants and parameters of both parts, set-point, stop time and step."""
    for_relay, for_sampled = (str(random.choice(["linear", "sticking"])) for _ in range(2))
    kinds = {"stick-slip": ("sticking", "pid"), "impacts": ("stops", "pid")}
    kinds |= {"relays": (for_relay, "relay"), "sampled": (for_sampled, "sampled")}
    plant, controller = kinds[family]
    driven, variant = bool(random.random() < 0.5), bool(random.random() < 0.4)
    m, w, x_d = spread(random, -1, 1), spread(random, 0, 1), float(random.choice([0.0, 0.5, 1.0]))
    ours = random_plant(random, (plant, driven, controller), m, w)
    stiffness, viscous = m * w**2, ours["sigma2" if plant == "sticking" else "c"]
    # the controller compensates most of the friction, as linearizing controllers do
    share = float(random.choice([1.0, 0.99, 0.9, 0.0])) if controller == "pid" else 0.0
    theirs = {"Kp": stiffness * spread(random, -0.5, 0.5)}
    theirs["Ki"] = float(random.choice([0.0, 0.1, 0.4])) * theirs["Kp"] * w
    theirs["Kd"] = 2 * random.uniform(0.2, 1.2) * m * w - share * viscous
    speed = max(w, viscous / m, abs(theirs["Kd"]) / m, *(1 / ours[n] for n in ("lag",) if driven))
    stop = random.uniform(2, 6) / w
    if controller == "pid" and variant:
        theirs["filter"] = spread(random, -2.5, -0.7) / w
        theirs["Kd"] = 2 * random.uniform(0.2, 1.2) * m * w
        speed = max(speed, 1 / theirs["filter"])
    if controller == "relay":
        level, lead = stiffness * spread(random, -0.3, 0.5), spread(random, -1.5, -0.2) / w
        theirs = {"level": level, "lead": lead, "width": spread(random, -2.5, -0.7)}
        theirs |= {"zone": spread(random, -2, -0.5)} if variant else {}
    if controller == "sampled":
        theirs["sample_time"] = spread(random, -2.3, -0.5) / w
        theirs |= {"count": spread(random, -5, -1.5)} if variant else {}
    steps = float(np.clip(stop * speed * 10.0 ** random.uniform(-1.0, 3.0), FEWEST, MOST))
    ours |= {"x_start": random.uniform(-0.25, 0.25), "v_start": w * random.uniform(-0.3, 0.3)}
    return (plant, driven), (controller, variant), ours, theirs, x_d, stop, stop / math.ceil(steps)


def outcome(seed: int) -> Row:
    """Draw a loop of the family `seed` modulo four, run it, compare with the two references."""
    random = np.random.default_rng([seed, 4])
    family = FAMILIES[seed % len(FAMILIES)]
    plant, controller, ours, theirs, x_d, stop, step = random_loop(random, family)
    lawful, continuous = bool(random.random() < 0.6), controller[0] == "pid"
    by_law = [Coupling.INTERFACE_JACOBIAN] * 4 if lawful else []
    known = [Coupling.JACOBI, *([Coupling.GAUSS_SEIDEL] * 2), *by_law]
    coupling = known[random.integers(len(known))]
    can_save = bool(random.random() < 0.8)
    plant_saves = can_save or bool(random.random() < 0.5)
    reports = bool(random.random() < 0.5) and continuous
    late = bool(random.random() < 0.2) and continuous and not reports
    kernels = kernel_of(*plant, lawful), kernel_of(*controller, reports and lawful)
    slave = ComponentSlave("plant", kernels[0], ours, plant_saves)
    other = ComponentSlave("controller", kernels[1], theirs, can_save, late)
    values = {PLANT + n: value for n, value in ours.items()}
    values |= {CONTROLLER + n: value for n, value in theirs.items()}
    with np.errstate(all="ignore"):
        run = run_loop(Sides(slave, other, Reference.constant(x_d), stop, coupling), step)
        found = np.column_stack([run.outputs[n] for n in OUTPUTS])
        whole = whole_kernel(*plant, *controller)
        try:
            truer, true = (exact(whole, values, x_d, run.time, tol) for tol in (TRUER, TRUE))
        except IntegrationError:
            truer, true = np.zeros_like(found), np.full_like(found, np.inf)
    error = math.inf if run.stopped else off(found, truer)
    return row_of(seed, run, error, family=family, doubt=off(true, truer))

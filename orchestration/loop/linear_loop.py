"""A loop linearized about a state: its frequency response, margins and sensitivity.

The matrices are the compiled Jacobian of the part's own equations: inputs are held as states, and
outputs are integrated by states, so that one Jacobian gives A, B, C and D. Margins and zero-order
hold are those of python-control (S. Fuller et al., "The Python Control Systems Library", IEEE CDC
(2021)), the library maintained for this since 2009.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...solver.component import Component, Input, Output, State, symbol
from ...solver.for_tangents import dithered_average
from ...solver.interconnect import interconnect
from ...solver.kernel import Kernel, Model
from ...solver.stored import stored_kernel
from .catalogue import component, kept_as

if TYPE_CHECKING:
    from .parts import Part

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Response = npt.NDArray[np.complex128]

LOWEST, HIGHEST, POINTS = 0.1, 1e5, 2000  # of the frequency response [rad/s]
UNSTABLE = 1e-6  # share of the fastest pole: round-off of a pole at the limit of stability


@dataclass(frozen=True)
class Linear:
    """Linear equations of a part: ``dx/dt = a x + b u, y = c x + d u``.

    The last states, `sampled` of them, change only at samples; their rows give the next value.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    sampled: int = 0


@dataclass(frozen=True)
class Margins:
    """A linearized loop, broken at the plant's command."""

    # "stuck": friction is the spring and damper of its bristles; "sliding":
    # a damper, the slope of the friction curve at this speed
    state: str
    speed: float  # [m/s]
    stable: bool  # whether the closed loop is stable
    # factor by which the loop's gain may rise, and to which it may fall; infinite and 0: no limit
    gain_margin: float
    gain_margin_down: float
    gain_frequency: float  # of the gain margin [Hz]; NaN without one
    # [degrees], and the frequency where the loop's gain is 1 [Hz]; NaN if there is none
    phase_margin: float
    crossover: float
    sensitivity: float  # largest ``|1/(1 + L)|``, Ms
    sensitivity_frequency: float  # [Hz]
    frequency: Vector  # shape (m,); [Hz]
    # shape (m,); ``L``, from the plant's command back to it, with the sign of negative feedback
    response: Response


def linear_kernel(part: Part, inputs: Sequence[str], outputs: Sequence[str]) -> Kernel:
    """The equations of a part with inputs held as states and outputs integrated by states."""

    def make() -> Component:
        own = _updates_as_rates(dithered_average(component(part.name)))
        given = {i.name: i for i in own.inputs}
        seen = {o.name: o for o in own.all_outputs}
        held = Component(
            "held",
            "Inputs that stay",
            states=tuple(State(n, given[n].unit, "input", symbol("zero")) for n in inputs),
            inputs=(Input("zero", "1", "nothing"),),
            outputs=tuple(Output(n, given[n].unit, "input", symbol(n)) for n in inputs),
        )
        summed = Component(
            "summed",
            "Integrals of outputs",
            inputs=tuple(Input(n, seen[n].unit, "output") for n in outputs),
            states=tuple(
                State(f"of_{n}", f"{seen[n].unit}*s", "integral", symbol(n)) for n in outputs
            ),
            outputs=tuple(
                Output(f"of_{n}", f"{seen[n].unit}*s", "integral", symbol(f"of_{n}"))
                for n in outputs
            ),
        )
        used = own.used_symbols()
        free = [i for i in own.inputs if i.name not in inputs and symbol(i.name) in used]
        wires = {f".{n}": f"held.{n}" for n in inputs}
        wires |= {f"summed.{n}": f".{n}" for n in outputs}
        wires |= {f".{i.name}": i.name for i in free} | {"held.zero": "zero"}
        parts = {"": own, "held": held, "summed": summed}
        return interconnect(parts, wires, [*free, held.inputs[0]], {}, f"linear_{own.name}")

    name, modules = kept_as(part.name)
    key = "_".join([*inputs, "to", *outputs])
    return stored_kernel(f"linear_{name}_{key}", make, __name__, *modules)


def _updates_as_rates(made: Component) -> Component:
    """A sampled component with each state's next value in place of its rate."""
    if not made.discrete:
        return made
    states = (State(d.name, d.unit, d.meaning, d.update, d.start, d.nominal) for d in made.discrete)
    period = (made.sample_time,) if made.sample_time else ()
    return replace(
        made,
        states=(*made.states, *states),
        discrete=(),
        sample_time=None,
        parameters=(*made.parameters, *period),
    )


def linearized(
    kernel: Kernel,
    inputs: Sequence[str],
    outputs: Sequence[str],
    values: Mapping[str, float],
    at: Mapping[str, float],
    mode: str = "",
    sampled: int = 0,
) -> Linear:
    """The equations of `linear_kernel` about a state, in a `mode` of a part that has modes.

    `values` are parameters, `at` states and inputs of the part, others have their start values;
    `sampled` is the number of the part's discrete states.
    """
    model = Model(kernel, values)
    names = [s.name for s in kernel.states]
    for name, value in at.items():
        for own in (name, f"held_{name}"):
            if own in names:
                model.x[names.index(own)] = value
        if name in [i.name for i in kernel.inputs]:
            model.set_input(name, value)
    if kernel.modes:
        model.u[-1] = kernel.modes.index(mode)
    jacobian = model.jacobian(0.0, model.x)
    u = [names.index(f"held_{n}") for n in inputs]
    y = [names.index(f"summed_of_{n}") for n in outputs]
    x = [k for k in range(len(names)) if k not in {*u, *y}]
    a, b, c, d = (jacobian[np.ix_(to, by)] for to, by in ((x, x), (x, u), (y, x), (y, u)))
    return Linear(a, b, c, d, sampled)


def open_loop(plant: Linear, controller: Linear, period: float = 0.0) -> Any:
    """The loop from the plant's command back to it, with the sign of negative feedback.

    A sampled controller has a `period` [s]; the plant is then discretized with a held command.
    Returns a control.StateSpace.
    """
    import control

    p = control.ss(plant.a, plant.b, plant.c, plant.d)
    k = controller
    if not k.sampled:
        return -(control.ss(k.a, k.b, k.c, k.d) * p)
    n = len(k.a) - k.sampled  # continuous states; between samples they get the sampled values
    turn, hold = np.eye(n), np.zeros((n, k.sampled))
    if n:
        between = control.ss(k.a[:n, :n], k.a[:n, n:], np.eye(n), hold)
        between = control.sample_system(between, period, "zoh")
        turn, hold = between.A, between.B
    # its output at a sample uses the new values of its states
    new_x, new_y, out = k.a[n:], k.b[n:], k.c[:, n:]
    a = np.vstack([np.hstack([turn, np.zeros((n, k.sampled))]) + hold @ new_x, new_x])
    law = control.ss(a, np.vstack([hold @ new_y, new_y]), out @ new_x, out @ new_y + k.d, period)
    return -(law * control.sample_system(p, period, "zoh"))


def is_stable(loop: Any) -> bool:
    """Whether a loop of `open_loop` is stable when it is closed."""
    import control

    poles = control.feedback(loop, 1).poles()
    beyond = np.abs(poles) - 1 if loop.dt else poles.real / np.abs(poles).max(initial=1.0)
    return bool((beyond <= UNSTABLE).all())


def response_of(loop: Any, points: int = POINTS) -> tuple[Vector, Response]:
    """Frequencies [rad/s], up to half the sampling frequency, and the loop's response there."""
    top = math.pi / loop.dt * (1 - 1e-9) if loop.dt else HIGHEST
    omega = np.geomspace(LOWEST, top, points)
    at = np.exp(1j * omega * loop.dt) if loop.dt else 1j * omega
    return omega, np.asarray(loop(at), dtype=np.complex128)


def margins_of(loop: Any, state: str, speed: float) -> Margins:
    """Margins of a loop of `open_loop`; see `Margins`."""
    import control

    omega, response = response_of(loop)
    data = control.frd(response, omega, smooth=True)  # no polynomials, which lose digits here
    found = [np.atleast_1d(f) for f in control.stability_margins(data, returnall=True)]
    gains, phases, distances, at_gain, at_phase, at_distance = found
    none = math.inf, math.nan
    up = [(g, w) for g, w in zip(gains, at_gain, strict=True) if g > 1]
    gain, gain_at = min(up, default=none)
    pairs = zip(phases, at_phase, strict=True)
    phase, phase_at = min(pairs, key=lambda p: abs(p[0]), default=(math.nan, math.nan))
    nearest = [*zip(distances, at_distance, strict=True)]
    nearest += [*zip(np.abs(1 + response), omega, strict=True)]
    distance, distance_at = min(nearest)
    hertz = 2 * math.pi
    return Margins(
        state,
        speed,
        is_stable(loop),
        float(gain),
        float(max((g for g in gains if g < 1), default=0.0)),
        float(gain_at) / hertz,
        float(phase),
        float(phase_at) / hertz,
        max(1.0, float(1 / distance)),
        float(distance_at) / hertz,
        omega / hertz,
        response,
    )

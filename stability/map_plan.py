"""Plan of a map: a loop and two axes of its parameters; and one cell of it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..orchestration.fmu.limits import TOLERANCE_OF_MAPS, check_memory
from ..orchestration.loop.catalogue import kept_as
from ..orchestration.loop.loop import Loop
from ..orchestration.master.reference_signal import Reference
from ..solver.arrays import Vector
from ..solver.core import System
from ..solver.errors import UserError, nearest
from ..solver.kernel import CONTROLLER, PLANT, Kernel, Model
from ..solver.signals import Parameter
from ..solver.spectrum import follow_returns, follow_tangents
from .attractor import EXPONENTS, LONGER_RUN, OTHER_SOLVER, Kind
from .classify import classify_attractor
from .lyapunov import BITS, held_loop_kernel, model_of

Columns = dict[str, list[Any]]
PER_CELL = 1000  # bytes of a cell while the map is merged and drawn, measured
MOST_BYTES = 10**30  # counts on the command line can have any number of digits
TABLE = "map"
SETPOINT, DESIGN = "setpoint", "design"
LAST = 0.1  # share of the run over which the oscillation is measured
REASONS = {  # of undecided cells, by what would decide
    LONGER_RUN: "no rest and no periodic returns until the budget is used up",
    EXPONENTS: "returns that are not periodic",
    OTHER_SOLVER: "the solver cannot continue",
}
NO_DESIGN = "no controller can be designed for this plant"
COLUMNS = "verdict", "final_error", "lambda1_bits_per_s", "oscillation_amplitude", "reason"


@lru_cache(maxsize=8)
def _linear(low: float, high: float, count: int) -> Vector:
    """One array for all cells of a map."""
    return np.linspace(low, high, count)


@dataclass(frozen=True)
class Axis:
    """One side of a map, with `count` points, both ends included.

    `name` is as the user gave it, and the name of the column. `side` is "plant", "controller",
    "setpoint", or "design": the plant for which the NCTF controller is designed.
    """

    name: str
    side: str
    parameter: str
    low: float
    high: float
    count: int

    def values(self) -> Vector:
        return _linear(self.low, self.high, self.count)

    def value(self, number: int) -> float:
        return float(self.values()[number])


@dataclass(frozen=True)
class MapPlan:
    """All data of a map: values of the loop that are no axis are the same in all cells."""

    loop: Loop
    x: Axis
    y: Axis
    exponents: bool = False
    tolerance: float = TOLERANCE_OF_MAPS
    seed: int = 0

    @property
    def cells(self) -> int:
        return self.x.count * self.y.count

    def check(self) -> None:
        """Check that the two axes differ, and values are in range.

        Raises
        ------
        UserError
            If an axis is invalid, or tables and pictures of the cells do not fit into memory.
        """
        loop = self.loop
        check_memory(
            float(min(PER_CELL * self.cells, MOST_BYTES)),
            f"{self.x.count} x {self.y.count} cells need",
            "use fewer points, or several maps",
        )
        if self.exponents and kernel_of(self).quantized:
            raise UserError(
                f"{loop.controller.label} or {loop.plant.label} quantizes a signal, "
                "and a quantizer has no tangents; map it without --exponents, or use "
                "lyapunov for single loops"
            )
        if (self.x.side, self.x.parameter) == (self.y.side, self.y.parameter):
            raise UserError(f"--x and --y are both {self.x.parameter}; expected two parameters")
        if PLANT + "x" not in [s.name for s in kernel_of(self).states]:
            raise UserError(f"{loop.plant.label} has no state x; a map evaluates the motion of x")
        given = {"plant": loop.plant_values, "controller": loop.controller_values}
        for axis in (self.x, self.y):
            if axis.parameter in given.get(axis.side, {}):
                raise UserError(
                    f"{axis.name} is given as a value and as an axis; expected one of them"
                )
            about = _about(axis, loop)
            low, high = (about.minimum, about.maximum) if about else (-math.inf, math.inf)
            if axis.low < low or axis.high > high:
                raise UserError(
                    f"{axis.name} runs from {axis.low:g} to {axis.high:g}, expected values within "
                    f"[{low:g}, {high:g}]"
                )

    def described(self) -> dict[str, Any]:
        """The plan's part of ``map.json``."""
        loop = self.loop
        return {
            "controller": loop.controller.name,
            "x": asdict(self.x),
            "y": asdict(self.y),
            "plant": loop.plant.name,
            "plant_values": loop.plant_values,
            "controller_values": loop.controller_values,
            "setpoint": loop.set_point,
            "stop": loop.stop,
            "exponents": self.exponents,
            "tolerance": self.tolerance,
            "seed": self.seed,
        }

    def fingerprint(self) -> str:
        """Hash of the plan and of its equations."""
        text = json.dumps(self.described(), sort_keys=True) + kernel_of(self).module
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def point(self, cell: int) -> tuple[float, float]:
        """Values of x and y in a cell; x runs fastest."""
        row, column = divmod(cell, self.x.count)
        return self.x.value(column), self.y.value(row)

    def loop_at(self, x: float, y: float) -> Loop:
        """The loop at a point.

        Raises
        ------
        ValueError
            If no controller can be designed for this plant.
        """
        loop = self.loop
        plant, controller = dict(loop.plant_values), dict(loop.controller_values)
        reference = loop.reference
        designed: dict[str, float] = {}
        for axis, value in ((self.x, x), (self.y, y)):
            if axis.side == SETPOINT:
                reference = Reference.constant(value)
            elif axis.side == DESIGN:
                designed[axis.parameter] = value
            else:
                (plant if axis.side == "plant" else controller)[axis.parameter] = value
        if designed:
            from ..controllers.nctf import design

            controller = design({**loop.plant_values, **designed}).parameters() | controller
        return replace(loop, plant_values=plant, controller_values=controller, reference=reference)


def read_axis(text: str, loop: Loop) -> Axis:
    """An axis from ``NAME=LOW:HIGH:COUNT``.

    NAME is a parameter or initial state (``x_start``) of the controller or the plant, with
    ``controller.`` or ``plant.`` before it if both have it, ``setpoint``, or ``design.NAME``.

    Raises
    ------
    UserError
    """
    name, equals, numbers = text.partition("=")
    parts = numbers.split(":")
    if not equals or not name or len(parts) != 3:
        raise UserError(f"{text!r} is not of the form NAME=LOW:HIGH:COUNT")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise UserError(f"{text!r}: expected two numbers and a whole number after the =") from None
    if not (math.isfinite(low) and math.isfinite(high)):
        raise UserError(f"{text!r}: the bounds must be finite")
    if not low < high:
        raise UserError(
            f"{text!r}: the bounds are {low:g} and {high:g}, expected the lower one first"
        )
    if count < 2:
        raise UserError(f"{text!r}: {count} points, expected 2 or more")
    side, parameter = _owner(name, loop)
    return Axis(name, side, parameter, low, high, count)


def _owner(name: str, loop: Loop) -> tuple[str, str]:
    if name == SETPOINT:
        return SETPOINT, SETPOINT
    ours, theirs = loop.plant.parameters, loop.controller.parameters
    ours_is, theirs_is = loop.plant.label, loop.controller.label
    side, dot, own = name.partition(".")
    if dot and side == DESIGN:
        if loop.controller.name != "nctf":
            raise UserError(f"{name!r}: only nctf is designed for a plant, but this is {theirs_is}")
        if own in ours:
            return DESIGN, own
    elif dot and side in ("plant", "controller"):
        if own in (ours if side == "plant" else theirs):
            return side, own
    elif name in theirs and name in ours:
        raise UserError(f"both sides have {name!r}: use controller.{name} or plant.{name}")
    elif name in theirs:
        return "controller", name
    elif name in ours:
        return "plant", name
    hint = nearest(own if dot else name, [*theirs, *ours])
    raise UserError(
        f"neither {theirs_is} nor {ours_is} has {name!r}{hint}; {theirs_is} has "
        f"{', '.join(theirs) or 'none'}; {ours_is} has {', '.join(ours)}"
    )


@lru_cache(maxsize=8)
def _kernel(plant: str, controller: str, *_kept_as: object) -> Kernel:
    return held_loop_kernel(plant, controller)


def kernel_of(plan: MapPlan) -> Kernel:
    """The equations of a map's loop; for parts from files, the present ones."""
    names = plan.loop.plant.name, plan.loop.controller.name
    return _kernel(*names, *map(kept_as, names))


def axis_unit(plan: MapPlan, axis: Axis) -> str:
    """The unit of an axis, for its label."""
    about = _about(axis, plan.loop)
    return about.unit if about else "m"


def _about(axis: Axis, loop: Loop) -> Parameter | None:
    """Information on an axis' parameter; None for set-points."""
    if axis.side == SETPOINT:
        return None
    part = loop.controller if axis.side == "controller" else loop.plant
    return part.parameters[axis.parameter]


@dataclass(frozen=True)
class Cell:
    """Long-term motion of one loop.

    Attributes
    ----------
    verdict : Kind
    final_error : float
        Set-point minus position at the end of the run [m].
    lambda1 : float
        Largest finite-time exponent [bits/s]; NaN if not requested.
    oscillation : float
        Half the range of the position over the last tenth of the run [m].
    reason : str
        Why it is undecided: one of a few reasons, a colon, and the evidence.
    """

    verdict: Kind
    final_error: float = math.nan
    lambda1: float = math.nan
    oscillation: float = math.nan
    reason: str = ""


def model_at(
    plan: MapPlan, x: float, y: float, tolerance: float, system: System | None = None
) -> Model:
    return model_of(kernel_of(plan), plan.loop_at(x, y), tolerance, system)


def run_cell(
    plan: MapPlan, x: float, y: float, tolerance: float, system: System | None = None
) -> Cell:
    """Run one loop of a map, with the equations of a previous cell if given."""
    try:
        model = model_at(plan, x, y, tolerance, system)
    except ValueError as none:
        return Cell(Kind.UNDECIDED, reason=f"{NO_DESIGN}: {none}")
    references = (k for k, i in enumerate(model.kernel.inputs) if i.role == "reference")
    goal = next((float(model.u[k]) for k in references), 0.0)
    position = [s.name for s in model.kernel.states].index(PLANT + "x")
    stop, begin = plan.loop.stop, (1.0 - LAST) * plan.loop.stop
    growth = math.nan
    if plan.exponents:
        run = follow_tangents(model, np.array([0.0, begin]), count=1)
        lost, away, at = run.failure, run.diverged, begin
        frame, growth = run.frame, float(run.growth[-1, 0])
    else:
        passes = follow_returns(model, 0.0, begin, 0, np.inf, 0)
        lost, away, at = passes.failure, passes.diverged, passes.end
    if not lost:
        start = model.x.copy(), model.u.copy()
        passes = follow_returns(model, begin, stop, 0, np.inf, 0)
        lost, away, at = passes.failure, passes.diverged, passes.end
        if plan.exponents and not lost:
            end = model.x.copy(), model.u.copy()
            model.x[:], model.u[:] = start
            tail = follow_tangents(model, np.array([begin, stop]), count=1, frame=frame)
            growth += float(tail.growth[-1, 0])
            model.x[:], model.u[:] = end
    if lost:
        kind = Kind.DIVERGES if away else Kind.UNDECIDED
        reason = "" if away else f"{REASONS[OTHER_SOLVER]}: {lost}"
        return Cell(kind, lambda1=growth / at * BITS, reason=reason)
    error = goal - float(model.x[position])
    swing = 0.5 * float(passes.high[position] - passes.low[position])
    motion = classify_attractor(model, stop, stop, exponents=False, brief=True)
    reason = ""
    if motion.kind is Kind.UNDECIDED:
        would = f"needed for a decision: {motion.would_decide}"
        reason = f"{REASONS.get(motion.would_decide, would)}: {motion.evidence}"
    return Cell(motion.kind, error, growth / stop * BITS, swing, reason)


def run_chunk(plan: MapPlan, cells: Sequence[int], share: float) -> Columns:
    """Run some cells at this share of the tolerance; return their columns of the map's table."""
    system = kernel_of(plan).system()
    rows = []
    for cell in cells:
        x, y = plan.point(cell)
        found = astuple(run_cell(plan, x, y, share * plan.tolerance, system))
        row = (cell, x, y, str(found[0]), *found[1:])
        rows.append([None if isinstance(v, float) and math.isnan(v) else v for v in row])
    names = ("cell", plan.x.name, plan.y.name, *COLUMNS)
    return {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def stuck_growth(plan: MapPlan, x: float, y: float) -> float:
    """Fastest growth of the loop while stuck: bristles at rest move with the block [1/s].

    The friction law's smooth sign is set to one: its argument is made large while the velocity goes
    to zero. The zero eigenvalue, for deflection without motion, is left out; the sign of the
    largest real part is the criterion of Routh and Hurwitz.
    """
    model = model_at(plan, x, y, plan.tolerance)
    names = [p.name for p in model.kernel.parameters]
    for sharpness in (PLANT + "Kv", CONTROLLER + "Kv"):
        if sharpness in names:
            model.p[names.index(sharpness)] = 1e16
    state = np.zeros(len(model.x))
    states = [s.name for s in model.kernel.states]
    state[states.index(PLANT + "v")] = 1e-10
    state[states.index(PLANT + "x")] = plan.loop.set_point
    nominal = model.kernel.nominal
    values = np.linalg.eigvals(model.jacobian(0.0, state) * nominal[None, :] / nominal[:, None])
    return float(np.delete(values, np.argmin(np.abs(values))).real.max())

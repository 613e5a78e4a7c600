"""A compiled component: tables of its symbols, and fast functions over arrays.

Nothing here needs SymPy, so that a process with its kernels on disk starts quickly.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from . import core
from .arrays import Matrix, Vector
from .kernel_cache import compiled_path, is_whole
from .signals import Input, Parameter

Flags = npt.NDArray[np.bool_]

DEFAULT_TOLERANCE = 1e-8
PLANT, CONTROLLER = "plant_", "controller_"
"""Prefixes of the names of a loop's parts, see `connect`."""
MAX_STEPS = 200_000


class IntegrationError(RuntimeError):
    """The stepper could not continue; the message says when and why."""

    so_far: Trajectory  # of `Model.simulate`: the rows before


@dataclass(frozen=True)
class StateInfo:
    name: str
    unit: str
    meaning: str
    start: float
    nominal: float


@dataclass(frozen=True)
class OutputInfo:
    name: str
    unit: str
    meaning: str
    nominal: float
    uses: list[str]  # all symbols of its equation in any mode, the time among them
    feedthrough: list[str]  # the inputs among them


@dataclass(frozen=True)
class Kernel:
    """A component as tables and source text; plain data that can be stored and compared."""

    name: str
    description: str
    parameters: list[Parameter]
    inputs: list[Input]
    states: list[StateInfo]
    discrete: list[StateInfo]
    outputs: list[OutputInfo]
    sample_time: str  # name of the parameter; empty if nothing is sampled
    modes: list[str]
    events: int  # the largest number in a mode
    module: str  # name of the equations' module, ending in a hash of its text, `source`
    source: str = field(repr=False)
    delays: list[StateInfo]
    tapes: str = field(repr=False)  # the equations, see `tape.record_tape`, in base 64

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Kernel:
        data: dict[str, Any] = json.loads(text)
        for row in data["inputs"]:
            row["law"] = tuple(row["law"])
        records = {"parameters": Parameter, "inputs": Input, "outputs": OutputInfo}
        for key in ("parameters", "inputs", "states", "discrete", "delays", "outputs"):
            data[key] = [records.get(key, StateInfo)(**row) for row in data[key]]
        return cls(**data)

    def system(self) -> core.System:
        """The equations in the form that the compiled core calls, with their own scratch memory."""
        return core.System(self._tapes, equations=self._compiled)

    def compile(self) -> None:
        """Compile the equations with a C compiler, if there is one; the numbers do not change."""
        from .translation import compile_equations

        if compile_equations(self.module, self.source, len(self.states)):
            vars(self).pop("_compiled", None)

    @property
    def quantized(self) -> bool:
        """Whether an equation contains a quantizer, `floor` or `ceiling`."""
        return "math.floor(" in self.source or "math.ceil(" in self.source

    @cached_property
    def nominal(self) -> Vector:
        """Nominal magnitudes of the states."""
        return np.array([s.nominal for s in self.states])

    @cached_property
    def _tapes(self) -> bytes:
        return base64.b64decode(self.tapes)

    @cached_property
    def _compiled(self) -> str:
        """File of the compiled equations; empty if there is none."""
        path = compiled_path(self.module)
        return str(path) if is_whole(path) else ""


@dataclass(frozen=True)
class Trajectory:
    """States and outputs on a grid of m times."""

    time: Vector  # shape (m,) [s]
    states: dict[str, Vector]  # by name, each of shape (m,)
    outputs: dict[str, Vector]
    steps: int  # internal steps of the stiff solver so far
    events: int


class Model:
    """A kernel with values: parameters, state, held inputs, and a stiff solver without a clock.

    Parameters
    ----------
    kernel : Kernel
    values : mapping of str to float, optional
        Parameters by name, and initial states, discrete ones too, as ``<state>_start``.
    tolerance : float
        Relative tolerance; the absolute one is this times each state's nominal value.
    system : core.System, optional
        The kernel's system from another model that is no longer used.

    Attributes
    ----------
    stiff : bool
        Whether it was found too stiff for an explicit solver.
    watch : function or None
        See `spectrum.Watch`.

    Raises
    ------
    KeyError
        For an unknown name.
    """

    def __init__(
        self,
        kernel: Kernel,
        values: Mapping[str, float] | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
        system: core.System | None = None,
    ) -> None:
        self.kernel = kernel
        self.system = system or kernel.system()
        self.stiff = False
        self.p = np.array([p.default for p in kernel.parameters])
        self.x = np.array([s.start for s in kernel.states])
        self.system.forget()
        held = [i.start for i in kernel.inputs] + [d.start for d in kernel.discrete]
        held += [0.0] * (2 * len(kernel.delays))  # values of delayed signals, and their rates
        self.u = np.array(held + [0.0] * bool(kernel.modes), dtype=float)
        first = len(kernel.inputs)
        places = {f"{d.name}_start": (self.u, first + k) for k, d in enumerate(kernel.discrete)}
        places |= {f"{s.name}_start": (self.x, k) for k, s in enumerate(kernel.states)}
        places |= {p.name: (self.p, k) for k, p in enumerate(kernel.parameters)}
        for name, value in (values or {}).items():
            if name not in places:
                known = ", ".join(places)
                raise KeyError(f"{kernel.name} has no parameter {name!r}; it has {known}")
            vector, place = places[name]
            vector[place] = value
        self.tolerance = tolerance
        self.atol = tolerance * kernel.nominal
        self.info = np.zeros(core.INFO_SIZE)
        self.watch: Callable[[float, Vector | None], bool] | None = None

    def set_input(self, name: str, value: float) -> None:
        self.u[[i.name for i in self.kernel.inputs].index(name)] = value

    @property
    def sample_time(self) -> float:
        """Period of the discrete states' updates [s]; 0 if there are none."""
        names = [p.name for p in self.kernel.parameters]
        name = self.kernel.sample_time
        return float(self.p[names.index(name)]) if name else 0.0

    def sample(self, t: float) -> None:
        """Update the discrete states at a sample instant."""
        update = np.zeros(len(self.kernel.discrete))
        self.system.sample(t, self.x, self.u, self.p, update)
        first = len(self.kernel.inputs)
        self.u[first : first + len(update)] = update

    @property
    def mode(self) -> str:
        """Name of the present mode; empty for a component without modes."""
        return self.kernel.modes[int(self.u[-1])] if self.kernel.modes else ""

    def settle(self, t: float) -> None:
        """Handle every event that is due now, for example after a jump of an input.

        Raises
        ------
        IntegrationError
            If events follow each other without end.
        """
        status = self.system.settle(t, self.x, self.u, self.p, self.info)
        if status != core.DONE:
            raise self._failed(status, t)

    def derivatives(self, t: float, x: Vector) -> Vector:
        """dx/dt, shape (n,)."""
        dx = np.empty(len(x))
        self.system.rhs(t, np.ascontiguousarray(x), self.u, self.p, dx)
        return dx

    def jacobian(self, t: float, x: Vector) -> Matrix:
        """Partial derivatives of dx/dt by x, shape (n, n)."""
        n = len(x)
        matrix, by_time = np.empty((n, n)), np.empty(n)
        self.system.jac(t, np.ascontiguousarray(x), self.u, self.p, matrix, by_time)
        return matrix

    def outputs(self, t: float, x: Vector) -> dict[str, float]:
        y = np.empty(len(self.kernel.outputs))
        self.system.out(t, np.ascontiguousarray(x), self.u, self.p, y)
        return {o.name: float(v) for o, v in zip(self.kernel.outputs, y, strict=True)}

    def advance(self, t0: float, t1: float, max_steps: int = MAX_STEPS) -> None:
        """Move the state from `t0` to `t1` with the present inputs held.

        Raises
        ------
        IntegrationError
            If the tolerance cannot be met, or not in `max_steps` steps.
        """
        status = self.system.advance(
            t0, t1, self.x, self.u, self.p, self.atol, self.tolerance, self.info, max_steps
        )
        if status != core.DONE:
            raise self._failed(status, t1, max_steps)

    def simulate(
        self,
        times: npt.ArrayLike,
        given: tuple[Matrix, Matrix] | None = None,
        sampled: Flags | None = None,
    ) -> Trajectory:
        """Run from the present state over a time grid and record states and outputs.

        Parameters
        ----------
        times : array_like, shape (m,)
            Not decreasing [s].
        given : tuple of two ndarrays, shape (m, k), optional
            Values of the first `k` inputs before each of these times, and at
            it; default: unchanged.
        sampled : ndarray of bool, shape (m,), optional
            At which of the times discrete states are updated. Default: at none.

        Raises
        ------
        IntegrationError
            If the tolerance cannot be met.
        """
        grid = np.ascontiguousarray(times, dtype=float)
        states = np.empty((len(grid), len(self.x)))
        states[0] = self.x
        outputs = np.empty((len(grid), len(self.kernel.outputs)))
        samples = sampled, len(self.kernel.inputs), len(self.kernel.discrete)
        solver = self.u, self.p, self.atol, self.tolerance, self.info, MAX_STEPS
        done = self.system.trajectory(grid, states, outputs, given, samples, *solver)
        if done < len(grid):
            error = self._failed(int(self.info[core.STATUS]), grid[done])
            error.so_far = self._trajectory(grid[:done], states[:done], outputs[:done])
            raise error
        self.x[:] = states[-1]
        return self._trajectory(grid, states, outputs)

    def _failed(self, status: int, target: float, most: int = MAX_STEPS) -> IntegrationError:
        return IntegrationError(describe_failure(self.kernel.name, status, self.info, target, most))

    def _trajectory(self, grid: Vector, states: Matrix, outputs: Matrix) -> Trajectory:
        return Trajectory(
            grid,
            {s.name: states[:, k] for k, s in enumerate(self.kernel.states)},
            {o.name: outputs[:, k] for k, o in enumerate(self.kernel.outputs)},
            int(self.info[core.ACCEPTED]),
            int(self.info[core.EVENTS]),
        )


def describe_failure(
    name: str, status: int, info: Vector, target: float, max_steps: int = MAX_STEPS
) -> str:
    """One line for a status that an integration ended with."""
    reached = info[core.REACHED]
    if status == core.TOO_MANY_STEPS:
        return (
            f"{name}: {max_steps} internal steps were not enough to get from t = {reached:.9g} s "
            f"to {target:.9g} s"
        )
    if status == core.CHATTER:
        return (
            f"{name}: events follow each other without end at t = {reached:.9g} s; two modes "
            "switch to each other, a reset does not end its own condition, or the time between "
            "events goes to zero"
        )
    if status == core.NO_DELAY:
        return f"{name}: a delay is not a positive number of seconds"
    return (
        f"{name}: the internal step fell to {info[core.NEXT_STEP]:.3g} s at "
        f"t = {reached:.9g} s; the solution diverges, or a parameter value is wrong"
    )

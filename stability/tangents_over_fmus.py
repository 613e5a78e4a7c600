"""Tangents of a loop of two FMUs: finite-time Lyapunov exponents from exchanged signals.

Plant and controller are FMUs with tangents (`fmus/variational.py`), coupled by the feedback law. A
joint tangent is the tangent of all states of both. The master treats tangents in the same
way as signals, so these are the tangents of the coupled scheme itself: exact for the
scheme, and as accurate for the loop as the scheme is. At every communication point the joint
tangents are orthonormalized in the order plant, then controller, and set back into the FMUs.

If a law changes fast within a step, such as friction near standstill, its tangents miss this change
even if the signals are accurate: a linearizing controller responds to the onset of sliding, tens of
microseconds long, with an impulse. The tangents therefore determine the steps: steps are halved
until correcting the tangents changes little.

A controller without tangents is probed by differences at every step: its law is read at signals
moved along each tangent. This reaches its own states only through its inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..fmus.ports import tangent_port
from ..orchestration.fmu.compiled import Bound, Why, call, failure_of, struct
from ..orchestration.fmu.fmu_instance import FmuInstance, StepFailed
from ..orchestration.fmu.group import initialize
from ..orchestration.fmu.isolated import IsolatedInstance
from ..orchestration.fmu.wiring import CONTROLLER, PLANT, Wiring, convert, names_on, wire
from ..orchestration.master.march import Clock, bounds
from ..solver.arrays import Matrix, Vector
from ..solver.errors import FmuError
from .tangent_sides import RELATIVE, ProbedController, Side, ordinary

ACCURACY = 1e-2  # nats: largest total change of the growth by the corrections
# Of the FMUs' own solvers. Compared with 1e-10, the growth of slow tangents changes by less than
# 1e-5 nats, that of a fast one by 4e-9 of it (loop with NCTF, 20 s), with a fifth of the steps.
TOLERANCE = 1e-6
_FINE = {"solver_tolerance": TOLERANCE}
FINEST = 12  # steps go down to 2^-12 of the given one
CHUNK = 256  # steps between two possible interruptions


@dataclass(frozen=True)
class TangentRun:
    """A coupled run with its tangents.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Communication points [s].
    outputs : dict of str to ndarray, shape (m,)
        The plant's outputs, under the names they are mapped to.
    growth : ndarray, shape (m, count)
        Logarithms of the lengths of the orthonormalized tangents since the start [nats].
    trace : ndarray, shape (m,)
        Integral of the trace of the loop's Jacobian [nats]; NaN if an FMU does not give it.
    stopped : str
        Why the run ended early; empty if it did not.
    diverged : bool
        Whether it ended because an output diverged.
    unmet : int
        Number of steps of the shortest length whose correction still changed more than allowed.
    states : tuple of str
        Names of the states that the tangents have, in the order of the first frame.
    method : str
        "tangent ports" or "probed by differences".
    accuracy : str
        Known facts on the error, in a sentence.
    """

    time: Vector
    outputs: dict[str, Vector]
    growth: Matrix
    trace: Vector
    stopped: str
    diverged: bool
    unmet: int
    states: tuple[str, ...] = ()
    method: str = ""
    accuracy: str = ""

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the end [nats/s], in the order of the tangents."""
        span = self.time[-1] - self.time[0]
        return self.growth[-1] / span if span > 0 else np.zeros(self.growth.shape[1])


def follow_over_fmus(  # noqa: PLR0913
    plant: FmuInstance | IsolatedInstance,
    controller: FmuInstance | IsolatedInstance,
    reference: float,
    stop: float,
    step: float,
    *,
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    mapping: Mapping[str, str] | None = None,
    accuracy: float = ACCURACY,
    count: int | None = None,
) -> TangentRun:
    """Run a loop of two FMUs and follow its tangents.

    Parameters
    ----------
    plant, controller : Instance
        Not initialized yet. The plant has tangents, at least as many as are followed.
    reference : float
        Set-point, for every input of the controller that the plant does not drive.
    stop, step : float
        End of the run and communication step [s].
    plant_values, controller_values : mapping of str to float, optional
        Parameters and initial states.
    mapping : mapping of str to str, optional
        Names of ports, ``theirs -> ours``.
    accuracy : float
        Largest change of a tangent's growth by the corrections of the steps [nats], in
        addition to a share of the growth itself; infinite: all steps have the requested length.
    count : int, optional
        Number of tangents, for the largest exponents. Default: as many as both parts have states
        together.

    Returns
    -------
    TangentRun

    Raises
    ------
    FmuError, CouplingError
        If the parts cannot be coupled in this way.
    StepFailed
        If a part rejects its parameters or initial values.
    """
    for instance in (plant, controller):
        if not instance.can_save:
            raise FmuError(
                f"{instance.name} cannot save and restore its state, which tangents need "
                "here; export it with this capability (pythonfmu build --handle-state)"
            )
    wiring = wire(ordinary(plant), ordinary(controller), mapping)
    controller, _, notes = convert(plant, controller, wiring, mapping)
    refs = np.array([0.0 if order else reference for order in wiring.orders])
    wiring.check_given({PLANT: plant_values or {}, CONTROLLER: controller_values or {}})
    p = Side(plant)
    if not p.states or not wiring.accepts_law:
        raise FmuError(
            f"{plant.name} has no tangent ports; export it with tangents (export --variational)"
        )
    reports = {tangent_port(ours, 1) for ours, _ in wiring.commands}
    ports = reports <= set(controller.outputs)
    c = Side(controller) if ports else ProbedController(controller, wiring)
    own = _FINE if c.states else {}
    values = _FINE | dict(plant_values or {}), own | dict(controller_values or {})
    initialize(plant, controller, wiring, values, stop, refs)
    if isinstance(c, ProbedController):
        at = plant.reader([ours for ours, _ in wiring.signals])()
        c.look(0.0, min(step, stop), at, refs)
    states = len(p.states) + len(c.states)
    count = min(count or states, states)
    for side in [p] if isinstance(c, ProbedController) else [p, c]:
        if side.states and side.tangents < count:
            raise FmuError(
                f"{side.instance.name} carries {side.tangents} tangents, but {count} are "
                f"needed; export it with {count} (export --variational --tangents {count})"
            )
    names = list(ordinary(plant).outputs)
    joint = _Joint(p, c, wiring, count, refs)
    run = joint.march(names, Clock(stop, step, finer=FINEST), accuracy)
    ours = names_on(PLANT, [*names, *plant.inputs], mapping or {})
    said = _stated(c, accuracy)
    if run.unmet:
        said += (
            f"; {run.unmet} of {len(run.time) - 1} steps had the shortest length and still "
            "changed more: the exponents may have larger errors there"
        )
    return replace(
        run,
        outputs={ours[n]: course for n, course in run.outputs.items()},
        states=(*p.states, *c.states),
        method="tangent ports" if ports else "probed by differences",
        accuracy="; ".join([said, *notes]),
    )


def _stated(c: Side, accuracy: float) -> str:
    """Text on the error of the tangents."""
    if not isinstance(c, ProbedController):
        how = "all of the requested length, without a check of the accuracy"
        if accuracy < math.inf:
            how = (
                f"chosen so that a correction changes the growth of each tangent by at most about "
                f"{accuracy:g} nats and {RELATIVE:g} of it"
            )
        return f"tangents exact for the coupled scheme; steps were {how}"
    lost = [
        "the change of the gains along a tangent is only in the correction of each step, and "
        "numbers from differences have about half the digits: expect errors of a few thousandths, "
        "and less than one thousandth for tangents with ports"
    ]
    if c.states:
        lost.append(
            "a state of the controller is represented by its contribution to the command, in the "
            "command's unit, so that finite-time exponents differ by a constant divided by the time"
        )
    return "; ".join([*lost, *c.remarks])


class _Joint:
    """Both sides, in the form for the compiled steps, see ``c/joint_step.c``."""

    def __init__(
        self,
        p: Side,
        c: Side,
        wiring: Wiring,
        count: int,
        reference: Vector,
    ) -> None:
        self._whole = struct("Joint")
        self._plant, self._count = p, count
        signals, measured = zip(*wiring.signals, strict=True)
        law = [*(theirs for _, theirs in wiring.commands), *wiring.plant_law()]
        answer = [*(ours for ours, _ in wiring.commands), *wiring.controller_law()]
        given = [*measured, *wiring.references]
        plant, controller = self._whole.part("plant"), self._whole.part("controller")
        self._bound = (
            *p.bind(plant, law, law, signals, count),
            *c.bind(controller, given, measured, answer, count),
        )
        m, n, rows = len(wiring.commands), len(signals), 1 + count
        states = len(p.states) + len(c.states)
        self._whole.set(m=m, n=n, count=count, reference=reference)
        self._whole.set(**{name: np.zeros(rows * n) for name in ("start", "end", "middle")})
        laws = ("law", "mended", "ramped")
        self._whole.set(**{name: np.zeros(rows * m * (2 + n)) for name in laws})
        self._whole.set(frame=np.eye(count, states), plain=np.zeros((count, states)))
        self._whole.set(plain_logs=np.zeros(count), logs=np.zeros(count))

    def march(self, names: Sequence[str], clock: Clock, accuracy: float) -> TangentRun:
        """Run to the clock's end, and record these outputs of the plant.

        The run ends if one of them leaves its `bounds`. A joint tangent is a row of the frame.
        """
        plant, count = self._plant.instance, self._count
        shown = Bound(plant, [], names, self._whole.part("shown"))
        rooms = [np.zeros((CHUNK + 1, k)) for k in (1, len(names), count, 1)]
        rooms[1][0] = plant.reader(names)()
        bound = bounds(np.array([plant.nominal(n) for n in names]), rooms[1][0])
        trail = struct("Trail")
        fields = ("times", "outputs", "growth", "trace")
        trail.set(bound=bound, accuracy=accuracy, relative=RELATIVE)
        trail.set(**dict(zip(fields, rooms, strict=True)))
        kept, why = [[room[:1].copy()] for room in rooms], Why.GOES_ON
        while why is Why.GOES_ON and not clock.done:
            why = Why(call("joint_march", self._whole, clock.whole, trail, CHUNK))
            last = int(trail.record.rows)
            for rows, room in zip(kept, rooms, strict=True):
                rows.append(room[1 : last + 1].copy())
                room[0] = room[last]
        times, outputs, growth, trace = map(np.concatenate, kept)
        stopped = ""
        if why is Why.STEP_FAILED:
            error = failure_of(*self._bound, shown)
            if not isinstance(error, StepFailed):
                assert error is not None
                raise error
            stopped = f"{error} (in the step from t = {clock.now:.6g} s)"
        elif why is not Why.GOES_ON:
            beyond = np.nan_to_num(np.abs(outputs[-1]) / bound, nan=np.inf)
            name = names[int(np.argmax(beyond))]
            stopped = f"the loop diverges: {name} exceeds its bound at t = {clock.now:.6g} s"
        courses = dict(zip(names, outputs.T, strict=True))
        unmet, diverged = int(trail.record.unmet), why is Why.DIVERGES
        return TangentRun(times[:, 0], courses, growth, trace[:, 0], stopped, diverged, unmet)

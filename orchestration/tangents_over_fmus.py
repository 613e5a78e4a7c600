"""Tangents of a loop of two FMUs: finite-time Lyapunov exponents from what the FMUs exchange.

Plant and controller are FMUs with tangents (`fmus/variational.py`), coupled by the feedback law. A
joint tangent is the tangent of all states of both. What the master does with the signals it does
with their tangents, too, so these are the tangents of the coupled scheme itself: exact for it, and
as near to those of the loop as the scheme is to the loop. At every communication point the joint
tangents are orthonormalized in the order plant, then controller, and set back into the FMUs.

Where a law turns over within a step, such as that of friction near standstill, its tangents miss
what happens in between, however well the signals fare: a linearizing controller answers the onset
of sliding, tens of microseconds long, with an impulse. The steps therefore follow the tangents:
they are halved until correcting them changes little.

A controller without tangents is probed by differences at every step: it is asked for its law at
signals moved along each tangent. That reaches no state of its own but through its inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from ..fmus.tangent_ports import (
    FRAME,
    TRACE,
    is_tangent_port,
    set_port,
    tangent_port,
    tangent_states,
)
from .clock import accept, adapt, clock, done, now, step_to_come
from .coupling import Answer, ControllerSide
from .coupling_step import RAMP_SHARE
from .march import LEAST_SHARE
from .participant import Participant, StepFailed
from .wiring import Wiring, wire

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ACCURACY = 1e-2  # nats that the corrections may change the growth by in all
SHIFT = 1e-4  # of a signal's nominal value, to see how it moves a controller's state
RELATIVE = 3e-4  # of the growth, besides
TOLERANCE = 1e-8
RUNAWAY = 1e6  # times an output's nominal value


class TangentsImpossible(ValueError):
    """These FMUs cannot carry the loop's tangents; the message says why."""


@dataclass(frozen=True)
class TangentRun:
    """A coupled run with its tangents.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Communication points [s].
    outputs : dict of str to ndarray, shape (m,)
        The plant's outputs.
    growth : ndarray, shape (m, count)
        Logarithms of the lengths of the orthonormalized tangents since the start [nats].
    trace : ndarray, shape (m,)
        Integral of the trace of the loop's Jacobian [nats]; NaN where an FMU does not give it.
    states : tuple of str
        Names of the states that the tangents have, in the order of the first frame.
    method : str
        "tangent ports" or "probed by differences".
    accuracy : str
        What is known of the error, in a sentence.
    stopped : str
        Why the run ended before its time; empty if it did not.
    """

    time: Vector
    outputs: dict[str, Vector]
    growth: Matrix
    trace: Vector
    states: tuple[str, ...]
    method: str
    accuracy: str
    stopped: str

    @property
    def exponents(self) -> Vector:
        """Finite-time exponents at the end [nats/s], in the order of the tangents."""
        span = self.time[-1] - self.time[0]
        return self.growth[-1] / span if span > 0 else np.zeros(self.growth.shape[1])


@dataclass(frozen=True)
class _Law:
    """A command's law and its tangents: row 0 the law, row k its k-th tangent.

    Shapes (1 + count, m), (1 + count, m, n) and (1 + count, m).
    """

    command: Matrix
    gain: npt.NDArray[np.float64]
    rate: Matrix


@dataclass(frozen=True)
class _Ports:
    """A participant's ordinary ports, for wiring."""

    name: str
    inputs: Sequence[str]
    outputs: Sequence[str]


def _ordinary(participant: Participant) -> Participant:
    states, _ = tangent_states(list(getattr(participant, "parameters", [])))

    def names(ports: Sequence[str]) -> list[str]:
        return [p for p in ports if not is_tangent_port(p, {*ports, *states})]

    ports = _Ports(participant.name, names(participant.inputs), names(participant.outputs))
    return cast("Participant", ports)


class _Side:
    """States with tangents of one FMU, and how to set and read them."""

    def __init__(self, participant: Participant) -> None:
        self.participant = participant
        parameters: list[str] = list(getattr(participant, "parameters", []))
        self.states, self.tangents = tangent_states(parameters)
        self.frames = 0.0

    def bind(self, count: int) -> None:
        """Readers and writers, once it is initialized."""
        tangents = [tangent_port(s, k + 1) for k in range(count) for s in self.states]
        self.set_names = [*map(set_port, tangents), FRAME] if self.states else []
        self.count = count
        self._read_tangents = self.participant.reader(tangents)
        self._write_tangents = self.participant.writer(self.set_names)
        self._read_trace = self.participant.reader([TRACE] if self.states else [])

    def set_tangents(self, rows: Matrix) -> None:
        """Set the tangents, shape (count, states)."""
        if self.states:
            self.frames += 1.0
            self._write_tangents(np.append(rows.ravel(), self.frames))

    def save(self) -> Any:
        return self.participant.save()

    def restore(self, state: Any) -> None:
        self.participant.restore(state)

    def release(self, state: Any) -> None:
        self.participant.release(state)

    def tangents_now(self) -> Matrix:
        return self._read_tangents().reshape(self.count, len(self.states))

    def trace_now(self) -> float:
        return float(self._read_trace().sum())


class _Plant(_Side):
    def wire(self, wiring: Wiring, count: int) -> None:
        self.bind(count)
        commands = [theirs for _, theirs in wiring.commands]
        law = [*commands, *wiring.plant_law()]
        tangents = [tangent_port(n, k + 1) for k in range(count) for n in law]
        self._write = self.participant.writer([*law, *tangents])
        signals = [s for s, _ in wiring.signals]
        tangents = [tangent_port(n, k + 1) for k in range(count) for n in signals]
        self._read_signals = self.participant.reader([*signals, *tangents])
        self.m, self.n = len(commands), len(signals)

    def signals(self) -> Matrix:
        """The signals (row 0) and their tangents (rows 1 to count)."""
        return self._read_signals().reshape(1 + self.count, self.n)

    def step(self, t: float, h: float, law: _Law, signals: Matrix) -> None:
        rows = 1 + self.count
        self._write(
            np.hstack(
                [
                    law.command,
                    law.gain.reshape(rows, -1),
                    np.tile(signals, (1, self.m)),
                    law.rate,
                ]
            ).ravel()
        )
        self.participant.step(t, h)


class _Controller(_Side):
    """A controller with tangent ports."""

    def wire(self, wiring: Wiring, count: int) -> None:
        self.bind(count)
        self.m, self.n = len(wiring.commands), len(wiring.signals)
        signals = [s for _, s in wiring.signals]
        tangents = [tangent_port(n, k + 1) for k in range(count) for n in signals]
        self._write = self.participant.writer([*signals, *wiring.references, *tangents])
        law = [*(c for c, _ in wiring.commands), *wiring.controller_law()]
        tangents = [tangent_port(n, k + 1) for k in range(count) for n in law]
        self._read_law = self.participant.reader([*law, *tangents])

    def set_inputs(self, signals: Matrix, reference: Vector) -> None:
        self._write(np.concatenate([signals[0], reference, signals[1:].ravel()]))

    def law(self, t: float, h: float, signals: Matrix, reference: Vector) -> _Law:
        """The law at these signals and its tangents along theirs."""
        self.set_inputs(signals, reference)
        rows, m, n = 1 + self.count, self.m, self.n
        values = self._read_law().reshape(rows, m * (2 + n))
        gain = values[:, m : m * (1 + n)].reshape(rows, m, n)
        return _Law(values[:, :m], gain, values[:, m * (1 + n) :])

    def advance(self, t: float, h: float, signals: Matrix, reference: Vector) -> None:
        self.set_inputs(signals, reference)
        self.participant.step(t, h)


class _ProbedController:
    """A controller without tangents, asked for differences.

    Its gains come from its law ports, or by differences; how they change along a tangent does not.
    One state of its own can be followed: not as itself but as what it adds to the command, in the
    command's unit. How signals move it and how it fades is measured at every step.
    """

    tangents = 0

    def __init__(self, participant: Participant, wiring: Wiring) -> None:
        self.participant = participant
        self.wiring = wiring
        self.states: list[str] = []
        self.remarks: list[str] = []
        self._added = np.zeros(0)  # to the command, along each tangent

    def look(self, t: float, h: float, signals: Vector, reference: Vector) -> None:
        """Find out how it answers and whether it has a state; once it is initialized."""
        self.side = ControllerSide(self.participant, self.wiring, signals, reference)
        name = self.participant.name
        if self.side.answer is not Answer.DIRECT:
            raise TangentsImpossible(
                f"{name} answers {self.side.answer.value}; tangents need a controller whose output "
                "follows its inputs at once"
            )
        if self.side.m != 1:
            raise TangentsImpossible(f"{name} has {self.side.m} commands; one can be probed")
        responses, fading = self._response(t, h, signals, reference)
        if np.any(responses):
            self.states = [f"{name}: what its state adds to {self.wiring.commands[0][0]}"]
            slow, fast = float(np.min(fading)), float(np.max(fading))
            if fast - slow > 1e-3 * max(abs(slow), abs(fast)):
                self.remarks.append(
                    "it answers different signals with different rates, so it has more than one "
                    "state: only one can be reached and the others are left out"
                )

    def bind(self, count: int) -> None:
        self.count = count
        self._added = np.zeros(count)

    def set_tangents(self, rows: Matrix) -> None:
        self._added = rows[:, 0] if self.states else np.zeros(self.count)

    def save(self) -> Any:
        return self.participant.save(), self._added

    def restore(self, state: Any) -> None:
        self.participant.restore(state[0])
        self._added = state[1]

    def release(self, state: Any) -> None:
        self.participant.release(state[0])

    def tangents_now(self) -> Matrix:
        return self._added[:, None] if self.states else np.zeros((self.count, 0))

    def trace_now(self) -> float:
        return math.nan if self.states else 0.0

    def law(self, t: float, h: float, signals: Matrix, reference: Vector) -> _Law:
        law = self.side.law_at(t, h, signals[0], reference, probe=True)
        along = signals[1:] @ law.gain.T + self._added[:, None]
        zeros = np.zeros((self.count, *law.gain.shape))
        return _Law(
            np.vstack([law.command, along]),
            np.concatenate([law.gain[None], zeros]),
            np.vstack([law.rate, np.zeros_like(along)]),
        )

    def advance(self, t: float, h: float, signals: Matrix, reference: Vector) -> None:
        if self.states:
            responses, fading = self._response(t, h, signals[0], reference)
            if not len(fading):
                raise StepFailed(f"{self.participant.name}: its state cannot be seen any more")
            strongest = float(fading[np.argmax(np.abs(responses[responses != 0.0]))])
            self._added = strongest * self._added + signals[1:] @ responses
        self.side.advance(t, h, signals[0], reference)

    def _response(
        self, t: float, h: float, signals: Vector, reference: Vector
    ) -> tuple[Vector, Vector]:
        """What each signal, moved over a step, adds to the command after it, and how that fades.

        Returns
        -------
        two ndarrays, shapes (n,) and (number of signals that add anything,)
            Volts, or whatever the command is, per unit of the signal; shares that are left after
            one more step.
        """
        state = self.participant.save()

        def command(moved: Vector, steps: int) -> float:
            for k in range(steps):
                self.side.advance(t + k * h, h, moved if k == 0 else signals, reference)
            value = self.side.command_at(signals, reference)
            self.participant.restore(state)
            return float(value[0])

        nominal = np.array([self.participant.nominal(s) for _, s in self.wiring.signals])
        shift = SHIFT * nominal
        response, fading = np.zeros(len(signals)), []
        base = command(signals, 1), command(signals, 2)
        for k in range(len(signals)):
            ends = []
            for n in (1, 2):
                moved = signals.copy()
                moved[k] += shift[k]
                up = command(moved, n)
                ends.append(up - base[n - 1])
            response[k] = ends[0] / shift[k]
            if ends[0] != 0.0:
                fading.append(ends[1] / ends[0])
        self.participant.release(state)
        return response, np.array(fading)


def follow_over_fmus(
    plant: Participant,
    controller: Participant,
    reference: float,
    stop: float,
    step: float,
    *,
    plant_values: Mapping[str, float] | None = None,
    controller_values: Mapping[str, float] | None = None,
    mapping: Mapping[str, str] | None = None,
    accuracy: float = ACCURACY,
) -> TangentRun:
    """Run a loop of two FMUs and follow all its tangents.

    Parameters
    ----------
    plant, controller : Participant
        Not initialized yet. The plant has tangents, at least as many as both have states together.
    reference : float
        Set-point, for every input of the controller that the plant does not drive.
    stop, step : float
        End of the run and communication step [s].
    plant_values, controller_values : mapping of str to float, optional
        Parameters and initial states.
    mapping : mapping of str to str, optional
        Names of ports, ``theirs -> ours``.
    accuracy : float
        By how much correcting the steps may change a tangent's growth in all [nats], besides a
        share of the growth itself; infinite for steps that are all as long as asked for.

    Returns
    -------
    TangentRun

    Raises
    ------
    TangentsImpossible, WiringError
        If the parts cannot be coupled so.
    StepFailed
        If a part refuses its parameters or initial values.
    """
    for participant in (plant, controller):
        if not participant.can_save:
            raise TangentsImpossible(
                f"{participant.name} cannot save and restore its state, which tangents need here"
            )
    wiring = wire(_ordinary(plant), _ordinary(controller), mapping)
    refs = np.full(len(wiring.references), reference)
    p = _Plant(plant)
    reports = {tangent_port(ours, 1) for ours, _ in wiring.commands}
    ports = reports <= set(controller.outputs)
    c = _Controller(controller) if ports else _ProbedController(controller, wiring)
    if not p.states or not wiring.accepts_law:
        raise TangentsImpossible(
            f"{plant.name} has no tangent ports; export it with tangents (export --variational)"
        )
    plant.initialize({"solver_tolerance": TOLERANCE, **(plant_values or {})}, stop)
    given = {"solver_tolerance": TOLERANCE} if isinstance(c, _Controller) and c.states else {}
    controller.initialize({**given, **(controller_values or {})}, stop)
    if isinstance(c, _ProbedController):
        at = plant.reader([ours for ours, _ in wiring.signals])()
        c.look(0.0, min(step, stop), at, refs)
    count = len(p.states) + len(c.states)
    for side in (p, c) if ports else (p,):
        if side.states and side.tangents < count:
            raise TangentsImpossible(
                f"{side.participant.name} carries {side.tangents} tangents and the loop has "
                f"{count} states; export it with {count}"
            )
    p.wire(wiring, count)
    if isinstance(c, _Controller):
        c.wire(wiring, count)
    else:
        c.bind(count)
    names = list(_ordinary(plant).outputs)
    read_outputs = plant.reader(names)
    bound = RUNAWAY * np.array([plant.nominal(n) for n in names])
    time = clock(stop, step, adaptive=True)
    times, growth, trace = [0.0], [np.zeros(count)], [0.0]
    rows = [read_outputs()]
    frame = np.eye(count)  # a joint tangent per row
    split = len(p.states)
    stopped = ""
    while not done(time) and not stopped:
        p.set_tangents(frame[:, :split])
        c.set_tangents(frame[:, split:])
        start = p.signals()
        saved = p.save(), c.save()
        try:
            while True:
                t, h = now(time), step_to_come(time)
                plain, mended = _joint_step(p, c, t, h, refs, start, saved)
                usual = np.abs(growth[-1]) * (h / t if t > 0 else 0.0)
                allowed = accuracy * max(h / stop, LEAST_SHARE)
                share = _share(plain, mended, allowed, usual)
                if not share > 1.0 or time.stride == 1:
                    break
                for side, state in zip((p, c), saved, strict=True):
                    side.restore(state)
                adapt(time, share)
            accept(time)
            adapt(time, share)
            rows.append(read_outputs())
            trace.append(p.trace_now() + c.trace_now())
        except StepFailed as error:
            stopped = f"{error} (in the step from t = {t:.6g} s)"
            break
        finally:
            for side, state in zip((p, c), saved, strict=True):
                side.release(state)
        times.append(now(time))
        growth.append(growth[-1] + mended.logs)
        frame = mended.frame
        if not np.all(np.abs(rows[-1]) <= bound):
            name = names[int(np.argmax(np.nan_to_num(np.abs(rows[-1]) / bound, nan=np.inf)))]
            stopped = f"the loop runs away: {name} leaves every bound at t = {now(time):.6g} s"
    table = np.array(rows)[: len(times)]
    return TangentRun(
        np.array(times),
        {n: table[:, j] for j, n in enumerate(names)},
        np.array(growth),
        np.array(trace)[: len(times)],
        (*p.states, *c.states),
        "tangent ports" if ports else "probed by differences",
        _stated(c, accuracy),
        stopped,
    )


def _stated(c: _Controller | _ProbedController, accuracy: float) -> str:
    """What to say of the error."""
    if isinstance(c, _Controller):
        how = (
            f"chosen so that correcting them changes no tangent's growth by much more than "
            f"{accuracy:g} nats and {RELATIVE:g} of it"
            if accuracy < math.inf
            else "all as long as asked for, whether that is short enough or not"
        )
        return f"tangents exact for the coupled scheme; steps were {how}"
    lost = [
        "the gains' change along a tangent is left to the correction of each step, and what comes "
        "by differences has about half the digits: expect errors of a few thousandths where "
        "tangents with ports have less than one"
    ]
    if c.states:
        lost.append(
            "a state of the controller is followed by what it adds to the command, in the "
            "command's unit, so that finite-time exponents differ by a constant over the time"
        )
    return "; ".join([*lost, *c.remarks])


@dataclass(frozen=True)
class _Frame:
    """Orthonormal joint tangents, a row each, and the logarithms of the lengths they had."""

    frame: Matrix
    logs: Vector


def _orthonormalized(p: _Plant, c: _Controller | _ProbedController) -> _Frame:
    q, r = np.linalg.qr(np.hstack([p.tangents_now(), c.tangents_now()]).T)
    lengths = np.diag(r)
    return _Frame((q * np.sign(lengths)).T, np.log(np.abs(lengths)))


def _share(plain: _Frame, mended: _Frame, allowed: float, usual: Vector) -> float:
    """How far a correction moved the tangents, as a share of what is allowed.

    Allowed are `allowed` nats, or radians of a tangent's direction, and a share of the growth of
    that tangent in this step, or of its `usual` growth, which are large for the fast ones only.
    """
    moved = np.maximum(
        np.abs(mended.logs - plain.logs), np.max(np.abs(mended.frame - plain.frame), axis=1)
    )
    return float(np.max(moved / (allowed + RELATIVE * np.maximum(np.abs(mended.logs), usual))))


def _joint_step(
    p: _Plant,
    c: _Controller | _ProbedController,
    t: float,
    h: float,
    reference: Vector,
    start: Matrix,
    saved: tuple[Any, Any],
) -> tuple[_Frame, _Frame]:
    """One corrected step, much as `coupling.Loop` does it, of signals and tangents alike.

    Returns the tangents without and with the correction.
    """
    law = c.law(t, h, start, reference)
    p.step(t, h, law, start)
    end = p.signals()
    c.advance(t, h, 0.5 * (start + end), reference)
    plain = _orthonormalized(p, c)
    true = c.law(t + h, h, end, reference).command
    change = end - start
    applied = law.command + law.rate * h + np.einsum("mn,kn->km", law.gain[0], change)
    applied[1:] += np.einsum("kmn,n->km", law.gain[1:], change[0])
    mended = _Law(law.command, law.gain, law.rate + RAMP_SHARE * (true - applied) / h)
    for side, state in zip((p, c), saved, strict=True):
        side.restore(state)
    p.step(t, 0.5 * h, mended, start)
    middle = p.signals()
    ramped = mended.command + mended.rate * 0.5 * h
    p.step(t + 0.5 * h, 0.5 * h, _Law(ramped, mended.gain, mended.rate), start)
    # Simpson's mean for the controller's states, where the first pass took the trapezoid's: the
    # difference shows what neither can see of signals that move fast within the step.
    c.advance(t, h, (start + 4.0 * middle + p.signals()) / 6.0, reference)
    return plain, _orthonormalized(p, c)

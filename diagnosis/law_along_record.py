"""The friction laws along a given motion, compiled: what the estimator fits.

Between two samples the velocity is taken as constant, and g(v) as moving evenly; then every law
here has an exact step, which is stable however stiff the law is. The equations are those of
``plant``, and a test compares each with a stiff solver on them. Every parameter comes twice, for
motion forwards and backwards.

A law is three functions here: the friction at a sample, the step to the next, and how a motion to
and fro below what samples show wears the deflection down. Compiled code cannot be handed functions,
so that a law goes by its number in `KINDS`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .compiled import compiled, compiled_in_place, compiled_lean

Vector = npt.NDArray[np.float64]
Bounds = npt.NDArray[np.int64]

KINDS = {
    "lugre": 0,
    "modified_lugre": 0,
    "directional_lugre": 0,
    "dahl": 1,
    "bliman_sorine": 2,
    "maxwell_slip": 3,
    "classical": 4,
}
_DAHL, _BLIMAN_SORINE, _MAXWELL_SLIP, _CLASSICAL = 1, 2, 3, 4
ELEMENTS = 4  # of Maxwell slip
STATES = 2 * ELEMENTS  # of any law
_LUGRE = 6  # parameters of the LuGre laws
_GAP_PARTS = 8  # steps between two samples
_SLOWEST_SLIP = 1e-7  # of the plant's Maxwell-slip law [m/s]


@compiled_lean
def friction_along(
    kind: int,
    x: Vector,
    v: Vector,
    step: Vector,
    starts: Bounds,
    shifts: Vector,
    shaking: Vector,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
    friction: Vector,
    state: Vector,
) -> None:
    """A law along several records, laid end to end.

    Parameters
    ----------
    kind : int
        One of `KINDS`.
    x, v : ndarray, shape (n,)
        Position [m] and velocity [m/s] at the samples.
    step : ndarray, shape (records,)
        Sampling intervals [s].
    starts : ndarray of int, shape (records + 1,)
        First sample of each record; the last entry is n.
    shifts : ndarray, shape (records,)
        Displacement of each record before its first sample, from a state without force [m].
    shaking : ndarray, shape (records,)
        Mean speed of a motion to and fro that the samples do not show; it wears the deflection
        down without getting anywhere [m/s].
    forwards, backwards : ndarray
        The law's parameters, in the order of the estimator's ``LAWS``, by direction of motion.
        LuGre's sigma0 goes with the side to which the bristles are bent.
    sharpness : float
        Kv of the modified law [s/m]; 0 for abs(v) itself.
    friction : ndarray, shape (n,)
        Filled [N].
    state : ndarray, shape (STATES,)
        Room to work in.
    """
    for r in range(len(starts) - 1):
        h = step[r]
        state[:] = 0.0
        if shifts[r] != 0.0:
            # slow, as far as the law is concerned: no sample saw it
            _move(kind, state, shifts[r], math.inf, 0.0, 0.0, forwards, backwards, sharpness)
        for k in range(starts[r], starts[r + 1]):
            friction[k] = _friction(kind, state, v[k], forwards, backwards, sharpness)
            if k + 1 == starts[r + 1]:
                break
            _wear(kind, state, shaking[r] * h, v[k], forwards, backwards)
            d = x[k + 1] - x[k]
            if d != 0.0:
                _move(kind, state, d, h, v[k], v[k + 1], forwards, backwards, sharpness)


@compiled_lean
def mean_friction_along(
    kind: int,
    x: Vector,
    v: Vector,
    step: float,
    parts: int,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
    friction: Vector,
    state: Vector,
) -> None:
    """A law along one record, on average over the interval after each sample.

    Between samples the motion is the cubic through both positions and velocities, in `parts` steps.

    Parameters
    ----------
    x, v : ndarray, shape (n,)
        [m], [m/s]
    step : float
        Sampling interval [s].
    parts : int
    friction : ndarray, shape (n,)
        Filled; the last is that of the interval before [N].
    state : ndarray, shape (STATES,)
        Zeros to work in.
    """
    h = step / parts
    place, pace = x[0], v[0]
    for k in range(len(x) - 1):
        mean = (x[k + 1] - x[k]) / step
        left, right = v[k] - mean, v[k + 1] - mean
        total = 0.5 * _friction(kind, state, pace, forwards, backwards, sharpness)
        for j in range(1, parts + 1):
            s = j / parts
            bend = s * (1.0 - s) * step * ((1.0 - s) * left - s * right)
            after = x[k] + s * (x[k + 1] - x[k]) + bend
            then = v[k] + s * (v[k + 1] - v[k])
            if after != place:
                _move(kind, state, after - place, h, pace, then, forwards, backwards, sharpness)
            place, pace = after, then
            weight = 1.0 if j < parts else 0.5
            total += weight * _friction(kind, state, pace, forwards, backwards, sharpness)
        friction[k] = total / parts
    friction[-1] = friction[-2]


@compiled_lean
def force_behind_spring(
    kind: int,
    x: Vector,
    v: Vector,
    step: float,
    stiffness: float,
    mass: float,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
    force: Vector,
    state: Vector,
) -> None:
    """Force of a spring that drags a block with a law where `x` goes on the spring's other side.

    The spring's own damping is a tenth of critical, as of machine parts.

    Parameters
    ----------
    x, v : ndarray, shape (n,)
        Motion before the spring [m], [m/s].
    step : float
        Sampling interval [s].
    stiffness, mass : float
        [N/m], [kg]
    force : ndarray, shape (n,)
        Filled [N].
    state : ndarray, shape (STATES,)
        Zeros to work in.
    """
    block, speed, accelerated = x[0], v[0], 0.0
    damping = 0.2 * math.sqrt(stiffness * mass)
    rate = math.sqrt(stiffness / mass)
    parts = max(4, math.ceil(step * rate / 0.15))
    h = step / parts
    for k in range(1, len(x)):
        mean = (x[k] - x[k - 1]) / step
        total = 0.0
        for j in range(parts):
            s = (j + 1.0) / parts
            # the cubic through both samples and velocities
            left, right = v[k - 1] - mean, v[k] - mean
            bend = s * (1.0 - s) * step * ((1.0 - s) * left - s * right)
            place = x[k - 1] + s * (x[k] - x[k - 1]) + bend
            pace = v[k - 1] + s * (v[k] - v[k - 1])
            friction = _friction(kind, state, speed, forwards, backwards, sharpness)
            # implicit in what joins the two: stable however stiff
            pull = stiffness * (place - block - h * speed) + damping * (pace - speed)
            accelerated = (pull - friction) / (mass + h * damping + h * h * stiffness)
            before = speed
            speed += h * accelerated
            d = h * speed
            if d != 0.0:
                _move(kind, state, d, h, before, speed, forwards, backwards, sharpness)
            block += d
            total += stiffness * (place - block) + damping * (pace - speed)
        force[k - 1] = total / parts
    force[-1] = force[-2]


@compiled_lean
def force_behind_gap(
    kind: int,
    x: Vector,
    v: Vector,
    step: float,
    gap: float,
    mass: float,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
    force: Vector,
    state: Vector,
) -> None:
    """Force on what pushes a block with a law across a gap, which it hangs in the middle of first.

    Contact is lost where the block would have to be pulled, be it by friction or by its mass, and
    made again without a rebound.

    Parameters
    ----------
    x, v : ndarray, shape (n,)
        Motion of what pushes [m], [m/s].
    step : float
        Sampling interval [s].
    gap, mass : float
        [m], [kg]
    force : ndarray, shape (n,)
        On average over the interval after each sample; filled [N].
    state : ndarray, shape (STATES,)
        Zeros to work in.
    """
    block, speed, side, pushed = x[0], 0.0, 0.0, v[0]
    h = step / _GAP_PARTS
    for k in range(len(x) - 1):
        mean = (x[k + 1] - x[k]) / step
        left, right = v[k] - mean, v[k + 1] - mean
        pull = (v[k + 1] - v[k]) / step
        total = 0.0
        for j in range(1, _GAP_PARTS + 1):
            s = j / _GAP_PARTS
            bend = s * (1.0 - s) * step * ((1.0 - s) * left - s * right)
            push = x[k] + s * (x[k + 1] - x[k]) + bend
            pushed = v[k] + s * (v[k + 1] - v[k])
            before = speed
            if side != 0.0:
                place = push - side * 0.5 * gap
                speed = pushed
                if place != block:
                    _move(
                        kind, state, place - block, h, before, speed, forwards, backwards, sharpness
                    )
                block = place
                contact = mass * pull + _friction(
                    kind, state, speed, forwards, backwards, sharpness
                )
                if side * contact < 0.0:
                    contact, side = 0.0, 0.0
                total += contact
                continue
            speed -= h / mass * _friction(kind, state, speed, forwards, backwards, sharpness)
            place = block + h * speed
            off = push - place
            if abs(off) > 0.5 * gap:
                side = 1.0 if off > 0.0 else -1.0
                place = push - side * 0.5 * gap
                total += mass * (pushed - speed) / h
                speed = pushed
            if place != block:
                _move(kind, state, place - block, h, before, speed, forwards, backwards, sharpness)
            block = place
        force[k] = total / _GAP_PARTS
    force[-1] = force[-2]


@compiled_in_place
def _stribeck(v: float, fc: float, fs: float, vs: float) -> float:
    return fc + (fs - fc) * math.exp(-((v / vs) ** 2))


@compiled_in_place
def _bent(v: float, q: Vector) -> float:
    """LuGre's curve; with two more parameters, one more bend of it at low speed."""
    g = _stribeck(v, q[3], q[4], q[5])
    if len(q) > _LUGRE:
        g += q[_LUGRE] * math.exp(-((v / q[_LUGRE + 1]) ** 2))
    return g


@compiled_in_place
def _friction(
    kind: int, state: Vector, v: float, forwards: Vector, backwards: Vector, sharpness: float
) -> float:
    """Friction at a sample [N]."""
    q = forwards if v > 0.0 else backwards
    if kind == _DAHL:
        return state[0]  # type: ignore[no-any-return]
    if kind == _BLIMAN_SORINE:
        return state[0] + state[1]  # type: ignore[no-any-return]
    if kind == _MAXWELL_SLIP:
        return state[:ELEMENTS].sum() + q[2 * ELEMENTS + 1] * v  # type: ignore[no-any-return]
    if kind == _CLASSICAL:
        s = 1.0 if v > 0.0 else -1.0
        return s * _stribeck(v, q[1], q[2], q[3]) + q[0] * v  # type: ignore[no-any-return]
    z = state[0]
    b = forwards if z > 0.0 else backwards
    g = _bent(v, q)
    if sharpness > 0.0:
        s = 2.0 / math.pi * math.atan(sharpness * v)
        rate = s * s * v - b[0] * s * v * z / g
    else:
        rate = v - b[0] * abs(v) * z / g
    return b[0] * z + q[1] * rate + q[2] * v  # type: ignore[no-any-return]


@compiled_in_place
def _wear(
    kind: int, state: Vector, way: float, v: float, forwards: Vector, backwards: Vector
) -> None:
    """What going `way` to and fro [m] leaves of the deflection."""
    q = forwards if v > 0.0 else backwards
    if kind == _DAHL:
        state[0] *= math.exp(-q[0] * way / q[1])
    elif kind == _BLIMAN_SORINE:
        state[0] *= math.exp(-way / (q[3] * q[2]))
        state[1] *= math.exp(-way / q[2])
    elif kind == _MAXWELL_SLIP:
        for i in range(ELEMENTS):
            state[i] *= math.exp(-q[i] * way / (q[ELEMENTS + i] * q[2 * ELEMENTS + 3]))
    elif kind != _CLASSICAL:
        b = forwards if state[0] > 0.0 else backwards
        state[0] *= math.exp(-b[0] * way / q[4])


@compiled_in_place
def _move(
    kind: int,
    state: Vector,
    d: float,
    h: float,
    before: float,
    after: float,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
) -> None:
    """Take the state over the displacement `d` [m] in `h` [s], between two velocities [m/s]."""
    s = 1.0 if d > 0.0 else -1.0
    q = forwards if d > 0.0 else backwards
    if kind == _DAHL:
        left = max(1.0 - s * state[0] / q[1], 0.0)
        run = q[0] / q[1] * abs(d)
        if abs(q[2] - 1.0) < 1e-9:
            left *= math.exp(-run)
        elif left > 0.0:
            base = left ** (1.0 - q[2]) - (1.0 - q[2]) * run
            left = base ** (1.0 / (1.0 - q[2])) if base > 0.0 else 0.0
        state[0] = s * q[1] * (1.0 - left)
    elif kind == _BLIMAN_SORINE:
        slow = math.exp(-abs(d) / q[2])
        fast = math.exp(-abs(d) / (q[2] * q[3]))
        state[0] = s * q[0] + (state[0] - s * q[0]) * fast
        state[1] = -s * q[1] + (state[1] + s * q[1]) * slow
    elif kind == _MAXWELL_SLIP:
        _move_elements(state, d, h, before, after, q)
    elif kind != _CLASSICAL:
        _move_bristles(state, d, h, before, after, forwards, backwards, sharpness)


@compiled_in_place
def _move_bristles(
    state: Vector,
    d: float,
    h: float,
    before: float,
    after: float,
    forwards: Vector,
    backwards: Vector,
    sharpness: float,
) -> None:
    q = forwards if d > 0.0 else backwards
    s = 1.0 if d > 0.0 else -1.0
    z, w = state[0], d / h
    if sharpness > 0.0 and h < math.inf:
        s = 2.0 / math.pi * math.atan(sharpness * w)
    if before * d > 0.0 and after * d > 0.0:
        first = _bent(before, q)
        last = _bent(after, q)
    else:
        first = last = _bent(w, q)
    g = 0.5 * (first + last)
    way = s * d
    if z * s < 0.0:  # bent to the other side: first back to nothing
        b = backwards if d > 0.0 else forwards
        rest = s * g / b[0]
        back = g / b[0] * math.log(1.0 - z / rest)
        if back >= way:
            state[0] = rest + (z - rest) * math.exp(-b[0] * way / g)
            return
        way -= back
        z = 0.0
    # towards a rest that moves evenly from that of the first velocity to the last's
    run = q[0] * way / g
    if run > 0.0:
        gone = -math.expm1(-run)
        begin, end = s * first / q[0], s * last / q[0]
        z = end + (z - begin) * (1.0 - gone) - (end - begin) * gone / run
    state[0] = z


@compiled_in_place
def _move_elements(
    state: Vector, d: float, h: float, before: float, after: float, q: Vector
) -> None:
    """Maxwell slip: forces of the elements, then 1 or -1 for each that slips that way, or 0."""
    s = 1.0 if d > 0.0 else -1.0
    attraction, fc, fs, vs = q[2 * ELEMENTS], q[2 * ELEMENTS + 2], q[-2], q[-1]
    if before * d > 0.0 and after * d > 0.0:
        first, last = _stribeck(before, fc, fs, vs), _stribeck(after, fc, fs, vs)
    else:
        first = last = _stribeck(d / h, fc, fs, vs)
    g = 0.5 * (first + last)
    for i in range(ELEMENTS):
        share = q[ELEMENTS + i]
        left = 1.0  # share of the step in which the element slips
        if state[ELEMENTS + i] * s <= 0.0:
            state[ELEMENTS + i] = 0.0
            loaded = state[i] + q[i] * d
            if s * loaded < share * g:
                state[i] = loaded
                continue
            left = min(max((loaded - s * share * g) / (q[i] * d), 0.0), 1.0)
            state[i] = s * share * (first + (last - first) * (1.0 - left))
            state[ELEMENTS + i] = s
        if h == math.inf:
            continue
        run = attraction * left * h / g / (1.0 + _SLOWEST_SLIP * h / abs(d))
        if run > 0.0:
            gone = -math.expm1(-run)
            begin, end = s * share * (last + (first - last) * left), s * share * last
            state[i] = end + (state[i] - begin) * (1.0 - gone) - (end - begin) * gone / run


@compiled
def score(
    force: Vector,
    predicted: Vector,
    spread: Vector,
    count: float,
    gradient: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    cost_only: bool,
) -> float:
    """Minus the log-likelihood of force samples that were rounded to counts.

    Parameters
    ----------
    force, predicted, spread : ndarray, shape (n,)
        Measured and predicted force and the standard deviation before rounding [N].
    count : float
        Resolution of the load cell [N]; 0 for none.
    gradient : ndarray, shape (2, n)
        Filled with the derivatives of the log-likelihood by the prediction and by the spread [1/N].
    information : ndarray, shape (3, n)
        Filled with the expected products of these two: prediction twice, both, spread twice
        [1/N^2], unless `cost_only`.
    """
    total = 0.0
    root2 = math.sqrt(2.0)
    bell = 1.0 / math.sqrt(2.0 * math.pi)
    # a density times the count is the probability of the count
    density = math.log(bell) + (math.log(count) if count > 0.0 else 0.0)
    for k in range(len(force)):
        s = spread[k]
        off = force[k] - predicted[k]
        if count <= 0.3 * s:  # finer than the noise: rounding is one more variance
            variance = s * s + count * count / 12.0
            total += 0.5 * off * off / variance + 0.5 * math.log(variance) - density
            gradient[0, k] = off / variance
            gradient[1, k] = (off * off / variance - 1.0) * s / variance
            information[0, k] = 1.0 / variance
            information[1, k] = 0.0
            information[2, k] = 2.0 * s * s / (variance * variance)
            continue
        high = (off + 0.5 * count) / s
        low = (off - 0.5 * count) / s
        # the tail on the far side keeps its digits
        if low > 0.0:
            mass = 0.5 * (math.erfc(low / root2) - math.erfc(high / root2))
        else:
            mass = 0.5 * (math.erfc(-high / root2) - math.erfc(-low / root2))
        if mass > 1e-250:
            total -= math.log(mass)
            at_low = bell * math.exp(-0.5 * low * low) / s
            at_high = bell * math.exp(-0.5 * high * high) / s
            gradient[0, k] = (at_low - at_high) / mass
            gradient[1, k] = (low * at_low - high * at_high) / mass
        else:  # far out: the nearest edge of the count decides
            edge = low if low > 0.0 else high
            total += 0.5 * edge * edge + math.log(abs(edge)) - math.log(bell)
            gradient[0, k] = edge / s
            gradient[1, k] = edge * edge / s
        if cost_only:
            continue
        # expected information: sum over all counts that the sample might have fallen into
        reach = math.ceil(5.0 * s / count) + 1
        first = math.floor(off / count + 0.5)
        shift = off - first * count
        twice = 0.0
        both = 0.0
        spread_twice = 0.0
        for j in range(-reach, reach + 1):
            b = (shift + (j + 0.5) * count) / s
            a = (shift + (j - 0.5) * count) / s
            if a > 0.0:
                chance = 0.5 * (math.erfc(a / root2) - math.erfc(b / root2))
            else:
                chance = 0.5 * (math.erfc(-b / root2) - math.erfc(-a / root2))
            if chance > 1e-12:
                at_a = bell * math.exp(-0.5 * a * a) / s
                at_b = bell * math.exp(-0.5 * b * b) / s
                moved = at_a - at_b
                widened = a * at_a - b * at_b
                twice += moved * moved / chance
                both += moved * widened / chance
                spread_twice += widened * widened / chance
        information[0, k] = twice
        information[1, k] = both
        information[2, k] = spread_twice
    return total

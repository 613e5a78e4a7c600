"""The equilibrium near a state, and its eigenvalues: of equations, or of a map between samples."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from ..orchestration.loop.whole_loop import STARTED, term_name
from ..orchestration.master.reference_signal import TERMS
from ..solver.arrays import Matrix, Vector
from ..solver.kernel import Model
from ..solver.spectrum import check_all_are_states, follow_tangents

NEUTRAL = 1e-11  # share of the Jacobian's largest entry below which an eigenvalue is zero
SAME_INSTANT = 1e-6  # share of the sampling period, as in the core
FALLEN = 40.0  # time constants
FAST = 1e-6  # share of the map's largest eigenvalue: smaller ones have lost digits
FOLLOWED = 20  # samples
_NEWTON = 30
ROUNDED = 64  # points at which a Jacobian is evaluated
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
INSTANTS = 2000  # at which the effect of time on an equilibrium is tested
SIDE = 1e-9  # share of the way from an equilibrium to the motion, at which it is linearized
_CLOSE = 1e-6  # nominal magnitudes: round-off moves it so far if an eigenvalue is nearly zero


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium and its linear part.

    Attributes
    ----------
    state : ndarray, shape (n,)
        On the side from which the motion comes: a law with a kink at rest, such as LuGre friction
        at zero velocity, has another linear part on the other side.
    eigenvalues : ndarray of complex, shape (n,)
        Of the Jacobian [1/s], largest real part first; zeros along a set of equilibria. For a
        sampled system: logarithms of its map's eigenvalues over the sampling period, minus infinity
        for directions that vanish within a sample.
    neutral : int
        Number of zero eigenvalues: the dimension of the set of equilibria that includes this one.
    drift : float
        Speed of the model's state along neutral directions [nominal magnitudes/s]: an integral that
        grows while a block sticks is no rest, although no eigenvalue shows it.
    error : ndarray, shape (n,), or None
        Error of the real parts by round-off in the Jacobian [1/s], see `with_round_off`.
    """

    state: Vector
    eigenvalues: npt.NDArray[np.complex128]
    neutral: int
    drift: float
    error: Vector | None = None

    @property
    def slowest(self) -> float:
        """Real part of the first eigenvalue that is not zero [1/s]; zero if all are."""
        rest = self.eigenvalues[self.eigenvalues != 0.0]
        return float(rest.real.max(initial=-np.inf)) if len(rest) else 0.0


@contextmanager
def unchanged(model: Model) -> Iterator[None]:
    """The model's state, held values and counters are the same again at the end."""
    kept = model.x.copy(), model.u.copy(), model.info.copy()
    try:
        yield
    finally:
        model.x[:], model.u[:], model.info[:] = kept


def sample_after(model: Model, time: float) -> float:
    """The first sample instant that is not before this time; without samples, the time itself."""
    period = model.sample_time
    return float(np.ceil(time / period - SAME_INSTANT) * period) if period else time


def equilibrium_near(model: Model, time: float) -> Equilibrium | None:
    """The equilibrium nearest to the model's present state; None if Newton's method finds none.

    If equilibria form a line, it is the one that the shortest steps lead to. The model is not
    changed; ValueError for discrete states or delayed signals that are none of the states.
    """
    check_all_are_states(model)
    # Over nominal magnitudes, so that a state's size does not depend on its unit.
    nominal = model.kernel.nominal
    linearize = _sample_map if model.sample_time else _rates
    point = model.x.copy()
    change, a = linearize(model, time, point)
    first = change
    for _ in range(_NEWTON):
        if not (np.isfinite(change).all() and np.isfinite(a).all()):
            return None
        step = _shortest_solution(a, change) * nominal
        point = point - step
        change, a = linearize(model, time, point)
        if np.all(np.abs(step) <= _CLOSE * nominal):
            break
    else:
        return None
    point = point - _shortest_solution(a, change) * nominal
    point = point + SIDE * (model.x - point)
    _, a = linearize(model, time, point)
    values = np.linalg.eigvals(a).astype(complex)
    zero = NEUTRAL * float(np.abs(a).max(initial=0.0))
    if model.sample_time:  # the map is as accurate as its solver
        zero = max(zero, 10.0 * model.tolerance)
    neutral = np.abs(values) <= zero
    if model.sample_time:
        values = _rates_between_samples(model, time, point, np.asarray(values + 1.0, np.complex128))
    values = np.where(neutral, 0.0, values)
    values = values[np.argsort(-values.real)]
    found = Equilibrium(point, values, int(neutral.sum()), 0.0)
    return replace(found, drift=_drift(a, first, found.slowest, model.sample_time))


def with_round_off(
    model: Model, time: float, found: Equilibrium, earlier: Vector | None = None
) -> Equilibrium:
    """The equilibrium with better eigenvalues and their error; unchanged for sampled systems.

    They are those on the side of an `earlier` state, if it is given.

    A linearizing controller cancels large entries of the Jacobian. The difference has few digits,
    and eigenvalues that are sensitive to it have fewer. Jacobians are computed at points that
    differ by a few units in the last place: their scatter is the round-off, and their mean has more
    digits.
    """
    if model.sample_time:
        return found
    units = np.random.default_rng(0).integers(-8, 9, (ROUNDED, len(found.state)))
    state = found.state if earlier is None else found.state + SIDE * (earlier - found.state)
    points = state * (1.0 + np.finfo(float).eps * units)
    jacobians = np.array([_rates(model, time, x)[1] for x in points])
    mean = jacobians.mean(axis=0)
    values = np.linalg.eigvals(mean).astype(complex)
    values[np.abs(values) <= NEUTRAL * float(np.abs(mean).max(initial=0.0))] = 0.0
    values = values[np.argsort(-values.real)]
    each = -np.sort(-np.linalg.eigvals(jacobians).real, axis=1)
    error = np.where(values == 0.0, 0.0, np.ptp(each, axis=0))
    return replace(found, eigenvalues=values, error=error)


def stands(model: Model, time: float, span: float, state: Vector, within: float) -> bool:
    """Whether an equilibrium and its mode do not change over this time.

    The equations are evaluated at many instants: the solver takes long steps at rest, and may step
    over the moment when a swinging force moves a sticking body. The instants are not on a grid,
    because a grid may have the same phase in each period. Mode and held values are the model's; the
    equilibrium may move by `within` nominal magnitudes.
    """
    if not _time_moves(model):
        return True
    nominal = model.kernel.nominal
    before, due = np.zeros(model.kernel.events), np.zeros(model.kernel.events)
    model.system.indicate(time, state, model.u, model.p, before)
    rates, a = _rates(model, time, state)
    moved = np.empty((len(nominal), INSTANTS))
    for k, share in enumerate(np.arange(1, INSTANTS + 1) * GOLDEN % 1.0):
        then = time + share * span
        model.system.indicate(then, state, model.u, model.p, due)
        if np.any((due > 0.0) & (before <= 0.0)):
            return False
        moved[:, k] = model.derivatives(then, state) / nominal - rates
    shift = np.linalg.lstsq(a, moved, rcond=1e-11)[0]
    left = moved - a @ shift  # no shift compensates this part, so it accumulates
    return bool(np.abs(shift).max() <= within and np.abs(left).max() * span <= within)


def is_driven(model: Model, time: float, span: float) -> bool:
    """Whether time alone changes rates or indicators, in the present state and mode.

    Equations contain the time if a set-point can move, even if it does not.
    """
    if not _time_moves(model):
        return False

    def asked(then: float) -> Vector:
        due = np.zeros(model.kernel.events)
        model.system.indicate(then, model.x, model.u, model.p, due)
        return np.concatenate([model.derivatives(then, model.x), due])

    here = asked(time)
    return any(np.any(asked(time + k * GOLDEN % 1.0 * span) != here) for k in range(1, 20))


def _time_moves(model: Model) -> bool:
    """Whether an equation contains the time, except for a set-point that stands still."""
    columns = {i.name: k for k, i in enumerate(model.kernel.inputs)}
    terms = [
        columns[name]
        for i in model.kernel.inputs
        for power in range(1, TERMS)
        if (name := term_name(i.name, power)) in columns
    ]
    return _holds_time(model.kernel.source, bool(terms) and not model.u[terms].any())


@cache
def _holds_time(source: str, still: bool) -> bool:
    """Whether an equation of a kernel contains the time; without set-points if `still`."""
    lines = (line for line in source.splitlines() if not line.startswith("def "))
    since = rf"\bt - {STARTED}_\b" if still else "$^"
    return any(re.search(r"\bt\b", re.sub(since, "", line)) for line in lines)


def _drift(a: Matrix, change: Vector, slowest: float, period: float) -> float:
    """The rest of a change, per second, after all decaying parts have decayed, if none grows."""
    left = change
    if slowest < 0.0 and period:
        times = max(len(a), math.ceil(FALLEN / (-slowest * period)))
        left = np.linalg.matrix_power(a + np.eye(len(a)), times) @ change
    elif slowest < 0.0:  # else nothing decays: for example a block on a belt, or a clock
        left = expm(a * (FALLEN / -slowest)) @ change
    return float(np.abs(left).max(initial=0.0) / (period or 1.0))


def _rates_between_samples(
    model: Model, time: float, point: Vector, factors: npt.NDArray[np.complex128]
) -> npt.NDArray[np.complex128]:
    """The map's eigenvalues as rates [1/s]; small ones from tangents, which lose no digits."""
    period = model.sample_time
    by_size = np.argsort(-np.abs(factors))
    small = np.abs(factors) <= FAST * np.abs(factors).max()
    rates = np.zeros(len(factors), complex)
    rates[~small] = np.log(factors[~small] + 0j) / period
    if small.any():
        grid = sample_after(model, time) + period * np.array([0.0, FOLLOWED, 2.0 * FOLLOWED])
        with unchanged(model):
            model.x[:] = point
            run = follow_tangents(model, grid)
        with np.errstate(invalid="ignore"):
            late = (run.growth[-1] - run.growth[-2]) / (FOLLOWED * period)
        late = -np.sort(-np.where(np.isnan(late), -np.inf, late))
        rates[by_size[-int(small.sum()) :]] = late[-int(small.sum()) :]
    return rates


def _rates(model: Model, time: float, point: Vector) -> tuple[Vector, Matrix]:
    """Rates of the states and the Jacobian, over nominal magnitudes."""
    nominal = model.kernel.nominal
    a = model.jacobian(time, point) * nominal[None, :] / nominal[:, None]
    return model.derivatives(time, point) / nominal, a


def _sample_map(model: Model, time: float, point: Vector) -> tuple[Vector, Matrix]:
    """Change of the states from one sample to the next and its slopes, over nominal magnitudes."""
    nominal = model.kernel.nominal
    n, held = len(nominal), model.u.copy()
    start = sample_after(model, time)
    grid = np.array([start, start + model.sample_time])
    columns = np.empty((n, n))
    with unchanged(model):
        for k, axis in enumerate(np.eye(n)):
            model.x[:], model.u[:] = point, held
            run = follow_tangents(model, grid, 1, axis[None, :])
            if run.failure:
                return np.full(n, np.nan), np.full((n, n), np.nan)
            columns[:, k] = run.frame[0] * np.exp(run.growth[-1, 0])
        change = (model.x - point) / nominal
    return change, columns * nominal[None, :] / nominal[:, None] - np.eye(n)


def _shortest_solution(a: Matrix, b: Vector) -> Vector:
    """Least squares; directions that are dependent, or nearly, are not moved."""
    # a friction law's deflection that hardly moves any more must not be moved along the line of
    # equilibria only to make its last small rate zero
    return np.asarray(np.linalg.lstsq(a, b, rcond=1e-11)[0])

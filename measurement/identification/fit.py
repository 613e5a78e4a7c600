"""Our estimator: a friction law integrated along the recorded motion, fitted to the force.

The measured force is mass times acceleration plus the law's friction, delayed by an unknown
fraction of a sampling interval, plus noise, rounded to the load cell's resolution. The likelihood
is that of the rounded samples. The error of the position adds to the standard deviation of a sample
through the slope of friction over displacement. These are also unknown, each with a prior standard
deviation:

- the delay between force and motion, one for each sampling interval that occurs;
- the displacement of each record before its first sample, of the size of the position's error, or
  free if the force at the start of a record is not zero;
- the scale of each record's position, if its sensor has a calibration error;
- the speed of a vibration of each record's body that its position does not show;
- if requested, a constant force in addition to friction: a load or the zero of the load cell.

The classical law does not give the force of a block that sticks. There, only the largest force
before each break-away is used, which is Fs.

The maximum is found by Fisher scoring on the logarithms of the parameters, or on other coordinates
that suit the law, see `FittedLaw.values_at`. Known parameters may be fixed. Standard errors come
from the scores of pieces of the records. Pieces are taken as independent, so correlated residuals
within a piece are allowed. The scores are corrected for leverage, and intervals use Student's t for
the number of pieces. Standard errors are never smaller than those of the likelihood without its
information on the delays, and never smaller than `FLOOR`.

Filters, buses and loggers delay one signal more than another. A fit gives the delay to within a
sample or two, so a larger one is taken out step by step, with a new fit after each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ...fmus.units import base_exponents
from ...plant.law import law as law_of
from ...solver.arrays import Vector
from ...solver.component import symbol
from ..records.record import Record
from .fit_errors import FLOOR, sum_up
from .fitted_law import MASS, OFFSET, FittedLaw, claim_of, fitted_law, name_and_end
from .intervals import Fit, Interval
from .layout import StackedRecords, lay_out
from .left_over import LeftOver, left_over
from .likelihood import Climb, Problem
from .motion_parts import least_squares, way_since_reversal

Start = dict[str, float]
Progress = Callable[[str], None]

_FAST = 0.3  # share of the fast speed above which the curve is nearly straight
_SLOWEST = 0.005  # share of the fast speed above which the body moves


def fit_along(
    records: Sequence[Record],
    law: str,
    course: StackedRecords | None = None,
    tied: bool | None = None,
    guess: Mapping[str, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    beside: Collection[str] = (),
    progress: Progress = lambda _: None,
) -> Fit:
    """Fit the parameters of a law to the force of the records.

    Parameters
    ----------
    records : sequence of Record
    law : str
        One of `plant.LAWS`.
    course : StackedRecords, optional
        The stacked records, if already computed.
    tied : bool, optional
        Whether both directions have the same parameters; by default as in the law.
    guess : mapping of str to float, optional
        First guesses of all parameters.
    fixed : mapping of str to float, optional
        Values of fixed parameters, by the law's names. They hold in both directions, unless the
        name ends in ``_pos`` or ``_neg``. `OFFSET` may also be fixed.
    beside : collection of str, optional
        Parameters fitted in addition to the law: `OFFSET`, a constant force [N]; `MASS`, one for
        all records, which must have the same mass.
    progress : callable, optional
        Called with what is being done.
    """
    guess, fixed, mass = guess or {}, fixed or {}, MASS in beside
    own = fitted_law(law)
    apart = own.directional if tied is None else not tied
    described = replace(own, directional=apart, mass=mass, offset=OFFSET in {*beside, *fixed})
    course = lay_out(records) if course is None else course
    constant = fixed.get(OFFSET, guess.get(OFFSET, 0.0))
    if guess:
        starts = [np.ones(len(own.parameters))]
        course = course.with_mass(guess[MASS]) if mass else course
    else:
        sliding = _fast_sliding(course, replace(described, offset=OFFSET in beside), constant)
        course = course.with_mass(sliding[MASS]) if mass else course
        constant = sliding[OFFSET]
        starts = _starts(course, described, sliding)
    problem = Problem(course, described)
    names = described.names + described.beside
    held = [j for j, n in enumerate(names) if n in fixed or name_and_end(n)[0] in fixed]
    beside_it = [np.log([course.mass])] if mass else []
    beside_it += [np.array([constant])] if described.offset else []
    found: list[tuple[float, Climb, StackedRecords]] = []
    seen: list[Vector] = []
    for count, start in enumerate(starts, 1):
        progress(f"fitting {law}: first guess {count} of {len(starts)}")
        first = []
        for end in described.ends:
            side = dict(zip(own.parameters, map(float, start), strict=True))
            for given in (guess, fixed):
                side = {n: given.get(n + end, given.get(n, v)) for n, v in side.items()}
            first.append(own.coordinates_of(np.array([*side.values()])))
        problem.course = course
        climb = Climb(problem, np.concatenate([*first, *beside_it]), held)
        climb.run(12)
        seen.append(climb.coordinates.copy())
        # two searches closer than the smallest standard error are one
        if any(np.abs(seen[-1] - s).max() < FLOOR for s in seen[:-1]):
            continue
        for k in range(1, 4):  # with the errors of the motion at its own parameters
            progress(f"fitting {law}: fit {k} of 3")
            climb.look_back()
            cost = climb.run(25)
            if mass:  # the law's presliding distance and break-aways depend on the mass
                problem.course = course.with_mass(math.exp(climb.coordinates[problem.of_law]))
        found.append((cost if math.isfinite(cost) else math.inf, climb, problem.course))
    _, best, problem.course = min(found, key=lambda c: c[0])
    return sum_up(best, fixed)


def _fast_sliding(course: StackedRecords, law: FittedLaw, offset: float) -> Start:
    """Mass [kg], constant force and viscous friction [N s/m], where friction is nearly a line.

    A column that the motion does not show is left out: a constant force with one direction, a
    viscous slope with one speed.
    """
    v, a = course.v, course.acceleration
    fast = np.abs(v) > _FAST * float(np.quantile(np.abs(v), 0.98))
    one_way = abs(float(np.sign(v[fast]).sum())) == np.count_nonzero(fast)
    one_speed = float(np.ptp(np.abs(v[fast]))) < 0.2 * float(np.abs(v[fast]).max())
    columns = {"dry": np.sign(v)}
    columns |= {} if one_speed else {"viscous": v}
    columns |= {OFFSET: np.ones(len(v))} if law.offset and not one_way else {}
    columns |= {MASS: a} if law.mass else {}
    target = course.force - offset - (0.0 if law.mass else course.inertial)
    amplitudes = least_squares(np.column_stack([*columns.values()])[fast], target[fast])
    none = {MASS: 0.0 if law.mass else course.mass, OFFSET: 0.0, "viscous": 0.0}
    found = none | dict(zip(columns, map(float, amplitudes), strict=True))
    # if the motion does not show a mass: a mass whose force is a tenth of the friction
    usual = 0.1 * course.level / max(float(np.quantile(np.abs(a), 0.98)), 1e-12)
    if law.mass and found[MASS] < 0.1 * usual:
        found[MASS] = usual
    return found | {OFFSET: offset + found[OFFSET]}


def _starts(course: StackedRecords, law: FittedLaw, sliding: Start) -> list[Vector]:
    """First guesses from rough features of the friction-velocity map."""
    friction = course.force - course.inertial - sliding[OFFSET]
    pull, speed = np.abs(friction), np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    high = max(float(np.quantile(pull, 0.97)), 1e-3)
    level = max(float(np.quantile(pull[speed > _FAST * top], 0.1)), 0.05 * high)
    dry = np.abs(friction - max(sliding["viscous"], 0.0) * course.v)
    most = max(float(np.quantile(dry, 0.97)), 1e-3)
    stiffness = []
    for part in course.parts():
        own, way = dry[part], np.abs(course.x[part] - course.x[part.start])
        early = (own > 0.15 * most) & (own < 0.6 * most) & (way > course.blur[part])
        early &= np.cumsum(own > 0.7 * most) == 0
        if np.any(early):
            stiffness.append(float(np.median(own[early] / way[early])))
    sigma = 1.3 * float(np.median(stiffness)) if stiffness else most / 3e-5
    if law.asks.guesses is None:
        starts = _scaled_defaults(law.name, high, sigma, top)
    else:
        stribeck = "Vs" in law.parameters
        curves = _stribeck_curves(course, friction, most / sigma) if stribeck else [{}]
        seen = {"stiffness": sigma, "sliding": level, "largest": high}
        starts = [guess | curve for curve in curves for guess in law.asks.guesses(seen | curve)]
    return [np.array([s[n] for n in law.parameters]) for s in starts]


def _stribeck_curves(course: StackedRecords, friction: Vector, yielding: float) -> list[Start]:
    """The three curves over the speed with the least squares, their Vs far from each other.

    Within a few presliding distances, `yielding` [m], the friction [N] is not the curve's.
    """
    pull, speed = friction * np.sign(course.v), np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    ways = [way_since_reversal(course.x[part], course.v[part])[0] for part in course.parts()]
    slid = (np.concatenate(ways) > 3.0 * yielding) & (speed > _SLOWEST * top)
    slid = slid if np.count_nonzero(slid) > 50 else speed > 0.3 * top
    found = []
    for width in np.geomspace(_SLOWEST, 4.0, 20) * top:
        fall = np.exp(-((speed[slid] / width) ** 2))
        columns = np.column_stack([np.ones(len(fall)), speed[slid], fall])
        found.append((*nnls(columns, pull[slid]), width))  # no part of the curve is negative
    curves: list[Start] = []
    for (dry, viscous, peak), _, width in sorted(found, key=lambda c: c[1]):
        if all(abs(math.log(width / c["Vs"])) > math.log(4.0) for c in curves):
            base = max(dry, 0.05 * float(pull.max()))
            slope = max(viscous, 0.02 * base / top)
            peak = np.clip(peak, 0.1 * base, float(pull.max()))  # may be that of no sample
            curves.append({"Fc": base, "Fs": base + peak, "Vs": width, "sigma2": slope})
    return curves[:3]


def _scaled_defaults(name: str, force: float, stiffness: float, speed: float) -> list[Start]:
    """First guesses for a law without other information: its defaults, scaled to the records.

    Newtons, metres and seconds are scaled such that friction and stiffness are about those of the
    records, and speeds are the defaults, a quarter of them, or four times them.
    """
    own = law_of(name)(symbol("v")).parameters
    newton = force / (abs(claim_of(name, "steady_state", {}, speed)) or force)
    metre = newton * (claim_of(name, "stiffness", {}) or stiffness) / stiffness
    starts = []
    for pace in (1.0, 0.25, 4.0):
        second = metre / pace
        size = {"kg": newton * second**2 / metre, "m": metre, "s": second}
        powers = {p.name: base_exponents(p.unit) for p in own}
        scales = {n: math.prod(size.get(b, 1.0) ** k for b, k in powers[n].items()) for n in powers}
        starts.append({p.name: p.default * scales[p.name] for p in own})
    return starts


@dataclass(frozen=True)
class FittedRecords:
    """Records laid end to end, a law fitted to them, and what it leaves."""

    records: list[Record]
    course: StackedRecords
    fit: Fit
    left: LeftOver

    @property
    def explained(self) -> bool:
        """Whether the law leaves not much more than noise."""
        return self.left.force <= 2.0 * self.left.noise

    @property
    def late(self) -> Interval:
        """Delay of the force after the motion; of several rates, the largest [s]."""
        put = [r.lags.get("force", 0.0) for r in self.records]
        late = zip((self.fit.late[int(c)] for c in self.course.clock), put, strict=True)
        return max((i.plus(p) for i, p in late), key=lambda i: abs(i.value))


def fit_late_records(
    records: Sequence[Record], law: str, fixed: Start, beside: Collection[str], progress: Progress
) -> FittedRecords:
    """Fit a law to records, and correct them by the force's delay until nothing certain is left.

    None is certain if some lags are known, if it may be within what was known before, or if the law
    does not explain the force: such a law takes its own error for a delay.
    """

    def fitted(records: list[Record], guess: Mapping[str, float] | None) -> FittedRecords:
        course = lay_out(records)
        fit = fit_along(records, law, course, None, guess, fixed, beside, progress)
        return FittedRecords(records, course, fit, left_over(course, fit))

    def beyond(late: Interval, known: float) -> bool:
        """Whether all of the interval is beyond twice what was known of the delay."""
        reach = math.inf if late.high is None else late.high - late.value
        return abs(late.value) > 2.0 * known + reach

    known = max(r.delay_std for r in records)
    first = last = fitted(list(records), None)
    for _ in range(8 * (not any(r.lags for r in records))):
        if not any(beyond(i, known if last is first else 0.0) for i in last.fit.late):
            break
        moved = []
        for record, clock in zip(last.records, last.course.clock, strict=True):
            step = last.fit.late[clock]
            total = record.lags.get("force", 0.0) + step.value
            spread = math.hypot(known, step.standard_error or 0.0)
            moved.append(replace(record, lags={"force": total}, delay_std=spread))
        before, last = last, fitted(moved, last.fit.values)
        if last.left.force > before.left.force:
            break
    return last if beyond(last.late, known) and last.explained else first

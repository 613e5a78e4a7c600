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
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...fmus.units import base_exponents
from ...plant.law import law as law_of
from ...plant.maxwell_slip import ELEMENTS
from ...plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ...solver.component import symbol
from ..records.record import Record
from .fit_errors import intervals_of, sum_up
from .fit_result import Fit, fitted_names, without_direction
from .fitted_law import LAWS, MASS, OFFSET, FittedLaw, claim_of
from .law_along_record import KINDS
from .layout import StackedRecords, lay_out
from .likelihood import Problem
from .motion_parts import least_squares, way_since_reversal
from .optimizer import Climb

Vector = npt.NDArray[np.float64]
Start = dict[str, float]

_FAST = 0.3  # share of the fast speed above which the curve is nearly straight
_SLID = 3.0  # presliding distances after a reversal, until the friction is that of sliding
_SLOWEST, _WIDTHS = 0.005, 15  # least Vs over the fast speed, and number of those tried
_APART = math.log(4.0)  # distance between the Vs of two first guesses
_STARTS = 3
_ENOUGH = 50  # samples in sliding
_UNTIL_COMPARED = 12  # iterations from each first guess; after five, the wrong one may be better


def fit_along(
    records: Sequence[Record],
    law: str,
    course: StackedRecords | None = None,
    tied: bool | None = None,
    guess: Mapping[str, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    beside: Collection[str] = (),
) -> Fit:
    """Fit the parameters of a law to the force of the records.

    Parameters
    ----------
    records : sequence of Record
    law : str
        One of `LAWS`.
    course : Course, optional
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
    """
    fixed = fixed or {}
    mass = MASS in beside
    described = replace(LAWS[law], offset=OFFSET in {*beside, *fixed}, mass=mass)
    tied = not described.directional if tied is None else tied
    course = lay_out(records) if course is None else course
    constant = fixed.get(OFFSET, (guess or {}).get(OFFSET, 0.0))
    if guess:
        starts = [np.ones(len(described.parameters))]
        course = course.with_mass(guess[MASS]) if mass else course
    else:
        sliding = _fast_sliding(course, replace(described, offset=OFFSET in beside), constant)
        course = course.with_mass(sliding.mass) if mass else course
        constant = sliding.offset
        starts = _starts(course, described, sliding)
    problem = Problem(course, described, tied)
    best: Climb | None = None
    lowest = math.inf
    names, _ = fitted_names(described, tied)
    held = [j for j, n in enumerate(names) if n in fixed or without_direction(n) in fixed]
    hidden: Vector | None = None  # from the first guess, so that costs are comparable
    for start in starts:
        sides = [start] if tied else [start, start.copy()]
        for side, end in zip(sides, ("",) if tied else ("_pos", "_neg"), strict=True):
            for k, name in enumerate(described.parameters):
                for given in (guess or {}, fixed):
                    side[k] = given.get(name + end, given.get(name, side[k]))
        parts = [LAWS[law].coordinates_of(side) for side in sides]
        parts += [np.log([course.mass])] if described.mass else []
        parts += [np.array([constant])] if described.offset else []
        climb = Climb(problem, np.concatenate(parts), held, hidden)
        hidden = climb.hidden
        cost = climb.run(_UNTIL_COMPARED)
        if cost < lowest:
            best, lowest = climb, cost
    if best is None:
        raise AssertionError("a law has at least one first guess")
    for _ in range(3):
        best.look_back()
        cost = best.run(25)
        if mass:  # the law's presliding distance and break-aways depend on the mass
            reached = math.exp(best.point.coordinates[problem.of_law])
            problem.course = problem.course.with_mass(reached)
    fit = sum_up(best, cost)
    return replace(fit, intervals=intervals_of(fit, best, fixed))


@dataclass(frozen=True)
class _Sliding:
    """Mass [kg], constant force and dry friction [N] and viscous friction [N s/m] at speed."""

    mass: float
    offset: float = 0.0
    dry: float = 0.0
    viscous: float = 0.0


def _fast_sliding(course: StackedRecords, law: FittedLaw, offset: float) -> _Sliding:
    """Least squares where the friction over the speed is nearly straight.

    A column that the motion does not show is left out: a constant force with one direction, a
    viscous slope with one speed.
    """
    v, a = course.v, course.acceleration
    fast = np.abs(v) > _FAST * float(np.quantile(np.abs(v), 0.98))
    columns = {"dry": np.sign(v), "viscous": v, "offset": np.ones(len(v)), "mass": a}
    one_way = abs(float(np.sign(v[fast]).sum())) == np.count_nonzero(fast)
    one_speed = float(np.ptp(np.abs(v[fast]))) < 0.2 * float(np.abs(v[fast]).max())
    shown = {"dry": True, "viscous": not one_speed, "mass": law.mass}
    shown["offset"] = law.offset and not one_way
    names = [n for n in columns if shown[n]]
    target = course.force - offset - (0.0 if law.mass else course.inertial)
    told = least_squares(np.column_stack([columns[n] for n in names])[fast], target[fast])
    found = {"mass": 0.0 if law.mass else course.mass} | dict(zip(names, told, strict=True))
    # if the motion does not show a mass: a mass whose force is a tenth of the friction
    usual = 0.1 * course.level / max(float(np.quantile(np.abs(a), 0.98)), 1e-12)
    if law.mass and found["mass"] < 0.1 * usual:
        found["mass"] = usual
    return _Sliding(**found | {"offset": offset + found.get("offset", 0.0)})


def _starts(course: StackedRecords, law: FittedLaw, sliding: _Sliding) -> list[Vector]:
    """First guesses from rough features of the friction-velocity map."""
    friction = course.force - course.inertial - sliding.offset
    pull, speed = np.abs(friction), np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    high = max(float(np.quantile(pull, 0.97)), 1e-3)
    level = max(float(np.quantile(pull[speed > _FAST * top], 0.1)), 0.05 * high)
    dry = np.abs(friction - max(sliding.viscous, 0.0) * course.v)
    most = max(float(np.quantile(dry, 0.97)), 1e-3)
    stiffness = []
    for r in range(course.records):
        part = slice(course.starts[r], course.starts[r + 1])
        way = np.abs(course.x[part] - course.x[course.starts[r]])
        early = (dry[part] > 0.15 * most) & (dry[part] < 0.6 * most) & (way > course.blur[part])
        first = np.flatnonzero(dry[part] > 0.7 * most)
        early[first[0] if len(first) else len(early) :] = False
        if np.any(early):
            stiffness.append(float(np.median(dry[part][early] / way[early])))
    sigma = 1.3 * float(np.median(stiffness)) if stiffness else most / 3e-5
    if law.name == "dahl":
        starts = [{"sigma": sigma, "Fc": high, "alpha": a} for a in (1.0, 2.0)]
    elif law.name == "bliman_sorine":
        starts = []
        for eta in (0.3, 0.7):
            f2 = 1.5 * level
            f1 = level + f2
            starts.append({"f1": f1, "f2": f2, "eps_f": (f1 / eta - f2) / sigma, "eta": eta})
    elif law.name not in KINDS:
        starts = _scaled_defaults(law.name, high, sigma, top)
    else:
        elements = {p.name: p.default for p in MAXWELL_SLIP}
        elements |= {f"k{i}": sigma / ELEMENTS for i in range(1, ELEMENTS + 1)}
        bristles = {"sigma0": sigma, "sigma1": 2 * math.sqrt(sigma)}
        starts = [
            elements | bristles | curve | {"C": sigma * curve["Vs"]}
            for curve in _stribeck_curves(course, friction, most / sigma)
        ]
    return [np.array([s[n] for n in law.parameters]) for s in starts]


def _stribeck_curves(course: StackedRecords, friction: Vector, yielding: float) -> list[Start]:
    """The curves over the speed with the least squares, their Vs far from each other.

    Parameters
    ----------
    course : StackedRecords
    friction : ndarray, shape (n,)
        [N]
    yielding : float
        Presliding distance [m], within a few of which the force is not the curve's.
    """
    pull, speed = friction * np.sign(course.v), np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    ways = [
        way_since_reversal(course.x[a:b], course.v[a:b])[0]
        for a, b in itertools.pairwise(course.starts)
    ]
    slid = (np.concatenate(ways) > _SLID * yielding) & (speed > _SLOWEST * top)
    slid = slid if np.count_nonzero(slid) > _ENOUGH else speed > 0.3 * top
    found = []
    for width in np.geomspace(_SLOWEST, 0.6, _WIDTHS) * top:
        fall = np.exp(-((speed[slid] / width) ** 2))
        columns = np.column_stack([np.ones(len(fall)), speed[slid], fall])
        told = least_squares(columns, pull[slid])
        found.append((float(np.sum((columns @ told - pull[slid]) ** 2)), width, told))
    found.sort(key=lambda c: c[0])
    curves: list[Start] = []
    for _, width, (dry, viscous, peak) in found:
        if all(abs(math.log(width / c["Vs"])) > _APART for c in curves):
            base = max(dry, 0.05 * float(pull.max()))
            top_of = max(base + peak, 1.1 * base)
            slope = max(viscous, 0.02 * base / top)
            curves.append({"Fc": base, "Fs": top_of, "Vs": width, "sigma2": slope})
    return curves[:_STARTS]


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
        starts.append({p.name: p.default * _factor(p.unit, size) for p in own})
    return starts


def _factor(unit: str, size: Mapping[str, float]) -> float:
    return math.prod(size.get(base, 1.0) ** power for base, power in base_exponents(unit).items())

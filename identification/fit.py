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

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..fmus.units import base_exponents
from ..plant.law import law as law_of
from ..plant.maxwell_slip import ELEMENTS
from ..plant.maxwell_slip import PARAMETERS as MAXWELL_SLIP
from ..records.record import Record
from ..solver.component import symbol
from .fit_errors import intervals_of, sum_up
from .fit_result import Fit, fitted_names, without_direction
from .fitted_law import LAWS, MASS, OFFSET, FittedLaw, claim_of
from .law_along_record import KINDS
from .layout import StackedRecords, lay_out
from .likelihood import Problem
from .optimizer import Climb

Vector = npt.NDArray[np.float64]
Start = dict[str, float]

_UNTIL_COMPARED = 12  # iterations from each first guess; after five, the wrong one may be better


def fit_along(
    records: Sequence[Record],
    law: str,
    course: StackedRecords | None = None,
    tied: bool | None = None,
    guess: Mapping[str, float] | None = None,
    follow: bool = True,
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
    follow : bool, optional
        Whether wide intervals are computed from the profile likelihood.
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
    course = course.with_mass(_first_mass(course)) if mass else course
    problem = Problem(course, described, tied)
    best: Climb | None = None
    lowest = math.inf
    constant = fixed.get(OFFSET, _first_offset(course) if described.offset else 0.0)
    starts = _starts(course, described, constant)
    if guess:
        constant = fixed.get(OFFSET, guess.get(OFFSET, 0.0))
        starts = [np.array([guess[n] for n in described.parameters])]
    names, _ = fitted_names(described, tied)
    held = [j for j, n in enumerate(names) if n in fixed or without_direction(n) in fixed]
    hidden: Vector | None = None  # from the first guess, so that costs are comparable
    for start in starts:
        sides = [start] if tied else [start, start.copy()]
        for side, end in zip(sides, ("",) if tied else ("_pos", "_neg"), strict=True):
            for k, name in enumerate(described.parameters):
                side[k] = fixed.get(name + end, fixed.get(name, side[k]))
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
    return replace(fit, intervals=intervals_of(fit, best, follow, fixed))


def _first_mass(course: StackedRecords) -> float:
    """Mass from a regression on acceleration, Coulomb and viscous friction and a load [kg]."""
    v, a = course.v, course.inertial / course.mass
    moving = np.abs(v) > 0.05 * float(np.quantile(np.abs(v), 0.98))
    columns = np.column_stack([a, np.sign(v), v, np.ones(len(v))])[moving]
    size = np.maximum(np.abs(columns).max(axis=0), 1e-30)
    told, *_ = np.linalg.lstsq(columns / size, course.force[moving])
    found = float(told[0] / size[0])
    # if the motion does not show a mass: a mass whose force is a tenth of the friction
    usual = 0.1 * course.level / max(float(np.quantile(np.abs(a), 0.98)), 1e-12)
    return found if found > 0.1 * usual else usual


def _first_offset(course: StackedRecords) -> float:
    """Mean of the friction of both directions, as an offset [N]; 0 with one direction only."""
    friction = course.force - course.inertial
    fast = 0.3 * float(np.quantile(np.abs(course.v), 0.98))
    sides = [friction[course.v > fast], friction[course.v < -fast]]
    return 0.5 * sum(float(np.median(s)) for s in sides) if all(map(len, sides)) else 0.0


def _starts(course: StackedRecords, law: FittedLaw, offset: float) -> list[Vector]:
    """First guesses from rough features of the friction-velocity map."""
    friction = course.force - course.inertial - offset
    pull = np.abs(friction)
    speed = np.abs(course.v)
    top = float(np.quantile(speed, 0.98))
    fast = speed > 0.3 * top
    high = max(float(np.quantile(pull, 0.97)), 1e-3)
    level = max(float(np.quantile(pull[fast], 0.1)), 0.05 * high)
    slope = np.polyfit(speed[fast], pull[fast], 1) if np.ptp(speed[fast]) > 0.2 * top else (0, 0)
    viscous = float(np.clip(slope[0], 0.02 * high / top, high / top))
    stiffness = []
    for r in range(course.records):
        part = slice(course.starts[r], course.starts[r + 1])
        way = np.abs(course.x[part] - course.x[course.starts[r]])
        early = (pull[part] > 0.15 * high) & (pull[part] < 0.6 * high) & (way > course.blur[part])
        first = np.flatnonzero(pull[part] > 0.7 * high)
        early[first[0] if len(first) else len(early) :] = False
        if np.any(early):
            stiffness.append(float(np.median(pull[part][early] / way[early])))
    sigma = 1.3 * float(np.median(stiffness)) if stiffness else high / 3e-5
    mass = 1.0
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
        base = max(level - viscous * 0.3 * top, 0.3 * level)
        elements = {p.name: p.default for p in MAXWELL_SLIP}
        starts = [
            elements
            | {f"k{i}": sigma / ELEMENTS for i in range(1, ELEMENTS + 1)}
            | {
                "C": sigma * share * top,
                "sigma0": sigma,
                "sigma1": 2 * math.sqrt(sigma * mass),
                "sigma2": viscous,
                "Fc": base,
                "Fs": max(high, 1.1 * base),
                "Vs": share * top,
            }
            for share in (0.07, 0.25, 0.6)
        ]
    return [np.array([s[n] for n in law.parameters]) for s in starts]


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

"""Parameters that given trials cannot identify, the reason, and a trial that would identify them.

The trial is found by calculation: its expected information at the fitted parameters is added
to that of the records, and the first candidate that makes the parameter's interval narrow
enough is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...solver.arrays import Vector
from .fitted_law import MASS, OFFSET, assumed_damping, name_and_end
from .intervals import CONFIDENCE, NARROW, Fit
from .law_along_record import with_backlash
from .layout import StackedRecords
from .likelihood import UNDER, Climb, Problem

Motion = Callable[[Vector], Vector]  # from times [s] to positions [m]

FORWARDS, BACKWARDS = "forwards", "backwards"

_BROKEN_AWAY = 5.0  # distance until a block slides, in presliding distances
_LONGEST = 20.0  # duration of a proposed motion [s]


def ways(course: StackedRecords) -> list[str]:
    """The directions in which records move, at least one of `FORWARDS` and `BACKWARDS`."""
    moves = np.diff(course.x)
    moves[course.starts[1:-1] - 1] = 0.0
    least = {way: _towards(moves, end) for way, end in ((FORWARDS, "_pos"), (BACKWARDS, "_neg"))}
    found = [way for way, m in least.items() if m.sum() > max(0.02 * m.max(initial=0.0), 5e-6)]
    return found or [FORWARDS]


def _towards(values: Vector, end: str) -> Vector:
    """The sizes of values in the direction of a parameter with this end, in either without one."""
    sign = {"_pos": 1.0, "_neg": -1.0}.get(end)
    return np.maximum(sign * values, 0.0) if sign else np.abs(values)


def peak_unseen(fit: Fit, course: StackedRecords, parameter: str) -> bool:
    """Whether a parameter describes break-away and the records do not show a break-away.

    Either the records end below it, so that the parameter is only extrapolated from the bend of the
    loading curve, which a sensor's scale error also causes; or no peak of static friction is
    visible. Dahl's law bends from the start, so without the end of the curve its initial stiffness
    is not identified either.
    """
    (name, end), law = name_and_end(parameter), fit.law
    falls = name in ("Fs", "Vs") and {"Fc", "Fs"} <= set(law.parameters)
    if falls and fit.values["Fs" + end] < (1 + UNDER) * fit.values["Fc" + end]:
        return True
    if name not in law.asks.of_break_away:
        return False
    friction = (fit.predicted - course.inertial)[fit.spoken] - fit.values.get(OFFSET, 0.0)
    error = float(np.max(course.backlash)) / law.presliding_way(fit.values, end)
    sharp = max(error, float(np.max(course.gain_std))) < 1e-3  # then a bend gives the final force
    static = fit.values[("Fs" if "Fs" in law.parameters else "Fc") + end]
    return float(np.max(_towards(friction, end))) < (0.7 if sharp else 0.9) * static


def hardly_slides(fit: Fit, course: StackedRecords, parameter: str) -> bool:
    """Whether a parameter describes sliding and the records do not slide enough to identify it.

    If the records show almost only presliding, a very small sensor error looks like a Stribeck
    curve. If they slide at one speed, or at speeds at which that curve has hardly fallen, its
    remaining fall, its width and the viscous slope are not identified.
    """
    name, end = name_and_end(parameter)
    of_curve = name in ("Fc", "Vs", "sigma2") and "Vs" in fit.law.parameters
    if not of_curve and name not in fit.law.asks.of_sliding:
        return False
    yielding = fit.law.presliding_way(fit.values, end)
    until = np.full(course.records, _BROKEN_AWAY * yielding)
    dragged = with_backlash(course.x, course.starts, until)
    moves = np.diff(dragged, prepend=dragged[0])
    moves[course.starts[:-1]] = 0.0
    slid = _towards(moves, end)
    little = float(slid.sum()) < 50.0 * yielding
    if little or not of_curve:
        return little
    order = np.argsort(np.abs(course.v))
    covered = np.cumsum(slid[order]) / float(slid.sum())
    slow, fast = np.abs(course.v)[order][np.searchsorted(covered, (0.1, 0.9))]
    # at 0.7 of Vs a third of the curve has fallen
    return bool(fast < 1.5 * slow or fast < 0.7 * fit.values["Vs" + end])


def blurred_elements(fit: Fit, resolution: float) -> set[str]:
    """Parameter names of Maxwell-slip elements that records do not distinguish from others.

    An element is distinguished if, for all plausible parameters, its force is more than the
    resolution of the load cell [N], and it yields after the previous and before the next element.
    """
    if fit.law.form != "elements":
        return set()
    names, count = set(), len(fit.law.together)
    drawn = fit.draws()
    for first in range(0, len(fit.law.names), len(fit.law.parameters)):
        own = drawn[:, first : first + len(fit.law.parameters)]
        held = own[:, count : 2 * count] * own[:, -2:-1]
        yields = np.pad(held / own[:, :count], ((0, 0), (1, 1)))
        yields[:, -1] = math.inf
        in_order = np.diff(yields) > 0
        told = (held > 2 * resolution) & in_order[:, :-1] & in_order[:, 1:]
        for i in np.flatnonzero(np.mean(told, axis=0) < CONFIDENCE):
            names |= {fit.names[first + i], fit.names[first + count + i]}
    return names


class Trial(NamedTuple):
    """A trial that might be added: its description, and the motion of each of its records."""

    what: str
    motions: tuple[Motion, ...]
    duration: float  # [s]
    step: float  # sampling interval [s]
    blur: float  # noise of the position [m]

    def course(self, noise: float, resolution: float) -> StackedRecords:
        """Its records without force, by a load cell of this noise and resolution [N]."""
        times = self.step * np.arange(round(self.duration / self.step), dtype=float)
        n, records = len(times), len(self.motions)
        x = np.array([motion(times) for motion in self.motions])
        v = np.gradient(x, self.step, axis=1)
        return StackedRecords(
            x=x.ravel(),
            v=v.ravel(),
            inertial=np.gradient(v, self.step, axis=1).ravel(),
            force=np.zeros(n * records),
            blur=np.full(n * records, self.blur),
            still=np.zeros(n * records, dtype=bool),
            recorded=np.ones(n * records, dtype=bool),
            step=np.full(records, self.step),
            shift_std=np.full(records, self.blur),
            gain_std=np.full(records, 1e-7),
            delay_std=np.full(records, self.step / math.sqrt(12)),
            clock=np.zeros(records, dtype=np.int64),
            backlash=np.zeros(records),
            starts=n * np.arange(records + 1, dtype=np.int64),
            resolution=resolution,
            noise=noise,
            fast_noise=noise,
            replays=np.empty((0, 3, n * records)),
        )


def _sine(speed: float, omega: float) -> Motion:
    return lambda t: speed / omega * (1 - np.cos(omega * t))


def _rise(speed: float) -> Motion:
    """To a constant velocity [m/s], in about 0.06 s."""
    return lambda t: speed * (t - 0.06 * (1 - np.exp(-t / 0.06)))


def candidates(fit: Fit, parameter: str, course: StackedRecords) -> list[Trial]:
    """Candidate trials for a parameter, the simplest first, scaled to the machine.

    If the records show presliding only: with a travel long enough to slide, moved over in a second.
    """
    name, end = name_and_end(parameter)
    if name == "sigma1":
        way = fit.law.presliding_way(fit.values, end) / 4
        rate, fine = 2 * math.pi * 10.0, way / 160
        motion = f"velocity {way * rate:.2g}*sin({rate:.3g} t) m/s, {2 * way:.2g} m forwards and"
        motion += f" backwards in presliding, for 5 s, force and displacement (to {fine:.1g} m)"
        what = f"{motion} sampled together at 2 kHz (their delay must be known to 0.15 ms)"
        return [Trial(what, (_sine(way * rate, rate),), 5.0, 5e-4, fine)]
    way = max(fit.law.presliding_way(fit.values, end) for end in fit.law.ends)
    speed = float(np.quantile(np.abs(course.v), 0.99))
    travel = max(float(np.ptp(course.x[part])) for part in course.parts())
    if travel < _BROKEN_AWAY * way:
        speed = travel = 100.0 * way
    sensors = float(course.step.min()), float(np.median(course.blur))

    def constant(speeds: Sequence[float], lasts: float) -> Trial:
        *others, last = (f"{v:.2g}" for v in speeds)
        what = f"constant velocities of {', '.join(others)} and {last} m/s in either direction, "
        motions = tuple(_rise(s * v) for v in speeds for s in (1.0, -1.0))
        return Trial(f"{what}{lasts:.2g} s each", motions, lasts, *sensors)

    gentle = speed / 4
    rate = max(2 * gentle / travel, math.pi / _LONGEST)
    what = f"velocity {gentle:.2g}*sin({rate:.3g} t) m/s for {math.pi / rate:.3g} s from rest in "
    back_and_forth = _sine(gentle, rate), _sine(-gentle, rate)
    slow = Trial(f"{what}either direction", back_and_forth, math.pi / rate, *sensors)
    if name == "Vs":
        steps = [fit.values[parameter] * share for share in (0.3, 0.6, 1.0, 1.5)]
        return [slow, constant(steps, min(_LONGEST, travel / steps[-1]))]
    speeds = [speed * share for share in (1 / 12, 1 / 6, 1 / 3, 2 / 3, 1)]
    fast = constant(speeds, min(travel / speed, 5.0))
    rate = max(2 * speed / travel, 2 / 3)
    what = f"velocity {speed:.2g}*sin({rate:.3g} t) m/s for two cycles"
    cycles = Trial(what, (_sine(speed, rate),), 4 * math.pi / rate, *sensors)
    return [fast, slow] if name == "sigma2" else [slow, fast, cycles]


def which_would_do(fit: Fit, parameter: str, course: StackedRecords) -> str:
    """The first candidate trial that would identify a parameter, or that none of them would."""
    if parameter == OFFSET:
        return "the same motion in both directions would be enough"
    if parameter == MASS:
        return "use a motion with stronger acceleration, forwards and backwards"
    options = candidates(fit, parameter, course)
    for option in options:
        expected = _expected_error(fit, option, parameter, course.resolution)
        if 2 * expected <= NARROW:
            return f"{option.what} would be enough: expected within {200 * expected:.2g} %"
    return f"of {len(options)} trials tried by calculation none would be enough alone"


def _expected_error(fit: Fit, option: Trial, parameter: str, resolution: float) -> float:
    """Relative standard error of a parameter with a further trial.

    It is calculated at the fit, with critical damping if sigma1 is not known.
    """
    coordinates, p = fit.coordinates.copy(), len(fit.coordinates)
    for j, name in enumerate(fit.names):
        if name.startswith("sigma1") and not fit.intervals[name].identified:
            known = (fit.values[name.replace("sigma1", other)] for other in ("sigma0", "sigma2"))
            coordinates[j] = math.log(max(assumed_damping(*known), 1.0))
    course = option.course(fit.noise, resolution)
    climb = Climb(Problem(course, fit.law), coordinates)
    force = climb.problem.force(climb.vector)
    force = np.round(force / resolution) * resolution if resolution else force
    climb.problem = Problem(replace(course, force=force), fit.law)
    climb.prior_std[:p] = 1e3  # the trial alone may not identify all parameters
    told = fit.information, climb.normal()[0]
    both = sum(np.linalg.inv(np.linalg.inv(i)[:p, :p]) for i in told)
    j, tiny = fit.names.index(parameter), 1e-5
    moved = np.vstack([coordinates, coordinates + tiny * np.eye(p)])
    logarithms = np.log(fit.law.values_at(moved)[:, j])
    turn = (logarithms[1:] - logarithms[0]) / tiny
    return math.sqrt(float(turn @ np.linalg.inv(both) @ turn))


def why_not(fit: Fit, parameter: str, course: StackedRecords) -> str:
    """The reason why an interval is wide, from the recorded motion and from the fit's errors."""
    name, end = name_and_end(parameter)
    way = {"_pos": FORWARDS, "_neg": BACKWARDS}.get(end, "in either direction")
    moved = ways(course)
    if end and way not in moved:
        return f"there is no motion {way}"
    if fit.law.offset and len(moved) == 1 and name in (OFFSET, "Fc", "Fs"):
        only = "the records move in one direction only"
        return f"{only}, where a constant force and friction cannot be distinguished"
    if hardly_slides(fit, course, parameter):
        few = "too few speeds to distinguish the fall of the Stribeck curve from the viscous slope"
        why = f"after break-away it moves almost no distance, or at {few}"
        return f"the block hardly slides {way}: {why}"
    if peak_unseen(fit, course, parameter):
        why = "the largest force is below it, or there is no visible peak of static friction"
        return f"break-away is not visible {way}: {why}"
    return _confused(fit, parameter)


def _confused(fit: Fit, parameter: str) -> str:
    """What is known only together with this parameter, or that there is no such thing."""
    j = fit.names.index(parameter)
    if fit.law.together:
        covariance = np.cov(np.log(np.maximum(fit.draws(), 1e-300)), rowvar=False)
    else:
        covariance = np.linalg.inv(fit.information)
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    both = covariance / np.outer(size, size)
    alone = 1.0 / math.sqrt(max(float(np.linalg.pinv(both)[j, j]), 1.0))
    noise = f"the noise of {fit.noise:.2g} N"
    of_its_own = alone**2 > 0.5  # most of its variance would be there if all else were known
    if of_its_own and 2 * alone * float(size[j]) > NARROW:
        return f"the force depends too little on it for {noise}, even if all else were known"
    if of_its_own:
        return f"its error by sensors, or from piece to piece of records, is above that by {noise}"
    both[j, j] = 0.0
    other = int(np.argmax(np.abs(both[j])))
    name = [*fit.names, *["the delay between force and motion"] * len(fit.delays)][other]
    known = f"it and {name} are only known together (correlation {both[j, other]:.2f})"
    return f"{known}; if all else were known, its error would be {alone:.2g} of this one"

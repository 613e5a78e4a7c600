"""Features of friction that a law shows: the measures, and the criterion for each.

The criteria are fixed numbers; ``tests/rig/test_features.py`` tests them on laws whose features are
known by construction. A cell is "yes" if every check is passed, "no" if the feature is absent or
far from the measurement of the thesis, and "conditional" if the footnotes of Table 2.12 apply: an
additional velocity term would be enough, or presliding is right at only some of the forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .observations import ForceCurve, Observations

Vector = npt.NDArray[np.float64]
YES, CONDITIONAL, NO = "yes", "conditional", "no"
FEATURES = (
    "breakaway_force",
    "viscous_friction",
    "friction_lag",
    "varying_breakaway_force",
    "presliding",
)
THESIS: dict[str, dict[str, str]] = {
    law: dict(zip(FEATURES, row.split(), strict=True))
    for law, row in {
        "classical": "yes yes no no no",
        "dahl": "no conditional no no conditional",
        "bliman_sorine": "yes conditional no no no",
        "lugre": "yes yes yes yes yes",
    }.items()
}
"""Table 2.12; laws that are not compared in the thesis have no row."""


MEASURED_BREAK_AWAY = {"forwards": 2.2, "backwards": -2.4}
"""Section 2.4.2 [N]."""


VISCOUS = 173.0
"""Measured sigma2, the mean of both directions: Table 2.3 [N*s/m]."""


STIFFNESS = 66967.231
"""Measured force over measured displacement before sliding, the mean of Table 2.9 [N/m]."""


LAG_DEVIATION, LAG_SPEED = 0.076, 5e-4
"""The thesis' largest deviation of LuGre in Section 2.4.4, and its velocity [m/s]."""


RATE_DEVIATION, FASTEST_RATE = 0.08, 20.3
"""The same in Section 2.4.5 [N/s]."""


LEAST_DROP = 0.05
BREAK_AWAY_ERROR = 0.10
SLOPE_ERROR = 0.20
LEAST_LAG = 0.01
LEAST_FALL = 0.02
PRESLIDING_ERROR = 0.20
CRITERIA: dict[str, str] = {
    "breakaway_force": (
        "Loaded at 0.25 N/s until it slides at 4 mm/s, friction peaks in either direction at least "
        f"{LEAST_DROP:.0%} above the least that follows while sliding, and the peaks are within "
        f"{BREAK_AWAY_ERROR:.0%} of the measured 2.2 N and -2.4 N."
    ),
    "viscous_friction": (
        "The slope of steady friction over velocity, 3 to 8 mm/s, is in either direction within "
        f"{SLOPE_ERROR:.0%} of the measured {VISCOUS:g} N*s/m (the directions themselves are "
        "12 % off it); conditional: it is once that many N*s/m are added to the law."
    ),
    "friction_lag": (
        "Around the cycle of Table 2.11, friction is on average at least "
        f"{1e3 * LEAST_LAG:g} mN higher while the velocity rises than at the same velocity while "
        "it falls: ten times the scatter that the load cell's 30 mN of noise leaves in it."
    ),
    "varying_breakaway_force": (
        f"At each of the twenty loading rates friction peaks, and from the slowest to the fastest "
        f"the peak falls by at least {LEAST_FALL:.0%}."
    ),
    "presliding": (
        "At the end of each hold of the staircase (0.5, 1 and 1.5 N) the displacement is within "
        f"{PRESLIDING_ERROR:.0%} of force over the measured {1e-3 * STIFFNESS:.1f} kN/m; "
        "conditional: at some of the holds only."
    ),
}


# -- deciding ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Check:
    """One measure compared with the threshold of its criterion."""

    name: str
    measure: float
    unit: str
    threshold: float
    at_least: bool

    @property
    def met(self) -> bool:
        return self.margin >= 0

    @property
    def margin(self) -> float:
        """Distance from the threshold as a share of it, positive if the check is passed."""
        distance = (self.measure - self.threshold) / self.threshold
        return distance if self.at_least else -distance


@dataclass(frozen=True)
class Cell:
    """One decision.

    Attributes
    ----------
    checks : list of Check
        Checks that decide, including those that are missing for a better result.
    figures : dict of str to float
        Further numbers of this experiment.
    explanation : str
        The numbers in a sentence.
    """

    feature: str
    decision: str
    checks: list[Check]
    figures: dict[str, float]
    explanation: str
    thesis: str | None = None
    difference: str = ""

    @property
    def margin(self) -> float:
        """Distance of the measures from a change of the decision, in thresholds."""
        margins = [c.margin for c in self.checks]
        if self.decision == YES:
            return min(margins)
        if self.decision == NO:
            return -min(margins) if self.feature != "presliding" else -max(margins)
        return min(abs(m) for m in margins)

    @property
    def agrees(self) -> bool | None:
        """Whether the thesis has the same result; None if it has none."""
        return None if self.thesis is None else self.thesis == self.decision


def decide_features(seen: Observations) -> dict[str, Cell]:
    """Decide all features of one law, by name of the feature."""
    return {
        "breakaway_force": break_away(seen),
        "viscous_friction": viscous(seen),
        "friction_lag": lag(seen),
        "varying_breakaway_force": varying(seen),
        "presliding": presliding(seen),
    }


def break_away(seen: Observations) -> Cell:
    """Decide by the peak before sliding and its size."""
    peaks = {"forwards": seen.forwards, "backwards": seen.backwards}
    drops = {k: 0.0 if p.force is None else p.force / p.sliding - 1 for k, p in peaks.items()}
    checks = [Check("peak over sliding friction", min(drops.values()), "1", LEAST_DROP, True)]
    figures = {f"drop_{k}": v for k, v in drops.items()}
    held = [s.asked for s in seen.steps if not s.slides]
    figures |= {"largest_force_held": max(held, default=0.0)}
    figures |= {"lowest_force_held": min(held, default=0.0)}
    words = [f"steps from {min(held, default=0.0):g} to {max(held, default=0.0):g} N are held"]
    if seen.forwards.force is None or seen.backwards.force is None:
        words.insert(0, "friction rises to its sliding value and never falls")
    else:
        found = {"forwards": seen.forwards.force, "backwards": -seen.backwards.force}
        errors = {k: found[k] / MEASURED_BREAK_AWAY[k] - 1 for k in found}
        worst = max(abs(e) for e in errors.values())
        checks.append(Check("deviation from 2.2 and -2.4 N", worst, "1", BREAK_AWAY_ERROR, False))
        figures |= {f"break_away_{k}": v for k, v in found.items()}
        figures |= {f"deviation_{k}": v for k, v in errors.items()}
        words.insert(
            0,
            f"breaks away at {found['forwards']:.3f} and {found['backwards']:.3f} N "
            f"({errors['forwards']:+.1%} and {errors['backwards']:+.1%} of the measured), "
            f"{min(drops.values()):.0%} above the sliding friction that follows",
        )
    decision = YES if all(c.met for c in checks) else NO
    return _cell(seen, "breakaway_force", decision, checks, figures, "; ".join(words))


def viscous(seen: Observations) -> Cell:
    """Decide by the slope of steady friction over velocity."""
    slopes = {}
    for name, sign in (("forwards", 1), ("backwards", -1)):
        there = sign * seen.speed > 0
        slopes[name] = float(np.polyfit(seen.speed[there], seen.friction[there], 1)[0])
    errors = [abs(s / VISCOUS - 1) for s in slopes.values()]
    with_term = [abs((s + VISCOUS) / VISCOUS - 1) for s in slopes.values()]
    checks = [Check("deviation of the slope", max(errors), "1", SLOPE_ERROR, False)]
    decision = YES if checks[0].met else NO
    words = f"slopes {slopes['forwards']:.1f} and {slopes['backwards']:.1f} N*s/m"
    if decision == NO:
        term = Check("with a term added", max(with_term), "1", SLOPE_ERROR, False)
        checks.append(term)
        decision = CONDITIONAL if term.met else NO
        words += f"; a term of {VISCOUS:g} N*s/m leaves them {max(with_term):.1%} off at most"
    figures = {f"slope_{k}": v for k, v in slopes.items()}
    return _cell(seen, "viscous_friction", decision, checks, figures, words)


def lag(seen: Observations) -> Cell:
    """Decide by friction at rising less that at falling velocity, averaged over a cycle."""
    v, f = seen.loop_speed, seen.loop_friction
    width = float(np.trapezoid(f, v) / np.ptp(v))
    checks = [Check("friction going up less coming down", width, "N", LEAST_LAG, True)]
    slowest = int(np.argmin(np.abs(v[: len(v) - 1] - LAG_SPEED)))
    at_slowest = float(f[slowest])
    figures = {"mean_friction": float(f.mean()), "friction_at_0.5_mm_per_s": at_slowest}
    words = f"{1e3 * width:.2f} mN higher going up than coming down"
    return _cell(seen, "friction_lag", YES if checks[0].met else NO, checks, figures, words)


def varying(seen: Observations) -> Cell:
    """Decide by the decrease of the break-away force over the loading rates."""
    peaks = seen.rate_peaks
    missing = int(np.isnan(peaks).sum())
    if missing:
        checks = [Check("fall of the peak", 0.0, "1", LEAST_FALL, True)]
        words = f"friction does not peak at {missing} of the {len(peaks)} rates: nothing to vary"
        return _cell(seen, "varying_breakaway_force", NO, checks, {}, words)
    fall = float(1 - peaks[-1] / peaks[0])
    slope = float(np.polyfit(np.log10(seen.rates), peaks, 1)[0])
    checks = [Check("fall of the peak", fall, "1", LEAST_FALL, True)]
    figures = {
        "slowest": float(peaks[0]),
        "fastest": float(peaks[-1]),
        "slope_per_decade": slope,
    }
    words = (
        f"from {peaks[0]:.3f} N at {seen.rates[0]:g} N/s to {peaks[-1]:.3f} N at "
        f"{seen.rates[-1]:g} N/s: {-fall:+.2%}, {slope:+.4f} N per decade"
    )
    decision = YES if checks[0].met else NO
    return _cell(seen, "varying_breakaway_force", decision, checks, figures, words)


def presliding(seen: Observations) -> Cell:
    """Decide by the displacement before sliding, compared with the measured one."""
    at = seen.hold_ends
    ratios = STIFFNESS * seen.staircase.x[at] / seen.staircase.force[at]
    errors = ratios - 1
    asked = (0.5, 1.0, 1.5)
    checks = [
        Check(f"deviation at {force:g} N", abs(float(e)), "1", PRESLIDING_ERROR, False)
        for force, e in zip(asked, errors, strict=True)
    ]
    right = [c.met for c in checks]
    decision = YES if all(right) else CONDITIONAL if any(right) else NO
    figures = {f"deviation_at_{f:g}_N": float(e) for f, e in zip(asked, errors, strict=True)}
    listed = ", ".join(f"{e:+.1%}" for e in errors)
    words = f"displacement at 0.5, 1, 1.5 N off by {listed}"
    if min(ratios) > 0.01 and max(ratios) < 100:  # not rigid and not sliding
        scale = float((max(ratios) + min(ratios)) / 2)
        left = float(max(ratios) / scale - 1)
        figures |= {"stiffer_by": scale - 1, "deviation_if_stiffer": left}
    rise = rise_time(seen.step)
    if math.isfinite(rise):
        figures["rise_time_of_step"] = rise
        words += f"; a step to 1.5 N is followed in {1e3 * rise:.0f} ms (10 to 90 %)"
    return _cell(seen, "presliding", decision, checks, figures, words)


def rise_time(step: ForceCurve) -> float:
    """Time from 10 to 90 % of the last displacement [s]; NaN if that is less than a nanometre."""
    if abs(step.x[-1]) < 1e-9:
        return math.nan
    share = step.x / step.x[-1]
    course = _rising(share, step.time)
    return float(np.interp(0.9, *course) - np.interp(0.1, *course))


def _rising(values: Vector, time: Vector) -> tuple[Vector, Vector]:
    """The part of a curve before it first reaches its last value, made monotonic."""
    end = int(np.argmax(values >= values[-1])) + 1
    return np.maximum.accumulate(values[:end]), time[:end]


def _cell(
    seen: Observations,
    feature: str,
    decision: str,
    checks: list[Check],
    figures: dict[str, float],
    words: str,
) -> Cell:
    thesis = THESIS.get(seen.law, {}).get(feature)
    difference = ""
    if thesis is not None and thesis != decision:
        difference = _difference(feature, checks, figures)
    return Cell(feature, decision, checks, figures, words, thesis, difference)


def _difference(feature: str, checks: list[Check], figures: dict[str, float]) -> str:
    """Reason why the decision differs from the thesis, with numbers."""
    failed = [c for c in checks if not c.met]
    sums = "; ".join(
        f"{c.name}: {c.measure:.3g} against {'at least' if c.at_least else 'at most'} "
        f"{c.threshold:g}"
        for c in (failed or checks)
    )
    if feature == "presliding" and "stiffer_by" in figures:
        sums += (
            ". Table 2.9's stiffness is force over displacement (Eq. 2.14), which is the same at "
            "0.5, 1 and 1.5 N within 3 %: a spring. The law yields as the force nears its largest, "
            "so that a stiffness put in as that of the unloaded law moves too far. Were the law "
            f"{figures['stiffer_by']:+.0%} stiffer, the largest deviation would be "
            f"{figures['deviation_if_stiffer']:.0%}"
        )
    return sums

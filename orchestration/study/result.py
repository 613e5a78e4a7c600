"""Result of a study: means with intervals, which controllers differ, the answer in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...solver.arrays import Matrix
from ...solver.files import write_json, write_table
from .plan import Plan
from .run import JUDGED_BY, MEASURED, NAMES, SIZES, TRUSTED, FmuCheck, hunting_verdict
from .tuning import Tuned

Place: TypeAlias = tuple[int, ...]  # numbers of controller, tuning, duty and plant of a run

LEVEL = 0.90  # at most one study in ten calls equal controllers different
RELEVANT = 0.02  # smallest relevant difference of two figures: their ratio minus 1
ALIKE = 0.1  # equal figures have a ratio within this share of 1, by all of its interval
SMALLEST = 1e-12  # m; errors below it are equal
FAR = 2.0  # times the least known cost of a controller: a tuning that ends above it failed


@dataclass(frozen=True)
class Mean:
    """A mean of a figure over plants, with its interval; NaN if a run has no such figure."""

    mean: float  # in the figure's unit
    low: float  # 90 % interval of it, over plants and their noise
    high: float
    geometric: bool  # whether it is the geometric mean


@dataclass(frozen=True)
class Difference:
    """How a figure of one controller compares with that of another."""

    ratio: float  # geometric mean of first over second
    low: float  # 90 % interval of it, over plants and tunings
    high: float
    told_apart: bool  # whether the interval contains no ratio within 2 % of 1
    alike: bool  # whether it contains only ratios within 10 % of 1; if neither, runs cannot tell

    @property
    def words(self) -> str:
        if self.told_apart:
            return "different"
        return f"equal within {100 * ALIKE:g} %" if self.alike else "these runs cannot tell"


def mean_over_plants(figure: Matrix, geometric: bool) -> Mean:
    """The mean of a figure over the drawn plants, each with its own noise.

    The figure is by tuning and plant, shape (seeds, plants). Student's interval over the plants, of
    the mean over tunings on each. For a positive figure (`geometric`) it is that of the logarithm:
    differences of plants mostly multiply an error, so that the logarithm is closer to normal, and
    two controllers are compared by it. The tunings are fixed: the scatter of other tunings is not
    included. A bootstrap needs no distribution, but with 20 plants it is too narrow (for a normal
    figure it contains the mean in 86 or 87 of 100 studies).
    """
    if not np.isfinite(figure).all():
        return Mean(math.nan, math.nan, math.nan, geometric)
    by_plant = (np.log(figure) if geometric else figure).mean(axis=0)
    middle, half = float(by_plant.mean()), _half_width([_variance(by_plant)])
    ends = middle, middle - half, middle + half
    mean, low, high = map(math.exp, ends) if geometric else ends
    return Mean(mean, low, high, geometric)


def compare(first: Matrix, second: Matrix) -> Difference:
    """Compare a positive, finite figure of two controllers, shape (seeds, plants).

    The plants are the same for both, so that their differences are paired; tunings are not. The
    variance of the mean is the sum of that over plants and of those over the tunings of each, its
    degrees of freedom after Welch and Satterthwaite (B. L. Welch, Biometrika 34, 28 (1947)).
    """
    a, b = np.log(first), np.log(second)
    paired = a.mean(axis=0) - b.mean(axis=0)
    middle = float(paired.mean())
    half = _half_width([_variance(paired), *(_variance(side.mean(axis=1)) for side in (a, b))])
    low, high = middle - half, middle + half
    margin = math.log1p(RELEVANT)
    certain = low > margin or high < -margin
    alike = not certain and max(high, -low) <= math.log1p(ALIKE)
    # an interval of two tunings may be wider than numbers go
    ratio, least, most = (math.exp(min(max(v, -700.0), 700.0)) for v in (middle, low, high))
    return Difference(ratio, least, most, certain, alike)


def _variance(values: Matrix) -> tuple[float, int]:
    """Variance of the mean, and its degrees of freedom."""
    count = len(values)
    return float(np.var(values, ddof=1) / count) if count > 1 else 0.0, count - 1


def _half_width(parts: Sequence[tuple[float, int]]) -> float:
    """Of Student's interval of a mean whose variance is the sum of independent parts."""
    from scipy import stats

    variance = sum(v for v, _ in parts)
    if not variance > 0:
        return 0.0
    freedom = variance**2 / sum(v**2 / n for v, n in parts if n > 0)
    return float(stats.t.ppf((1 + LEVEL) / 2, freedom)) * math.sqrt(variance)


class Shown(NamedTuple):
    """A run for the report, at some hundreds of times; empty if it failed."""

    time: list[float]  # [s]
    error: list[float]  # set-point minus position [m]
    command: list[float]  # in the unit of the plant's command


@dataclass(frozen=True)
class DutyAnswer:
    """The best controllers at a duty."""

    duty: str
    order: tuple[str, ...]  # by geometric mean error, the best first; without those that failed
    best: tuple[str, ...]  # the first one, and all that are shown to be equal to it within 10 %
    unclear: tuple[str, ...]  # those of which these runs cannot tell whether they differ from it
    failed: dict[str, int]  # failed runs by controller


@dataclass(frozen=True, repr=False)
class StudyResult:
    """A finished study."""

    plan: Plan
    tunings: Mapping[str, list[Tuned]]  # by controller, one for each seed
    # shape (controllers, seeds, duties, plants); by name, see `Figures`
    figures: Mapping[str, Matrix]
    answers: list[DutyAnswer]
    # by duty and pair of controllers, of the rms error
    differences: dict[str, dict[tuple[str, str], Difference]]
    checks: dict[Place, FmuCheck]  # runs that were repeated over FMUs
    # by duty and controller, for the nominal plant with the tuning of least cost
    courses: dict[str, dict[str, Shown]]

    @property
    def disagreed(self) -> int:
        """Number of runs with different results over FMUs."""
        return sum(not c.agrees for c in self.checks.values())

    @property
    def not_converged(self) -> int:
        """Number of runs over FMUs whose coupling the master does not trust."""
        return sum(c.coupling not in ("", TRUSTED) for c in self.checks.values())

    @property
    def trusted(self) -> bool:
        """Whether no run failed, and all repeated runs over FMUs gave the same result."""
        return not self.disagreed and not any(any(a.failed.values()) for a in self.answers)

    @property
    def verdict(self) -> str:
        """The controller that wins the most duties, their number, and those that it does not win.

        A duty is won by the controller with the smallest error; the numbers of duties at which
        others are equal, and at which the runs cannot tell, are given.
        """
        firsts = [a.order[0] for a in self.answers if a.order]
        if not firsts:
            return "No controller completed any duty"
        # the most duties; of two with equal numbers, the one that is named first in the study
        winner = max((e.name for e in self.plan.entrants), key=firsts.count)
        won = [a for a in self.answers if a.order[:1] == (winner,)]
        text = f"{winner} wins {len(won)} of {len(self.answers)} duties"
        if shared := sum(len(a.best) > 1 for a in won):
            text += f", {shared} of them together with others, equal within {100 * ALIKE:g} %"
        if unclear := sum(bool(a.unclear) for a in won):
            text += f"; at {unclear} of them {self.cannot_tell} whether others are as good"
        lost: dict[str, list[str]] = {}
        for a in (a for a in self.answers if a not in won):
            by = f"{a.order[0]} does" if a.order else "no controller does"
            lost.setdefault(by, []).append(a.duty)
        others = [f"{_listed(duties)} ({by})" for by, duties in lost.items()]
        return f"{text}; it does not win {_listed(others)}" if lost else text

    @property
    def cannot_tell(self) -> str:
        seeds, plants = self.plan.tuning.seeds, self.plan.plants
        return f"{seeds} tuning{'s' if seeds > 1 else ''} on {plants} plants cannot tell"

    def doubts(self) -> list[str]:
        """What weakens the result, one sentence each; empty if nothing does."""
        found = []
        failed = [n for a in self.answers for n, count in a.failed.items() for _ in range(count)]
        if failed:
            found.append(f"{len(failed)} runs FAILED, of {_listed([*dict.fromkeys(failed)])}")
        if self.disagreed:
            found.append(f"{self.disagreed} of {len(self.checks)} runs DIFFER over FMUs")
        for name, tunings in self.tunings.items():
            least = min(t.doubled_cost for t in tunings)
            if costs := [t.cost for t in tunings if t.cost > FAR * least]:
                found.append(
                    f"tuning of {name} FAILED in {len(costs)} of {len(tunings)} tries: it ended at "
                    f"a cost of {max(costs):.3g}, but {least:.3g} was found with more budget or "
                    "another seed"
                )
        for e in self.plan.entrants:
            if e.tune and all(t.cost >= t.published_cost for t in self.tunings[e.name]):
                found.append(f"tuning of {e.name} found no better values than the published ones")
        return found

    def headline(self) -> str:
        """The best controller, then limitations, then the size of the study."""
        entrants, seeds, duties, plants = self.figures[JUDGED_BY].shape
        runs = entrants * seeds * duties * plants
        parts = [*self.doubts(), f"{entrants} controllers, {duties} duties, {runs} runs"]
        return ". ".join([self.verdict, *(part[0].upper() + part[1:] for part in parts)])

    def mean(self, figure: str, controller: str, duty: str) -> Mean:
        """Mean of a figure over tunings and plants, with its 90 % interval over plants.

        Geometric for figures that are positive in the runs of all controllers at this duty, see
        `SIZES`.
        """
        runs = self._runs(figure, duty)
        every = np.array([*runs.values()])
        geometric = figure in SIZES and bool((every[np.isfinite(every)] > 0).all())
        return mean_over_plants(runs[controller], geometric)

    def hunting(self, controller: str, duty: str) -> dict[str, int]:
        """Numbers of runs by the verdict on hunting; see `Figures`."""
        said = [hunting_verdict(v) for v in self._runs("hunting", duty)[controller].ravel()]
        return {word: said.count(word) for word in ("hunting", "none", "undecided")}

    def _runs(self, figure: str, duty: str) -> dict[str, Matrix]:
        """A figure of all runs at a duty, by controller; shape (seeds, plants)."""
        d = [d.name for d in self.plan.judged_duties].index(duty)
        names = (e.name for e in self.plan.entrants)
        return dict(zip(names, self.figures[figure][:, :, d], strict=True))

    def run(self, place: Place) -> dict[str, Any]:
        """What identifies a run."""
        e, s, d, p = place
        names = self.plan.entrants[e].name, s, self.plan.judged_duties[d].name, p
        return dict(zip(("controller", "tuning", "duty", "plant"), names, strict=True))

    def rows(self) -> dict[str, list[Any]]:
        """A row for each run, as columns."""
        draws = self.plan.draws("judge")
        varied = [v.name for v in self.plan.variations]
        rows = []
        for place in np.ndindex(self.figures[JUDGED_BY].shape):
            row = self.run(place) | dict(zip(varied, map(float, draws[place[-1]]), strict=True))
            row |= {name: float(self.figures[name][place]) for name in NAMES}
            row["hunting"] = hunting_verdict(row["hunting"])
            row["coupling"] = self.checks[place].coupling if place in self.checks else ""
            rows.append(row)
        return {name: [row[name] for row in rows] for name in rows[0]}

    def to_dict(self) -> dict[str, Any]:
        """The content of ``study.json``."""

        def each(of: Callable[[str, str], Any]) -> dict[str, dict[str, Any]]:
            names = [e.name for e in self.plan.entrants]
            return {d.name: {e: of(e, d.name) for e in names} for d in self.plan.judged_duties}

        return {
            "verdict": self.verdict,
            "weaknesses": self.doubts(),
            "version": 1,
            "plan": asdict(self.plan),
            "tunings": {n: [asdict(t) for t in ts] for n, ts in self.tunings.items()},
            "answers": [asdict(a) for a in self.answers],
            "differences": {
                duty: [{"first": a, "second": b, **asdict(d)} for (a, b), d in pairs.items()]
                for duty, pairs in self.differences.items()
            },
            "over_fmus": [self.run(place) | asdict(c) for place, c in self.checks.items()],
            "hunting": each(self.hunting),
            "intervals": each(lambda e, d: {n: asdict(self.mean(n, e, d)) for n in MEASURED}),
        }

    def write(self, folder: Path) -> None:
        """Write ``study.json`` and the table of runs."""
        write_json(folder / "study.json", self.to_dict())
        write_table(folder, "runs", [self.rows()])


def concluded(
    plan: Plan,
    tunings: Mapping[str, list[Tuned]],
    figures: Mapping[str, Matrix],
    checks: dict[Place, FmuCheck],
    courses: dict[str, dict[str, Shown]],
) -> StudyResult:
    """The result of a study from its runs."""
    names = [e.name for e in plan.entrants]
    errors = np.maximum(figures[JUDGED_BY], SMALLEST)
    failed = figures["failed"] > 0
    answers, differences = [], {}
    for d, duty in enumerate(plan.judged_duties):
        lost = {n: int(failed[e, :, d].sum()) for e, n in enumerate(names)}
        by_name = {n: errors[e, :, d] for e, n in enumerate(names) if not lost[n]}
        order = sorted(by_name, key=lambda n: float(np.log(by_name[n]).mean()))
        pairs = {(a, b): compare(by_name[a], by_name[b]) for a, b in combinations(order, 2)}
        near = {b: pairs[a, b] for a, b in pairs if a == order[0] and not pairs[a, b].told_apart}
        best = (*order[:1], *(n for n, found in near.items() if found.alike))
        unclear = tuple(n for n, found in near.items() if not found.alike)
        answers.append(DutyAnswer(duty.name, tuple(order), best, unclear, lost))
        differences[duty.name] = pairs
    return StudyResult(plan, tunings, figures, answers, differences, checks, courses)


def _listed(words: Sequence[str]) -> str:
    """Words with commas, and "and" before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

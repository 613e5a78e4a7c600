"""Result of a study: tables, significant differences, the answer in words, and its limitations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..loop.parts import Part
from .figures import NAMES, SIZES, hunting_verdict
from .loop import TRUSTED, FmuCheck
from .plan import Plan
from .statistics import (
    ALIKE,
    Difference,
    Mean,
    Sensitivity,
    compare,
    mean_over_plants,
    sensitivity,
)
from .tuning import Tuned

Array = npt.NDArray[np.float64]

JUDGED_BY = "rms_error"
SMALLEST = 1e-12  # m; errors below it are equal
MEASURED = tuple(n for n in NAMES if n not in ("hunting", "failed"))  # without verdicts


class Run(NamedTuple):
    """Numbers that identify a run of a study."""

    controller: str
    tuning: int
    duty: str
    plant: int


@dataclass(frozen=True)
class Shown:
    """A run for the report, at some hundreds of times; empty if it failed."""

    time: list[float]  # [s]
    error: list[float]  # set-point minus position [m]
    command: list[float]  # in the unit of the plant's command


@dataclass(frozen=True)
class DutyAnswer:
    """The best controllers at a duty."""

    duty: str
    # controllers by their geometric mean error, the best first; without those that failed
    order: tuple[str, ...]
    best: tuple[str, ...]  # the first one, and all that are shown to be equal to it within 10 %
    unclear: tuple[str, ...]  # those of which these runs cannot tell whether they differ from it
    failed: dict[str, int]  # failed runs by controller


@dataclass(frozen=True)
class StudyResult:
    """A finished study."""

    plan: Plan
    tunings: dict[str, list[Tuned]]  # by controller, one for each seed
    # shape (controllers, seeds, duties, plants); by name, see `Figures`
    figures: dict[str, Array] = field(repr=False)
    answers: list[DutyAnswer]
    # by duty and pair of controllers, of the rms error
    differences: dict[str, dict[tuple[str, str], Difference]]
    sensitivities: dict[str, Sensitivity]  # of the rms error, by controller
    checks: dict[Run, FmuCheck]  # runs that were repeated over FMUs
    # by duty and controller, for the nominal plant with the tuning of least cost
    courses: dict[str, dict[str, Shown]] = field(default_factory=dict, repr=False)

    @property
    def command_unit(self) -> str:
        """Unit of the plant's command, such as ``V``."""
        return Part(self.plan.plant).command_unit

    @property
    def disagreed(self) -> int:
        """Number of runs with different results over FMUs."""
        return sum(not c.agrees for c in self.checks.values())

    @property
    def not_converged(self) -> int:
        """Number of runs over FMUs whose coupling the master does not trust."""
        return sum(c.coupling not in ("", TRUSTED) for c in self.checks.values())

    def mean(self, figure: str, controller: str, duty: str) -> float:
        """Mean of a figure over tunings and plants; geometric for the rms error."""
        values = self._runs(figure, controller, duty)
        if figure == JUDGED_BY:
            return float(np.exp(np.mean(np.log(np.maximum(values, SMALLEST)))))
        finite = values[np.isfinite(values)]
        return float(finite.mean()) if len(finite) == values.size else math.nan

    def interval(self, figure: str, controller: str, duty: str) -> Mean:
        """Mean of a figure with its 90 % interval over plants.

        Geometric for figures that are positive in the runs of all controllers at this duty, see
        `SIZES`.
        """
        every = self._of_duty(figure, duty)
        geometric = figure in SIZES and bool((every[np.isfinite(every)] > 0).all())
        return mean_over_plants(self._runs(figure, controller, duty), geometric)

    def _runs(self, figure: str, controller: str, duty: str) -> Array:
        """A figure of all runs of a controller at a duty, by tuning and plant."""
        e = [e.name for e in self.plan.entrants].index(controller)
        found: Array = self._of_duty(figure, duty)[e]
        return found

    def _of_duty(self, figure: str, duty: str) -> Array:
        d = [d.name for d in self.plan.judged_duties].index(duty)
        return self.figures[figure][:, :, d]

    def hunting(self, controller: str, duty: str) -> dict[str, int]:
        """Numbers of runs by the verdict on hunting; see `Figures`."""
        said = [hunting_verdict(v) for v in self._runs("hunting", controller, duty).ravel()]
        return {word: said.count(word) for word in ("hunting", "none", "undecided")}

    def rows(self) -> dict[str, list[Any]]:
        """A row for each run, as columns."""
        plan = self.plan
        draws = plan.draws("judge")
        columns: dict[str, list[Any]] = {n: [] for n in ("controller", "tuning", "duty", "plant")}
        varied = [v.name for v in plan.variations]
        columns |= {n: [] for n in (*varied, *NAMES, "coupling")}
        for place in np.ndindex(self.figures[JUDGED_BY].shape):
            e, s, d, p = place
            run = Run(plan.entrants[e].name, s, plan.judged_duties[d].name, p)
            row = run._asdict() | dict(zip(varied, map(float, draws[p]), strict=True))
            row |= {name: float(self.figures[name][place]) for name in NAMES}
            row["hunting"] = hunting_verdict(row["hunting"])
            row["coupling"] = self.checks[run].coupling if run in self.checks else ""
            for name, value in row.items():
                columns[name].append(value)
        return columns

    def to_dict(self) -> dict[str, Any]:
        """The content of ``study.json``."""

        def each(of: Callable[[str, str], Any]) -> dict[str, dict[str, Any]]:
            names = [e.name for e in self.plan.entrants]
            return {d.name: {e: of(e, d.name) for e in names} for d in self.plan.judged_duties}

        return {
            "version": 1,
            "plan": asdict(self.plan),
            "tunings": {n: [asdict(t) for t in ts] for n, ts in self.tunings.items()},
            "answers": [asdict(a) for a in self.answers],
            "differences": {
                duty: [{"first": a, "second": b, **asdict(d)} for (a, b), d in pairs.items()]
                for duty, pairs in self.differences.items()
            },
            "sensitivities": {n: asdict(s) for n, s in self.sensitivities.items()},
            "over_fmus": [r._asdict() | asdict(c) for r, c in self.checks.items()],
            "hunting": each(self.hunting),
            "intervals": each(lambda e, d: {n: asdict(self.interval(n, e, d)) for n in MEASURED}),
            "means": each(lambda e, d: {n: self.mean(n, e, d) for n in NAMES}),
        }


def concluded(
    plan: Plan,
    tunings: Mapping[str, list[Tuned]],
    figures: Mapping[str, Array],
    checks: dict[Run, FmuCheck],
    courses: dict[str, dict[str, Shown]],
) -> StudyResult:
    """The result of a study from its runs."""
    names = [e.name for e in plan.entrants]
    errors = np.maximum(figures[JUDGED_BY], SMALLEST)
    failed = figures["failed"] > 0
    answers, differences = [], {}
    for d, duty in enumerate(plan.judged_duties):
        lost = {n: int(failed[e, :, d].sum()) for e, n in enumerate(names)}
        compared = [n for n in names if not lost[n]]
        by_name = {n: errors[names.index(n), :, d] for n in compared}
        order = sorted(compared, key=lambda n: float(np.log(by_name[n]).mean()))
        pairs = {
            (a, b): compare(by_name[a], by_name[b])
            for k, a in enumerate(order)
            for b in order[k + 1 :]
        }
        open_ = {n: pairs[order[0], n] for n in order[1:] if not pairs[order[0], n].told_apart}
        best = [n for n, d in open_.items() if d.alike]
        unclear = tuple(n for n, d in open_.items() if not d.alike)
        answers.append(DutyAnswer(duty.name, tuple(order), (*order[:1], *best), unclear, lost))
        differences[duty.name] = pairs
    return StudyResult(
        plan,
        dict(tunings),
        dict(figures),
        answers,
        differences,
        {n: _sensitivity(plan, errors[e], failed[e]) for e, n in enumerate(names)},
        checks,
        courses,
    )


def _sensitivity(plan: Plan, errors: Array, failed: Array) -> Sensitivity:
    """Sensitivity over all runs of a controller, each duty and tuning about its own mean."""
    varied = [v.name for v in plan.variations]
    if failed.any():
        return Sensitivity(dict.fromkeys(varied, 0.0), 0.0)
    logs = np.log(errors)
    about = np.exp(logs - logs.mean(axis=-1, keepdims=True))  # (seeds, duties, plants)
    draws = np.tile(plan.draws("judge"), (about.shape[0] * about.shape[1], 1))
    return sensitivity(draws, about.ravel(), varied)


FAR = 2.0  # times the least known cost of a controller: a tuning that ends above it failed


def sentence(study: StudyResult) -> str:
    """The controller that wins the most duties, their number, and the duties that it does not win.

    A duty is won by the controller with the smallest error; the numbers of duties at which others
    are equal, and at which the runs cannot tell, are given.
    """
    judged = [a for a in study.answers if a.order]
    if not judged:
        return "No controller completed any duty"
    firsts = [a.order[0] for a in judged]
    # the most duties; of two with equal numbers, the one that is named first in the study
    winner = max((e.name for e in study.plan.entrants), key=firsts.count)
    won = [a for a in judged if a.order[0] == winner]
    text = f"{winner} wins {len(won)} of {len(study.answers)} duties"
    shared = [a.duty for a in won if len(a.best) > 1]
    if shared:
        text += f", {len(shared)} of them together with others, equal within {100 * ALIKE:g} %"
    unclear = [a.duty for a in won if a.unclear]
    if unclear:
        text += f"; at {len(unclear)} of them {cannot_tell(study)} whether others are as good"
    lost: dict[str, list[str]] = {}
    for a in study.answers:
        if a not in won:
            by = f"{a.order[0]} does" if a.order else "no controller does"
            lost.setdefault(by, []).append(a.duty)
    if lost:
        others = [f"{_listed(duties)} ({by})" for by, duties in lost.items()]
        text += f"; it does not win {_listed(others)}"
    return text


def cannot_tell(study: StudyResult) -> str:
    seeds, plants = study.plan.tuning.seeds, study.plan.plants
    return f"{seeds} tuning{'s' if seeds > 1 else ''} on {plants} plants cannot tell"


def weaknesses(study: StudyResult) -> list[str]:
    """Limitations of the result, one sentence each; empty if there are none."""
    found = []
    failed = sum(sum(a.failed.values()) for a in study.answers)
    if failed:
        names = dict.fromkeys(n for a in study.answers for n, count in a.failed.items() if count)
        found.append(f"{failed} runs FAILED, of {_listed(list(names))}")
    if study.disagreed:
        found.append(f"{study.disagreed} of {len(study.checks)} runs DIFFER over FMUs")
    for name, tunings in study.tunings.items():
        least = min(t.doubled_cost for t in tunings)
        costs = [t.cost for t in tunings if t.cost > FAR * least]
        if costs:
            found.append(
                f"tuning of {name} FAILED in {len(costs)} of {len(tunings)} tries: it ended at a "
                f"cost of {max(costs):.3g}, but {least:.3g} was found with more budget or another "
                "seed"
            )
    for name in [e.name for e in study.plan.entrants if e.tune]:
        if all(t.cost >= t.published_cost for t in study.tunings[name]):
            found.append(f"tuning of {name} found no better values than the published ones")
    for name, duties in _overtaking(study).items():
        found.append(
            f"with more budget {name} might win {_listed(duties)}: twice the budget lowers its "
            f"cost to {100 * _gain(study, name):.2g} %"
        )
    return found


def _gain(study: StudyResult, name: str) -> float:
    """Cost with twice the budget over that with the budget: the median of the tunings."""
    return median(t.doubled_cost / t.cost if t.cost else 1.0 for t in study.tunings[name])


def _overtaking(study: StudyResult) -> dict[str, list[str]]:
    """Controllers that would win duties if errors fell like costs with twice the budget.

    Without those that are not shown to differ from the first one there.
    """
    found: dict[str, list[str]] = {}
    for a in study.answers:
        hoped = {n: _gain(study, n) * study.mean(JUDGED_BY, n, a.duty) for n in a.order}
        for name in a.order:
            if name not in {*a.best, *a.unclear} and hoped[name] < hoped[a.order[0]]:
                found.setdefault(name, []).append(a.duty)
    return found


def _listed(words: Sequence[str]) -> str:
    """Words with commas, and "and" before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

"""Do a study: tune every controller in the same way, test on other duties, and compare."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...solver.arrays import Matrix
from ...solver.errors import UserError
from ..loop.catalogue import fmu
from ..loop.loop import Loop
from .plan import Duty, Plan
from .result import Place, Shown, StudyResult, concluded
from .run import NAMES, FmuCheck, StudyLoop, check_over_fmus
from .tuning import Contender, Gains, Tuned, composed
from .workers import KeptParts, Processes, Workers

Progress = Callable[[str, int, int], None] | None
Tunings = Mapping[str, list[Tuned]]
Jobs = dict[Place, tuple[Any, ...]]  # arguments of each task of a stage

PARTS = "study.parts"  # folder of the finished tasks of an unfinished study
CHUNK = 10  # plants of a task
SHARE = 20  # one run in this many, drawn at random, is repeated over FMUs
SHOWN = 500  # times of a run that the report draws, at least
FIRST_JUDGED = 1000  # number of the first drawn plant to judge on; those to tune on count from 0
NOT_JUDGED = FIRST_JUDGED - 1  # a number whose noise no judged plant has


def do_study(
    plan: Plan, folder: Path, workers: Workers, resume: bool = False, progress: Progress = None
) -> StudyResult:
    """Do a study, or finish one.

    Finished parts are kept in ``study.parts`` in the folder until the caller removes it. `progress`
    gets the stage, the number of finished tasks, and that of all. Raises `UserError` if a part or a
    parameter does not exist, or the folder holds another study.
    """
    if sys.flags.optimize > 1:
        raise UserError("tuning needs docstrings, for cma; remove -OO, or PYTHONOPTIMIZE=2")
    work = Work.of(plan, folder / PARTS, workers, progress)
    work.parts.claim("study", resume)
    tunings = work.tunings()
    figures = work.figures(tunings)
    checks = work.checks(tunings, figures)
    return concluded(plan, tunings, figures, checks, work.courses(tunings))


def discard_parts(folder: Path) -> None:
    """Remove the parts that were kept until the study was finished."""
    KeptParts(folder / PARTS, "").discard()


@dataclass(frozen=True)
class Work:
    """The tasks of a study by stages; results of tasks are kept in files, and not made again."""

    plan: Plan
    contenders: Sequence[Contender]
    parts: KeptParts
    workers: Workers
    progress: Progress = None

    @classmethod
    def of(cls, plan: Plan, folder: Path, workers: Workers, progress: Progress = None) -> Work:
        """The tasks of a plan, with their results in a folder; raises as `do_study` does."""
        contenders = [Contender.of(plan, entrant) for entrant in plan.entrants]
        contenders[0].check_plants()
        # the results belong to this plan, its equations, and the tables that it names
        digest = hashlib.sha256(json.dumps([asdict(plan), NAMES], sort_keys=True).encode())
        for contender in contenders:
            digest.update(contender.loop.digest.encode())
        for table in (Path(duty.reference) for duty in plan.duties):
            digest.update(hashlib.sha256(table.read_bytes() if table.is_file() else b"").digest())
        parts = KeptParts(folder, digest.hexdigest()[:16])
        return cls(plan, contenders, parts, workers, progress)

    def tunings(self) -> dict[str, list[Tuned]]:
        """Tunings of each controller, one for each seed."""
        seeds, those = range(self.plan.tuning.seeds), self.contenders
        jobs: Jobs = {(k, s): (c, s) for k, c in enumerate(those) for s in seeds}
        done = self._done("tuning", _tuned, jobs)
        return {c.entrant.name: [Tuned(**done[k, s]) for s in seeds] for k, c in enumerate(those)}

    def figures(self, tunings: Tunings) -> dict[str, Matrix]:
        """Figures by name, shape (controllers, seeds, duties, plants)."""
        plants = range(self.plan.plants)
        jobs: Jobs = {
            (k, seed, d, first): (c, t.values, duty, plants[first : first + CHUNK])
            for k, c in enumerate(self.contenders)
            for seed, t in enumerate(tunings[c.entrant.name])
            for d, duty in enumerate(self.plan.judged_duties)
            for first in plants[::CHUNK]
        }
        rows = [row for chunk in self._done("judging", _judged, jobs).values() for row in chunk]
        table = np.array(rows, dtype=float)
        return {n: table[:, k].reshape(self._shape) for k, n in enumerate(NAMES)}

    def checks(self, tunings: Tunings, figures: Mapping[str, Matrix]) -> dict[Place, FmuCheck]:
        """A random twentieth of the runs, at least one, repeated over FMUs.

        Without those of controllers that are FMUs, which are already made so.
        """
        runs = math.prod(self._shape)
        random = np.random.default_rng([self.plan.seed, len(PARTS)])
        drawn = np.sort(random.choice(runs, math.ceil(runs / SHARE), replace=False))
        places = (tuple(map(int, np.unravel_index(number, self._shape))) for number in drawn)
        jobs: Jobs = {}
        for k, seed, d, p in places:
            c, duty = self.contenders[k], self.plan.judged_duties[d]
            if isinstance(c.loop, StudyLoop):
                table = {name: float(figure[k, seed, d, p]) for name, figure in figures.items()}
                gains = tunings[c.entrant.name][seed].values
                jobs[k, seed, d, p] = c, gains, duty, p, table
        # the FMUs are files
        here = self.workers if isinstance(self.workers, Processes) else Processes(1)
        done = replace(self, workers=here)._done("over-fmus", _checked, jobs)
        return {place: FmuCheck(**found) for place, found in done.items()}

    def courses(self, tunings: Tunings) -> dict[str, dict[str, Shown]]:
        """Each judged duty on the nominal plant, by every controller with its tuning of least cost.

        By duty and controller.
        """
        best = [min(tunings[c.entrant.name], key=lambda t: t.cost) for c in self.contenders]
        jobs: Jobs = {
            (d, k): (c, best[k].values, duty)
            for d, duty in enumerate(self.plan.judged_duties)
            for k, c in enumerate(self.contenders)
        }
        found: dict[str, dict[str, Shown]] = {d.name: {} for d in self.plan.judged_duties}
        for (d, k), shown in self._done("courses", _shown, jobs).items():
            found[self.plan.judged_duties[d].name][self.contenders[k].entrant.name] = Shown(*shown)
        return found

    def _done(self, stage: str, function: Callable[..., Any], jobs: Jobs) -> dict[Place, Any]:
        """Results of all jobs in their order; those that are on disk are not done again."""
        places = {f"{stage}-{'-'.join(map(str, place))}.json": place for place in jobs}
        named = {name: jobs[place] for name, place in places.items()}
        results: dict[Place, Any] = dict.fromkeys(jobs)
        done = self.parts.results(named, function, self.workers)
        for count, (name, found) in enumerate(done, start=1):
            results[places[name]] = found
            if self.progress:
                self.progress(stage, count, len(jobs))
        return results

    @property
    def _shape(self) -> Place:
        plan = self.plan
        return len(plan.entrants), plan.tuning.seeds, len(plan.judged_duties), plan.plants


def _tuned(contender: Contender, seed: int) -> dict[str, Any]:
    return asdict(contender.tuned(seed))


def _judged(c: Contender, gains: Gains, duty: Duty, plants: Iterable[int]) -> list[list[float]]:
    """Figures on some of the plants, one row each."""
    draws = c.plan.draws("judge")
    return [[*c.run(gains, duty, draws[p], FIRST_JUDGED + p)[1]] for p in plants]


def _shown(contender: Contender, gains: Gains, duty: Duty) -> Sequence[list[float]]:
    """A run on the nominal plant, thinned out; see `Shown`."""
    course, _ = contender.run(gains, duty, list(contender.plan.nominal), NOT_JUDGED)
    if course.stopped:
        return [], [], []
    every = slice(None, None, max(1, len(course.time) // SHOWN))
    signals = course.time, course.reference - course.position, course.command
    return [[float(f"{v:.5g}") for v in signal[every]] for signal in signals]


def _checked(
    c: Contender, gains: Gains, duty: Duty, p: int, table: Mapping[str, float]
) -> dict[str, Any]:
    """A run on a drawn plant, repeated over FMUs."""
    values = c.values(gains, duty, c.plan.draws("judge")[p], FIRST_JUDGED + p)
    over = Loop(fmu(composed(c.plan, c.entrant)), fmu(c.plan.plant), isolate=False)
    checked = c.loop, over.with_values(values), duty.motion, c.plan.tolerance, table
    return asdict(check_over_fmus(*checked))

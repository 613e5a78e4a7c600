"""Do a study: tune every controller in the same way, test on other duties, and compare."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...plant.instruments import INSTRUMENTS
from ...solver.errors import (
    BadParameter,
    ContractError,
    CouplingError,
    FmuError,
    UnknownName,
    UserError,
)
from ..loop.catalogue import component, fmu, in_units_of
from ..loop.loop import Loop
from ..loop.parts import SUFFIX
from ..loop.whole_loop import loop_kernel
from ..master.reference_signal import Reference
from .figures import NAMES
from .loop import COMPARED, SHARE, STEP, FmuCheck, FmuLoop, StudyLoop, check_over_fmus
from .plan import Duty, Entrant, Plan
from .result import Array, Run, Shown, StudyResult, concluded
from .tuning import Contender, Tuned
from .workers import KeptParts, Processes

if TYPE_CHECKING:
    from ...solver.component import Component
    from .workers import Workers

Progress = Callable[[str, int, int], None]
Contenders = Mapping[str, Contender]
Tunings = Mapping[str, list[Tuned]]

PARTS = "study.parts"
CHUNK = 10  # plants of a task
SHOWN = 500  # times of a run that the report draws, at least
FIRST_JUDGED = 1000  # number of the first drawn plant to judge on; those to tune on count from 0
NOT_JUDGED = FIRST_JUDGED - 1  # a number whose noise no judged plant has


def do_study(
    plan: Plan,
    folder: Path,
    workers: Workers,
    resume: bool = False,
    progress: Progress | None = None,
) -> StudyResult:
    """Do a study, or finish one.

    Finished parts are kept in ``study.parts`` in the folder until the caller removes it. `progress`
    gets the stage, the number of finished tasks, and that of all. Raises `UserError` if a part or a
    parameter does not exist, or the folder holds another study.
    """
    if sys.flags.optimize > 1:
        raise UserError(
            "the package cma, which is used for tuning, needs docstrings; remove "
            "-OO, or set PYTHONOPTIMIZE to less than 2"
        )
    work = Work.of(plan, folder / PARTS, workers, progress)
    work.parts.claim("study", resume, UserError)
    tunings = work.tunings()
    figures = work.figures(tunings)
    checks = work.checks(tunings, figures)
    return concluded(plan, tunings, figures, checks, work.courses(tunings))


def contenders_of(plan: Plan) -> dict[str, Contender]:
    """Each controller in its closed loop; raises as `do_study` does."""
    found = {e.name: _contender(plan, e) for e in plan.entrants}
    found[plan.entrants[0].name].check_plants()
    return found


def parts_of(plan: Plan, contenders: Contenders, folder: Path) -> KeptParts:
    """The finished parts of this study only: of its plan, its equations, the tables it names."""
    text = plan.to_json() + ",".join(NAMES) + "".join(c.loop.digest for c in contenders.values())
    tables = (hashlib.sha256(duty.table()).digest() for duty in plan.duties)
    return KeptParts(folder, hashlib.sha256(b"".join([text.encode(), *tables])).hexdigest()[:16])


def discard_parts(folder: Path) -> None:
    """Remove the parts that were kept until the study was finished."""
    KeptParts(folder / PARTS, "").discard()


@dataclass(frozen=True)
class Work:
    """The tasks of a study by stages; results of tasks are kept in files, and not made again."""

    plan: Plan
    contenders: Contenders
    parts: KeptParts
    workers: Workers
    progress: Progress | None = None

    @classmethod
    def of(
        cls, plan: Plan, folder: Path, workers: Workers, progress: Progress | None = None
    ) -> Work:
        """The tasks of a plan, with their results in a folder; raises as `do_study` does."""
        contenders = contenders_of(plan)
        return cls(plan, contenders, parts_of(plan, contenders, folder), workers, progress)

    def tunings(self) -> dict[str, list[Tuned]]:
        """Tunings of each controller, one for each seed."""
        seeds = range(self.plan.tuning.seeds)
        jobs = {
            f"tune-{k}-{seed}.json": (c, seed)
            for k, c in enumerate(self.contenders.values())
            for seed in seeds
        }
        done = self._done(jobs, _tuned, "tuning")
        return {
            name: [Tuned(**done[f"tune-{k}-{seed}.json"]) for seed in seeds]
            for k, name in enumerate(self.contenders)
        }

    def figures(self, tunings: Tunings) -> dict[str, Array]:
        """Figures by name, shape (controllers, seeds, duties, plants)."""
        plants = range(self.plan.plants)
        jobs = {
            f"run-{k}-{seed}-{d}-{first}.json": (c, t.values, duty, plants[first : first + CHUNK])
            for k, c in enumerate(self.contenders.values())
            for seed, t in enumerate(tunings[c.entrant.name])
            for d, duty in enumerate(self.plan.judged_duties)
            for first in plants[::CHUNK]
        }
        found = self._done(jobs, _judged, "judging")
        table = np.array([row for name in jobs for row in found[name]], dtype=float)
        return {n: table[:, k].reshape(_shape(self.plan)) for k, n in enumerate(NAMES)}

    def checks(self, tunings: Tunings, figures: Mapping[str, Array]) -> dict[Run, FmuCheck]:
        """Some runs, repeated over FMUs; those with an FMU are already made so."""
        runs = {
            run: place
            for run, place in runs_again(self.plan).items()
            if isinstance(self.contenders[run.controller].loop, StudyLoop)
        }
        tasks = [self._check(run, place, tunings, figures) for run, place in runs.items()]
        jobs = {f"fmu-{k}.json": task for k, task in enumerate(tasks)}
        # the FMUs are files
        here = self.workers if isinstance(self.workers, Processes) else Processes(1)
        done = replace(self, workers=here)._done(jobs, _checked, "over FMUs")
        return {run: FmuCheck(**done[name]) for run, name in zip(runs, jobs, strict=True)}

    def _check(
        self, run: Run, place: tuple[int, ...], tunings: Tunings, figures: Mapping[str, Array]
    ) -> tuple[Any, ...]:
        """A task for `check_over_fmus`."""
        plan, c = self.plan, self.contenders[run.controller]
        (duty,) = (d for d in plan.judged_duties if d.name == run.duty)
        drawn = plan.draws("judge")[run.plant]
        gains = tunings[run.controller][run.tuning].values
        values = c.values(gains, duty, drawn, FIRST_JUDGED + run.plant)
        fmus = str(fmu(plan.plant)), str(fmu(composed(plan, c.entrant)))
        table = {name: float(figures[name][place]) for name in COMPARED}
        return c.loop, fmus, values, duty, plan.tolerance, table

    def courses(self, tunings: Tunings) -> dict[str, dict[str, Shown]]:
        """Each judged duty on the nominal plant, by every controller with its best tuning."""
        jobs = {f"course-{k}-{d}.json": best for (k, d), best in self._best(tunings)}
        done = self._done(jobs, _shown, "courses")
        return {
            duty.name: {
                name: Shown(**done[f"course-{k}-{d}.json"])
                for k, name in enumerate(self.contenders)
            }
            for d, duty in enumerate(self.plan.judged_duties)
        }

    def _best(self, tunings: Tunings) -> Iterator[tuple[tuple[int, int], tuple[Any, ...]]]:
        """Number of controller and duty, and the contender with its gains of least cost there."""
        for k, c in enumerate(self.contenders.values()):
            best = min(tunings[c.entrant.name], key=lambda t: t.cost)
            for d, duty in enumerate(self.plan.judged_duties):
                yield (k, d), (c, best.values, duty)

    def _done(
        self, jobs: Mapping[str, tuple[Any, ...]], function: Callable[..., Any], stage: str
    ) -> dict[str, Any]:
        """Results of all jobs by name; those that are on disk are not done again."""
        results: dict[str, Any] = {}
        for name, found in self.parts.results(jobs, function, self.workers):
            results[name] = found
            if self.progress:
                self.progress(stage, len(results), len(jobs))
        return results


def _shape(plan: Plan) -> tuple[int, int, int, int]:
    return len(plan.entrants), plan.tuning.seeds, len(plan.judged_duties), plan.plants


def runs_again(plan: Plan) -> dict[Run, tuple[int, ...]]:
    """A random twentieth of the runs, at least one, with their places in the table of figures."""
    runs = math.prod(_shape(plan))
    random = np.random.default_rng([plan.seed, len(PARTS)])
    numbers = np.sort(random.choice(runs, math.ceil(runs / SHARE), replace=False))
    places = (tuple(map(int, np.unravel_index(number, _shape(plan)))) for number in numbers)
    entrants, duties = plan.entrants, plan.judged_duties
    return {Run(entrants[e].name, s, duties[d].name, p): (e, s, d, p) for e, s, d, p in places}


def _tuned(contender: Contender, seed: int) -> dict[str, Any]:
    return asdict(contender.tuned(seed))


def _judged(
    contender: Contender, gains: Mapping[str, float], duty: Duty, plants: Iterable[int]
) -> list[list[float]]:
    """Figures on some of the plants, one row each."""
    draws = contender.plan.draws("judge")
    runs = (contender.run(gains, duty, draws[p], FIRST_JUDGED + p) for p in plants)
    return [[float(getattr(found, n)) for n in NAMES] for _, found in runs]


def _shown(contender: Contender, gains: Mapping[str, float], duty: Duty) -> dict[str, list[float]]:
    """A run on the nominal plant, thinned out; see `Shown`."""
    course, _ = contender.run(gains, duty, list(contender.plan.nominal), NOT_JUDGED)
    if course.stopped:
        return asdict(Shown([], [], []))
    every = slice(None, None, max(1, len(course.time) // SHOWN))
    error = course.reference - course.position
    kept = ([float(f"{v:.5g}") for v in a[every]] for a in (course.time, error, course.command))
    return asdict(Shown(*kept))


def _checked(*task: Any) -> dict[str, Any]:
    return asdict(check_over_fmus(*task))


def composed(plan: Plan, entrant: Entrant) -> Component:
    """The entrant's controller in the form for the study: digital, with the instruments.

    Raises `UnknownName`, `ContractError`.
    """
    from ...plant.instruments.measured_through import measured_through
    from ...plant.instruments.sample_and_hold import PERIOD, sampled

    controller = component(in_units_of(entrant.component, plan.plant))
    if not plan.period:
        return controller
    period = replace(PERIOD, default=plan.period, source="the study")

    def in_time(part: Component) -> Component:
        return replace(part, sample_time=period) if part.sample_time else part

    if controller.discrete:
        controller = in_time(controller)
    else:
        controller = sampled(controller, period, plan.delay)
    unknown = [name for name in plan.instruments if name not in INSTRUMENTS]
    if unknown:
        raise UserError(f"no instrument {unknown[0]!r}; there are {', '.join(INSTRUMENTS)}")
    instruments = [in_time(component(in_units_of(n, plan.plant))) for n in plan.instruments]
    return measured_through(controller, instruments) if instruments else controller


def _contender(plan: Plan, entrant: Entrant) -> Contender:
    if Path(entrant.component).suffix == SUFFIX:
        return _with_fmu(plan, entrant)
    try:
        kernel = loop_kernel(component(plan.plant), composed(plan, entrant))
    except (UnknownName, ContractError) as error:
        raise UserError(f"controllers.{entrant.name} on {plan.plant}: {error}") from error
    found = Contender(plan, entrant, StudyLoop(kernel))
    found.check()
    kernel.compile()
    return found


def _with_fmu(plan: Plan, entrant: Entrant) -> Contender:
    """A loop with an FMU as controller: at the sampling period of the study, or continuous."""
    where = f"controllers.{entrant.name}"
    if plan.instruments or plan.delay:
        raise UserError(f"{where}: instruments and a delay are for equations, this is an FMU")
    try:
        loop = FmuLoop(Loop(entrant.component, plan.plant, sampled=plan.period or None))
        found = Contender(plan, entrant, loop)
        found.check()
        loop.run({}, Reference.constant(0.0), 2.0 * (plan.period or STEP))
    except (BadParameter, CouplingError, FmuError) as error:
        raise UserError(f"{where}: {error}") from error
    return found

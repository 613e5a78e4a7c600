"""Do a study: tune every controller in the same way, test on other duties, and compare."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...fmus.reading import FmuError
from ...solver.kernel import CONTROLLER, PLANT
from ..kept_parts import KeptParts
from ..limits import BadParameter
from ..loop import Loop
from ..loop_run import CouplingError
from ..parts import SUFFIX, BadPart
from ..reference_signal import Reference
from ..whole_loop import loop_kernel
from ..wiring import WiringError
from ..workers import Processes
from .figures import NAMES, Figures, figures_of
from .loop import STEP, FmuLoop, StudyLoop
from .over_fmus import COMPARED, SHARE, FmuCheck, check_over_fmus
from .plan import Duty, Entrant, Plan
from .reading import BadPlan
from .result import JUDGED_BY, SMALLEST, Array, Run, Shown, StudyResult, concluded
from .sobol import SobolIndex, sobol_indices
from .tuning import Tuned, tune
from .values import LIMIT, check_controller, check_plants, limit_of, values_for

if TYPE_CHECKING:
    from ...solver.component import Component
    from ..workers import Workers

Progress = Callable[[str, int, int], None]
AnyLoop = StudyLoop | FmuLoop

PARTS = "study.parts"
FAILED = 1e6  # cost of a candidate whose run fails, for each such run
OVER_LIMIT = 10.0  # cost for each limit that is exceeded by its own size
CHUNK = 10  # plants of a task
SHOWN = 500  # times of a run that the report draws, at least
FIRST_JUDGED = 1000  # number of the first drawn plant to judge on; those to tune on count from 0


def do_study(
    plan: Plan,
    folder: Path,
    workers: Workers,
    resume: bool = False,
    progress: Progress | None = None,
) -> StudyResult:
    """Do a study, or finish one.

    Finished parts are kept in ``study.parts`` in the folder until the caller removes it.

    Parameters
    ----------
    progress : function, optional
        Called with the stage, the number of finished runs, and the number of all runs.

    Raises
    ------
    BadPlan
        If a part or a parameter does not exist, or the folder holds another study.
    """
    if sys.flags.optimize > 1:
        raise BadPlan(
            "the package cma, which is used for tuning, needs docstrings; remove "
            "-OO, or set PYTHONOPTIMIZE to less than 2"
        )
    loops = loops_of(plan)
    parts = parts_of(plan, loops, folder / PARTS)
    parts.claim("study", resume, BadPlan)
    tunings, figures = tuned_and_judged(plan, loops, parts.folder, workers, progress)
    runs = [r for r in runs_again(plan) if isinstance(loops[r.controller], StudyLoop)]
    again = _checks(plan, loops, tunings, figures, runs)
    here = workers if isinstance(workers, Processes) else Processes(1)  # the FMUs are files
    checked = _computed(parts, again, _checked, here, "over FMUs", progress)
    checks = {run: FmuCheck(**checked[name]) for run, name in zip(runs, again, strict=True)}
    sobol = _sobol(plan, loops, tunings, parts, workers, progress)
    courses = _courses(plan, loops, tunings, parts, workers, progress)
    return concluded(plan, tunings, figures, checks, sobol, courses)


def loops_of(plan: Plan) -> dict[str, AnyLoop]:
    """The closed loop of each controller; raises as `do_study` does."""
    loops = {e.name: _loop(plan, e) for e in plan.entrants}
    check_plants(plan, loops[plan.entrants[0].name].kernel)
    return loops


def tuned_and_judged(
    plan: Plan,
    loops: Mapping[str, AnyLoop],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> tuple[dict[str, list[Tuned]], dict[str, Array]]:
    """Tunings of each controller, and figures by name, (controllers, seeds, duties, plants).

    Each task's result is kept in the folder; tasks with a result there are not done again.
    """
    parts = parts_of(plan, loops, folder)
    jobs = {
        f"tune-{k}-{seed}.json": (plan, e, loops[e.name], seed)
        for k, e in enumerate(plan.entrants)
        for seed in range(plan.tuning.seeds)
    }
    done = _computed(parts, jobs, _tuned, workers, "tuning", progress)
    tunings = {
        e.name: [Tuned(**done[f"tune-{k}-{s}.json"]) for s in range(plan.tuning.seeds)]
        for k, e in enumerate(plan.entrants)
    }
    runs = {
        f"run-{k}-{seed}-{d}-{first}.json": (
            plan,
            e,
            loops[e.name],
            tunings[e.name][seed].values,
            duty,
            range(first, min(first + CHUNK, plan.plants)),
        )
        for k, e in enumerate(plan.entrants)
        for seed in range(plan.tuning.seeds)
        for d, duty in enumerate(plan.judged_duties)
        for first in range(0, plan.plants, CHUNK)
    }
    found = _computed(parts, runs, _judged, workers, "judging", progress)
    table = np.array([row for name in runs for row in found[name]], dtype=float)
    shape = len(plan.entrants), plan.tuning.seeds, len(plan.judged_duties), plan.plants
    return tunings, {n: table[:, k].reshape(shape) for k, n in enumerate(NAMES)}


def runs_again(plan: Plan) -> list[Run]:
    """A random twentieth of the runs, at least one: finished runs to repeat over FMUs."""
    entrants, duties = plan.entrants, plan.judged_duties
    shape = len(entrants), plan.tuning.seeds, len(duties), plan.plants
    runs = math.prod(shape)
    random = np.random.default_rng([plan.seed, len(PARTS)])
    numbers = np.sort(random.choice(runs, math.ceil(runs / SHARE), replace=False))
    places = (map(int, np.unravel_index(number, shape)) for number in numbers)
    return [Run(entrants[e].name, s, duties[d].name, p) for e, s, d, p in places]


def _checks(
    plan: Plan,
    loops: Mapping[str, AnyLoop],
    tunings: Mapping[str, list[Tuned]],
    figures: Mapping[str, Array],
    runs: list[Run],
) -> dict[str, tuple[Any, ...]]:
    """Runs as tasks over FMUs."""
    from ..catalogue import fmu

    entrants = {e.name: e for e in plan.entrants}
    duties = {d.name: d for d in plan.judged_duties}
    plant = str(fmu(plan.plant))
    names = sorted({run.controller for run in runs})
    controllers = {n: str(fmu(composed(plan, entrants[n]))) for n in names}
    order = list(entrants), list(duties)
    tasks: dict[str, tuple[Any, ...]] = {}
    for k, run in enumerate(runs):
        loop, entrant, duty = loops[run.controller], entrants[run.controller], duties[run.duty]
        tuned = tunings[run.controller][run.tuning].values
        drawn, number = plan.draws("judge")[run.plant], FIRST_JUDGED + run.plant
        values = values_for(plan, loop.kernel, entrant, tuned, duty, drawn, number)
        fmus = plant, controllers[run.controller]
        place = order[0].index(run.controller), run.tuning, order[1].index(run.duty), run.plant
        table = {name: float(figures[name][place]) for name in COMPARED}
        tasks[f"fmu-{k}.json"] = loop, fmus, values, duty, plan.tolerance, table
    return tasks


def _sobol(
    plan: Plan,
    loops: Mapping[str, AnyLoop],
    tunings: Mapping[str, list[Tuned]],
    parts: KeptParts,
    workers: Workers,
    progress: Progress | None,
) -> dict[str, dict[str, dict[str, SobolIndex]]]:
    """Indices of the error by controller, duty and variation; empty if not requested.

    For the tuning of least cost, with one noise: the figure then depends on the plant only.
    """
    if not plan.sobol:
        return {}
    draws = plan.sobol_draws()
    jobs = {}
    for k, entrant in enumerate(plan.entrants):
        best = min(tunings[entrant.name], key=lambda t: t.cost)
        for d, duty in enumerate(plan.judged_duties):
            common = plan, entrant, loops[entrant.name], best.values, duty
            for first in range(0, len(draws), CHUNK):
                jobs[f"sobol-{k}-{d}-{first}.json"] = *common, draws[first : first + CHUNK]
    done = _computed(parts, jobs, _errors_on, workers, "Sobol indices", progress)
    names = [v.name for v in plan.variations]

    def indices(k: int, d: int) -> dict[str, SobolIndex]:
        chunks = (done[f"sobol-{k}-{d}-{first}.json"] for first in range(0, len(draws), CHUNK))
        errors = np.maximum([error for chunk in chunks for error in chunk], SMALLEST)
        return sobol_indices(errors, names, plan.seed)

    duties = list(enumerate(plan.judged_duties))
    return {
        entrant.name: {duty.name: indices(k, d) for d, duty in duties}
        for k, entrant in enumerate(plan.entrants)
    }


def _courses(
    plan: Plan,
    loops: Mapping[str, AnyLoop],
    tunings: Mapping[str, list[Tuned]],
    parts: KeptParts,
    workers: Workers,
    progress: Progress | None,
) -> dict[str, dict[str, Shown]]:
    """Each judged duty on the nominal plant, by every controller with its tuning of least cost."""
    jobs = {}
    for k, entrant in enumerate(plan.entrants):
        best = min(tunings[entrant.name], key=lambda t: t.cost)
        for d, duty in enumerate(plan.judged_duties):
            jobs[f"course-{k}-{d}.json"] = plan, entrant, loops[entrant.name], best.values, duty
    done = _computed(parts, jobs, _shown, workers, "courses", progress)
    return {
        duty.name: {
            e.name: Shown(**done[f"course-{k}-{d}.json"]) for k, e in enumerate(plan.entrants)
        }
        for d, duty in enumerate(plan.judged_duties)
    }


def _shown(
    plan: Plan, entrant: Entrant, loop: AnyLoop, tuned: Mapping[str, float], duty: Duty
) -> dict[str, list[float]]:
    """A run on the nominal plant, thinned out; see `Shown`."""
    number = FIRST_JUDGED - 1  # whose noise no judged plant has
    values = values_for(plan, loop.kernel, entrant, tuned, duty, list(plan.nominal), number)
    course = loop.run(values, duty.signal(), duty.stop, plan.tolerance)
    if course.stopped:
        return asdict(Shown([], [], []))
    every = slice(None, None, max(1, len(course.time) // SHOWN))
    error = course.reference - course.position
    kept = ([float(f"{v:.5g}") for v in a[every]] for a in (course.time, error, course.command))
    return asdict(Shown(*kept))


def _errors_on(
    plan: Plan,
    entrant: Entrant,
    loop: AnyLoop,
    tuned: Mapping[str, float],
    duty: Duty,
    draws: Array,
) -> list[float]:
    """The error that controllers are judged by on each of these plants; NaN if a run failed."""
    number = FIRST_JUDGED - 1  # whose noise no judged plant has
    return [
        float(getattr(_measured(plan, loop, values, duty), JUDGED_BY))
        for values in (
            values_for(plan, loop.kernel, entrant, tuned, duty, drawn, number) for drawn in draws
        )
    ]


def _checked(*task: Any) -> dict[str, Any]:
    return asdict(check_over_fmus(*task))


def discard_parts(folder: Path) -> None:
    """Remove the parts that were kept until the study was finished."""
    KeptParts(folder / PARTS, "").discard()


def composed(plan: Plan, entrant: Entrant) -> Component:
    """The entrant's controller in the form for the study: digital, with the instruments.

    Raises
    ------
    UnknownComponent, BadComponentFile, ContractError
    """
    from ...instruments import INSTRUMENTS
    from ...instruments.measured_through import measured_through
    from ...instruments.sample_and_hold import PERIOD, sampled
    from ..catalogue import component, in_units_of

    def in_time(part: Component) -> Component:
        return replace(part, sample_time=period) if part.sample_time else part

    controller = component(in_units_of(entrant.component, plan.plant))
    if not plan.period:
        return controller
    period = replace(PERIOD, default=plan.period, source="the study")
    if controller.discrete:
        controller = in_time(controller)
    else:
        controller = sampled(controller, period, plan.delay)
    unknown = [name for name in plan.instruments if name not in INSTRUMENTS]
    if unknown:
        raise BadPlan(f"no instrument {unknown[0]!r}; there are {', '.join(INSTRUMENTS)}")
    if not plan.instruments:
        return controller
    instruments = [component(in_units_of(n, plan.plant)) for n in plan.instruments]
    return measured_through(controller, [in_time(i) for i in instruments])


def _loop(plan: Plan, entrant: Entrant) -> AnyLoop:
    from ...solver.component_file import BadComponentFile
    from ...solver.contract_error import ContractError
    from ..catalogue import UnknownComponent, component

    if Path(entrant.component).suffix == SUFFIX:
        return _fmu_loop(plan, entrant)
    try:
        kernel = loop_kernel(component(plan.plant), composed(plan, entrant))
    except (UnknownComponent, BadComponentFile, ContractError) as error:
        raise BadPlan(f"controllers.{entrant.name} on {plan.plant}: {error}") from error
    check_controller(entrant, kernel)
    kernel.compile()
    return StudyLoop(kernel)


def _fmu_loop(plan: Plan, entrant: Entrant) -> FmuLoop:
    """A loop with an FMU as controller: at the sampling period of the study, or continuous."""
    where = f"controllers.{entrant.name}"
    if plan.instruments or plan.delay:
        raise BadPlan(f"{where}: instruments and a delay are for equations, this is an FMU")
    try:
        loop = FmuLoop(Loop(entrant.component, plan.plant, sampled=plan.period or None))
        check_controller(entrant, loop)
        loop.run({}, Reference.constant(0.0), 2.0 * (plan.period or STEP))
    except (BadPart, BadParameter, CouplingError, FmuError, WiringError) as error:
        raise BadPlan(f"{where}: {error}") from error
    return loop


def _measured(plan: Plan, loop: AnyLoop, values: Mapping[str, float], duty: Duty) -> Figures:
    course = loop.run(values, duty.signal(), duty.stop, plan.tolerance)
    return figures_of(course, plan.count, values.get(PLANT + LIMIT, limit_of(plan, loop.kernel)))


def _tuned(plan: Plan, entrant: Entrant, loop: AnyLoop, seed: int) -> dict[str, Any]:
    """A tuning of an entrant."""
    draws = plan.draws("tune")

    def cost(values: Mapping[str, float]) -> float:
        total = 0.0
        for duty in plan.tuning_duties:
            size = float(np.abs(duty.signal().values).max())
            for number, drawn in enumerate(draws):
                given = values_for(plan, loop.kernel, entrant, values, duty, drawn, number)
                found = _measured(plan, loop, given, duty)
                if found.failed:
                    total += FAILED
                    continue
                total += found.rms_error / size
                for name, most in plan.tuning.limits.items():
                    reached = getattr(found, name)
                    if reached > most:
                        excess = reached / most - 1 if most > 0 else reached
                        total += OVER_LIMIT * min(excess, FAILED)
        return total / (len(plan.tuning_duties) * len(draws))

    defaults = {p.name: p.default for p in loop.kernel.parameters}
    published = {n: entrant.values.get(n, defaults[CONTROLLER + n]) for n in entrant.tune}
    for name, value in published.items():  # an FMU may give no start
        published[name] = value if math.isfinite(value) else sum(entrant.tune[name]) / 2
    number = [e.name for e in plan.entrants].index(entrant.name)
    random = [plan.seed, number, seed]
    return asdict(tune(cost, published, entrant.tune, plan.tuning.budget, random))


def _judged(
    plan: Plan,
    entrant: Entrant,
    loop: AnyLoop,
    tuned: Mapping[str, float],
    duty: Duty,
    plants: range,
) -> list[list[float]]:
    """Figures on some of the plants, one row each."""
    draws = plan.draws("judge")
    rows = []
    for plant in plants:
        number = FIRST_JUDGED + plant
        values = values_for(plan, loop.kernel, entrant, tuned, duty, draws[plant], number)
        found = _measured(plan, loop, values, duty)
        rows.append([float(getattr(found, n)) for n in NAMES])
    return rows


def parts_of(plan: Plan, loops: Mapping[str, AnyLoop], folder: Path) -> KeptParts:
    """The finished parts of this study only: of its plan, its equations, the tables it names."""
    text = plan.to_json() + ",".join(NAMES) + "".join(loop.kernel.module for loop in loops.values())
    tables = (hashlib.sha256(duty.table()).digest() for duty in plan.duties)
    return KeptParts(folder, hashlib.sha256(b"".join([text.encode(), *tables])).hexdigest()[:16])


def _computed(
    parts: KeptParts,
    jobs: Mapping[str, tuple[Any, ...]],
    function: Callable[..., Any],
    workers: Workers,
    stage: str,
    progress: Progress | None,
) -> dict[str, Any]:
    """Results of all jobs by name; those that are on disk are not done again."""
    results: dict[str, Any] = {}
    for name, found in parts.results(jobs, function, workers):
        results[name] = found
        if progress:
            progress(stage, len(results), len(jobs))
    return results

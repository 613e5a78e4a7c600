"""The public functions for studies: gains of one controller, and several controllers compared."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from .api import check_whole_number, loop_of, processes
from .orchestration.fmu.limits import as_number, check_length
from .part_api import read_again
from .solver.errors import UserError

if TYPE_CHECKING:
    from .api import OfLoop
    from .orchestration.loop.loop import Loop
    from .orchestration.loop.parts import PartLike
    from .study_results import SwapStudy, TunedGains


def tune(
    loop: Loop | PartLike,
    plant: PartLike | None = None,
    reference: str | None = None,
    stop: float | None = None,
    limit: float | None = None,
    *,
    budget: int = 100,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
    **others: Unpack[OfLoop],
) -> TunedGains:
    """Find the gains of one controller for one machine, and test them on another motion.

    The search is CMA-ES (Hansen, "The CMA evolution strategy", 2006); see ``docs/howto/tune.md``.

    Parameters
    ----------
    loop : Loop, or a controller
        Its set-point and coupling are not used.
    plant, plant_values, controller_values
        As in `run`. Gains among the values are a start of the search.
    reference : str, optional
        Motion for the tuning: its description or the path of a table. Default: a step and a
        reversing move within the limit.
    stop : float, optional
        Length of the reference [s]. Default: its end plus 0.5 s.
    limit : float, optional
        Largest command, in its unit. Default: ``voltage_limit`` of the plant; 36 V for an axis.
    budget : int
        Number of candidates; the same number again shows what more candidates would improve.
    seed : int
    progress : function of int and int, optional
        Called with the number of finished candidates and the number of all.

    Returns
    -------
    TunedGains
        ``values`` are the gains; ``trusted`` says whether all runs converged and
        the linearized loop is stable.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.tune("pid", "drive_lugre", limit=20.0, budget=4)
    >>> sorted(result.values), [m.state for m in result.margins]
    (['Kd', 'Ki', 'Kp'], ['stuck', 'sliding'])
    """
    from .orchestration.study.tune import tune_loop
    from .study_results import TunedGains

    if stop is not None and reference is None:
        raise UserError("stop is the length of reference; give reference as well")
    length = None if stop is None else check_length("stop", stop)
    count = check_whole_number("budget", budget, 2, 100_000)
    seed = check_whole_number("seed", seed, 0)
    limit = None if limit is None else as_number("limit", limit)
    own = loop_of(loop, plant=plant, **others)
    return TunedGains.of(tune_loop(own, reference, length, limit, count, seed, progress))


def swap_study(
    study: Path | str, folder: Path | str, resume: bool = False, workers: int = 1
) -> SwapStudy:
    """Tune several controllers in the same way, and compare them on other duties.

    They are compared by the ratio of their rms errors, with intervals after Welch (1947).

    Parameters
    ----------
    study : path-like
        A study file, see ``docs/study.md``.
    folder : path-like
        Folder for finished tasks until all are done; with `resume`, an interrupted study
        continues there.
    resume : bool
        Whether to finish the study in the folder.
    workers : int
        Processes.

    Returns
    -------
    SwapStudy
        ``trusted`` says whether no run failed, and whether a twentieth of them gave the same result
        when repeated over FMUs.

    Examples
    --------
    >>> import ballscrew, pathlib, tempfile
    >>> text = '''
    ... version = 1
    ... plants = 2
    ... controllers = {pid = {tune = {Kp = [50.0, 2000.0]}}, nctf = {tune = {}}}
    ... duty = [
    ...     {name = "there", reference = "step:size=1e-3", stop = 0.2, tune = true},
    ...     {name = "back", reference = "step:size=-1e-3", stop = 0.2}]
    ... tuning = {budget = 2, seeds = 1}
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pathlib.Path(folder, "study.toml").write_text(text)
    ...     found = ballscrew.swap_study(folder + "/study.toml", folder + "/out")
    >>> found.headline()
    'pid wins 1 of 1 duties. 2 controllers, 1 duties, 4 runs'
    """
    from .orchestration.study.plan import read_plan
    from .orchestration.study.study import discard_parts, do_study
    from .study_results import SwapStudy

    plan = read_plan(study)
    for part in (plan.plant, *(e.component for e in plan.entrants)):
        read_again(part)
    result = SwapStudy.of(do_study(plan, Path(folder), processes(workers), resume))
    discard_parts(Path(folder))
    return result

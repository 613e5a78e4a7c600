"""The public functions for loops: what the commands do, for programs and notebooks.

Values are in SI units throughout. A part is named (see `catalogue`), a function of a Python file
that returns a component (``mine.py:pi``), the path of an FMU, or a `Component` made in the
program. What cannot be used raises `UserError`, a ValueError, with one line: what was got, what was
expected. An OSError says that a file cannot be written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from .orchestration.fmu.limits import as_number, check_length
from .solver.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from .loop_results import Comparison, RunResult
    from .orchestration.loop.loop import Loop, SystemLoop
    from .orchestration.loop.parameter_file import ParameterFile
    from .orchestration.loop.parts import PartLike
    from .orchestration.loop.reference_motions import ReferenceLike
    from .orchestration.master.couplings import Coupling
    from .orchestration.study.workers import Processes
    from .stability.map_plan import MapPlan
    from .study_results import Exponents, StabilityMap

    Values = Mapping[str, float]


class OfPlant(TypedDict, total=False):
    """Arguments of `Loop` that may be the same for all controllers; None is the default."""

    step: float | None
    plant_values: Values | None
    sampled: float | None
    fmus: bool | None


class OfLoop(OfPlant, total=False):
    """Arguments of `Loop`, or what is to change in a given one."""

    controller_values: Values | None
    mapping: Mapping[str, str] | None
    coupling: str | Coupling | None


class OfMap(OfLoop, total=False):
    """All arguments of `Loop`."""

    plant: PartLike | None
    reference: ReferenceLike | None
    stop: float | None


def run(
    loop: Loop | SystemLoop | PartLike,
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    params: ParameterFile | Path | str | None = None,
    **others: Unpack[OfLoop],
) -> RunResult:
    """Run a closed loop, by default of FMUs, with a verdict on the coupling.

    Parameters
    ----------
    loop : Loop, SystemLoop, or a controller
        ``run("iol", stop=2.0)`` is ``run(Loop("iol", stop=2.0))``.
    plant, reference, stop, step, plant_values, controller_values, coupling, mapping, sampled, fmus
        As in `Loop`, with its defaults; if `loop` is a `Loop`, the values to change in it.
    progress : function of float, optional
        Called with the time that the run has reached [s].
    params : ParameterFile or path-like, optional
        Values of plant and controller, and the plant if it is not given; other arguments have
        priority.

    Returns
    -------
    RunResult
        ``trusted`` says whether the coupling moved no output by more than 1 % of its range, see
        ``docs/coupling.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.run("iol", stop=0.5)
    >>> result.trusted
    True
    >>> round(float(abs(result["u"]).max()), 1)
    32.1
    """
    from .loop_results import RunResult
    from .orchestration.loop.closed_loop import run_closed_loop
    from .orchestration.loop.loop import Loop, with_file

    found = loop_of(loop, plant=plant, reference=reference, stop=stop, **others)
    if (file := file_of(params)) is not None:
        if not isinstance(found, Loop):
            raise UserError("params is for a loop of two parts; an .ssp contains its values")
        found = with_file(found, file, chosen=plant is not None or found is loop)
    return RunResult.of(run_closed_loop(found, progress))


def swap(
    controllers: Sequence[Loop | PartLike],
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    *,
    noise: bool = False,
    controller_values: Mapping[str, Values] | None = None,
    mapping: Mapping[str, Mapping[str, str]] | None = None,
    progress: Callable[[str, float], None] | None = None,
    **others: Unpack[OfPlant],
) -> Comparison:
    """Run several controllers on the same plant, and compare them.

    Parameters
    ----------
    controllers : sequence of controllers, or of Loop
    plant, reference, stop, step, plant_values, fmus
        As in `run`.
    sampled : float, optional
        Sampling period of all controllers [s]; if left out, the controllers are not changed.
    noise : bool
        Whether all controllers measure through the instruments of `catalogue` that fit them.
    controller_values, mapping : mapping of str to mapping, optional
        As in `run`, for each controller by its name; ``hand`` is the name of ``hand.fmu``.
    progress : function of str and float, optional
        Called with the controller's name and the time that its run has reached [s].

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.swap(["iol", "pid"], stop=0.2, controller_values={"pid": {"Kp": 300.0}})
    >>> [r.loop.label for r in result.results], result.results[1].loop.controller_values
    (['iol', 'pid'], {'Kp': 300.0})
    >>> result = ballscrew.swap(["pid"], stop=0.2, sampled=2e-3)
    >>> result.results[0].loop.label, result.results[0].run.sampling_period
    ('pid+sampled', 0.002)
    """
    from .loop_results import Comparison
    from .orchestration.loop.closed_loop import swap as swapped
    from .orchestration.loop.parts import in_practice

    sampled = others.pop("sampled", None)
    sampled = None if sampled is None else check_length("sampled", sampled)
    given = [controllers] if isinstance(controllers, str | Path) else controllers
    asked = {"plant": plant, "reference": reference, "stop": stop, **others}
    loops = [loop_of(c, **asked) for c in given]
    if not loops:
        raise UserError("controllers is empty; expected one or more")
    names = [loop.controller.own_name for loop in loops]
    values_of = _of_each(names, "controller_values", controller_values)
    ports_of = _of_each(names, "mapping", mapping)
    for k, loop in enumerate(loops):
        part, _, notes = in_practice(loop.controller, sampled, noise)
        loops[k] = replace(
            loop,
            controller=part,
            controller_values={**loop.controller_values, **values_of[k]},
            mapping={**loop.mapping, **ports_of[k]},
            notes=(*loop.notes, *notes),
            sampled=sampled or loop.sampled,
        )
    return Comparison.of(swapped(loops, progress))


def lyapunov(
    loop: Loop | PartLike,
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    *,
    tolerance: float = 1e-11,
    budget: float | None = None,
    progress: Callable[[str], None] | None = None,
    **others: Unpack[OfLoop],
) -> Exponents:
    """Lyapunov exponents of a closed loop, and the kind of its long-term motion.

    Tangent vectors follow the variational equations with the exact Jacobian, and are
    orthonormalized as in Benettin et al. (1980). See ``docs/stability.md``.

    Parameters
    ----------
    loop : Loop, or a controller
        With a communication `step`, its FMUs are simulated; else the equations, in one
        solver. The controller ``none`` is for a plant without inputs.
    plant, reference, stop, step, plant_values, controller_values, mapping
        As in `run`, with a constant set-point; the default of `stop` is 300 s here.
    tolerance : float
        Relative tolerance of the solver of the equations; a tenth of it is also tried.
    budget : float, optional
        Processor time for the exponents of equations [s]; when it is used up, the exponents are
        given up to the time reached.
    progress : function of str, optional
        Called with the current step of the work.

    Returns
    -------
    Exponents
        ``exponents`` and ``error``, shape (states,) [nats/s]; ``trusted`` says whether the
        attractor could be classified.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.lyapunov("iol", stop=2.0)
    >>> result.verdict, result.exponents.shape
    ('stuck on a line of equilibria', (4,))
    """
    from .orchestration.loop.loop import Loop
    from .study_results import Exponents

    if stop is None and not isinstance(loop, Loop):
        stop = 300.0
    followed = checked(loop_of(loop, plant=plant, reference=reference, stop=stop, **others))
    tolerance = _check_tolerance(tolerance, 1e-13, 1e-3)
    budget = None if budget is None else check_length("budget", budget)
    if followed.step is not None:
        from .stability.lyapunov_over_fmus import loop_lyapunov_over_fmus

        return Exponents.of(loop_lyapunov_over_fmus(followed, progress))
    from .stability.lyapunov import Watching, loop_lyapunov

    return Exponents.of(loop_lyapunov(followed, tolerance, Watching(progress, budget)))


def stability_map(
    loop: Loop | PartLike,
    x: str,
    y: str,
    folder: Path | str,
    *,
    exponents: bool = False,
    resume: bool = False,
    workers: int = 1,
    tolerance: float | None = None,
    **others: Unpack[OfMap],
) -> StabilityMap:
    """Long-term motion of a closed loop over a grid of two of its parameters.

    Parameters
    ----------
    loop : Loop, or a controller
        Its equations are solved in one solver.
    x, y : str
        Axes, ``NAME=LOW:HIGH:COUNT``, such as ``sigma0_hat=66966:66968:21``.
    folder : path-like
        Folder of the map; with `resume`, an interrupted run continues there.
    plant, reference, stop, plant_values, controller_values
        As in `run`, with a constant set-point; the values are the same in all cells.
    exponents : bool
        Whether the largest Lyapunov exponent of each cell is also computed.
    resume : bool
        Whether to finish the map in the folder.
    workers : int
        Processes.
    tolerance : float, optional
        Relative tolerance of the solver of the equations. Default: 1e-8 with exponents, else 1e-6.

    Examples
    --------
    >>> import ballscrew, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     axes = {"x": "sigma0_hat=66966:66968:2", "y": "sigma1_hat=340:350:2"}
    ...     found = ballscrew.stability_map("iol", **axes, folder=folder, stop=1.0)
    >>> sum(found.summary.verdicts.values())
    4
    """
    from .stability.stability_map import make_map
    from .study_results import StabilityMap

    plan = plan_of(loop_of(loop, **others), x, y, exponents, tolerance)
    found = StabilityMap(make_map(plan, Path(folder), processes(workers), resume), Path(folder))
    found.add_report()
    return found


# -- what is checked here, also for the other functions and the command ----------------------


def check_name(argument: str, name: str, known: Iterable[str]) -> None:
    """Reject a name that is not among the `known` ones."""
    if name not in known:
        raise UserError(
            f"{argument} {name!r} is none of {', '.join(known)}{did_you_mean(name, known)}"
        )


def check_whole_number(argument: str, given: str | int, least: int, most: float = math.inf) -> int:
    """A whole number within limits, also from text."""
    try:
        value = int(given)
    except ValueError:
        value = least - 1
    if not least <= value <= most:
        limits = f"from {least} on" if most == math.inf else f"from {least} to {most}"
        raise UserError(f"{argument} is {given!r}, expected a whole number {limits}")
    return value


def _check_tolerance(given: str | float, finest: float, coarsest: float) -> float:
    value = as_number("tolerance", given)
    if not finest <= value <= coarsest:
        raise UserError(f"tolerance is {given}, expected {finest:g} to {coarsest:g}")
    return value


def checked(loop: Loop | SystemLoop) -> Loop:
    """A loop for exponents or a map, whose values and ports are checked now."""
    from .orchestration.loop.loop import Loop

    if not isinstance(loop, Loop):
        raise UserError(f"{loop.label}: an .ssp can only be run; give a Loop of its two parts")
    if loop.step is None and loop.mapping:
        raise UserError("mapping is for FMUs; give their communication step as well (--via fmu)")
    for part in (loop.plant, loop.controller):
        if loop.step is None and not part.has_equations:
            step = "a communication step (--via fmu)"
            raise UserError(f"{part}: an FMU has no equations; lyapunov runs it with {step}")
    loop.check_values()
    return loop


def plan_of(
    loop: Loop | SystemLoop, x: str, y: str, exponents: bool, tolerance: str | float | None
) -> MapPlan:
    """The plan of a map, checked."""
    from .stability.stability_map import plan_map

    if tolerance is not None:
        tolerance = _check_tolerance(tolerance, 1e-12, 1e-4)
    return plan_map(checked(loop), x, y, exponents, tolerance)


def processes(workers: str | int) -> Processes:
    """Processes of this machine."""
    from .orchestration.study.workers import Processes

    return Processes(check_whole_number("workers", workers, 1, 1000))


def file_of(params: ParameterFile | Path | str | None) -> ParameterFile | None:
    """The parameter file, read if its path is given."""
    from .orchestration.loop.parameter_file import read_parameters

    return read_parameters(params) if isinstance(params, str | Path) else params


def loop_of(loop: Any, **asked: Any) -> Any:
    """The loop of a controller with these arguments of `Loop`, or a given one with those given."""
    from .orchestration.loop.loop import Loop, SystemLoop

    asked = {name: value for name, value in asked.items() if value is not None}
    return replace(loop, **asked) if isinstance(loop, Loop | SystemLoop) else Loop(loop, **asked)


def _of_each(
    names: Sequence[str], argument: str, given: Mapping[str, Mapping[str, Any]] | None
) -> list[Mapping[str, Any]]:
    """The values given for each controller, by its name."""
    for name in given or {}:
        if name not in names:
            raise UserError(f"{argument} has {name!r}, expected one of {', '.join(names)}")
    return [(given or {}).get(name, {}) for name in names]

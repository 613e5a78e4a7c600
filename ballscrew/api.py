"""The public functions: what the commands do, for programs and notebooks.

Values are in SI units throughout. A part is named (see `catalogue`), a function of a Python file
that returns a component (``mine.py:pi``), the path of an FMU, or a `Component` made in the
program.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import sympy as sp

    from .loop_results import Comparison, RunResult
    from .measured_results import DiagnosisResult, IdentifiedLaw, ModelComparison, RigRecord
    from .measurement.records.record import Record
    from .orchestration.loop.loop import Loop, ReferenceLike, SystemLoop
    from .orchestration.loop.parameter_file import ParameterFile
    from .orchestration.loop.parts import PartLike
    from .orchestration.master.couplings import Coupling
    from .orchestration.study.workers import Processes
    from .solver.component import Component, ForceTerm
    from .study_results import Exponents, StabilityMap, SwapStudy, TunedGains

    Values = Mapping[str, float]


_OPTION = re.compile(r"--(map|unit) (?:'([^'=]+)=([^']*)'|([^\s=]+)=([^\s,;:]*))")
_ARGUMENTS = {"map": "mapping", "unit": "units"}


@contextlib.contextmanager
def _arguments_named() -> Iterator[None]:
    """Errors of records and parameter files name arguments, not the options of the command."""

    def given(found: re.Match[str]) -> str:
        key, value = found[2] or found[4], found[3] or found[5] or "..."
        return f'{_ARGUMENTS[found[1]]}={{"{key}": "{value}"}}'

    try:
        yield
    except ValueError as error:
        said = _OPTION.sub(given, str(error)).replace("--lead METRES", "lead=METRES")
        error.args = (re.sub(r"--([a-z]+)", lambda m: _ARGUMENTS.get(m[1], m[1]), said),)
        raise


def catalogue() -> dict[str, tuple[str, ...]]:
    """Names of the available parts.

    Returns
    -------
    dict of str to tuple of str
        ``plants``, ``controllers``, ``instruments`` and ``laws`` (of friction).

    Examples
    --------
    >>> import ballscrew
    >>> "nctf" in ballscrew.catalogue()["controllers"]
    True
    """
    from .controllers import CONTROLLERS
    from .plant import LAWS, PLANTS
    from .plant.instruments import INSTRUMENTS

    named = {"plants": PLANTS, "controllers": CONTROLLERS, "instruments": INSTRUMENTS, "laws": LAWS}
    return {kind: (*names,) for kind, names in named.items()}


def component(name: str) -> Component:
    """Return a component of the catalogue or of a Python file, with its equations.

    Parameters
    ----------
    name : str
        A plant, a controller or an instrument of `catalogue`, or ``path/to/file.py:function``. The
        file is run as it is now, and the function is called without arguments. A controller that
        measures through instruments is ``controller+instrument+...``.

    Returns
    -------
    Component

    Raises
    ------
    KeyError
        If there is no part of this name; the message lists the available ones.
    ValueError
        If the file does not return a component; the message says why, and in which line.

    Examples
    --------
    >>> import ballscrew
    >>> [s.name for s in ballscrew.component("plant").all_states]
    ['x', 'v', 'i', 'z']
    """
    from .orchestration.loop.catalogue import component as made

    return made(_as_it_is_now(name))


def with_friction(
    body: Component,
    law: str | ForceTerm,
    values: Values | None = None,
    velocity: str = "v",
    position: str = "x",
    breakaway: sp.Expr | None = None,
) -> Component:
    """A body with a friction law in its force balance.

    Parameters
    ----------
    body : Component
        Has a `ForceBalance` of `velocity`, and no modes.
    law : str or ForceTerm
        A law of `catalogue`, or your own dry friction: a term called ``friction``
        that opposes sliding by ``sign(v)``. With ``classical`` and with your own term, sticking
        and sliding are modes.
    values : mapping of str to float, optional
        Default values of the law's parameters, in SI units.
    velocity : str
        The state that is the sliding velocity of the body [m/s]. If its unit
        is rad/s, a law of the catalogue is in N*m and rad.
    position : str
        The position state; while the body sticks, its derivative is the one at zero `velocity`.
    breakaway : expression, optional
        Force up to which the body sticks [N]; default: the sliding friction at zero velocity.

    Returns
    -------
    Component
        Its output ``friction`` [N] opposes motion.

    Raises
    ------
    KeyError
        If there is no such law; the message lists the available ones.
    ContractError
        If the body has no such balance, the law has no such parameter, or the term has no sign.
    ValueError
        If `breakaway` is given with a law that has no modes.

    Examples
    --------
    >>> from ballscrew import Component, ForceBalance, ForceTerm, State, symbol, with_friction
    >>> x, v = symbol("x"), symbol("v")
    >>> spring = ForceTerm("spring", -100 * x, "a spring of 100 N/m")
    >>> states = State("x", "m", "position", v, start=0.1), State("v", "m/s", "velocity")
    >>> balance = ForceBalance("v", 1, (spring,))
    >>> body = Component("body", "A mass", states=states, balances=(balance,))
    >>> [mode.name for mode in with_friction(body, "classical", {"Fc": 2.0}).modes]
    ['stuck', 'forward', 'backward']
    """
    from .plant.with_friction import with_friction as made

    return made(body, law, values, velocity, position, breakaway)


def export(
    part: PartLike,
    path: Path | str,
    native: bool = False,
    fmi: int = 2,
    platforms: Sequence[str] | None = None,
    plant: PartLike | None = None,
    tangents: int = 0,
    params: ParameterFile | None = None,
) -> Path:
    """Write a part, or the closed loop of a controller, as an FMU or a system of FMUs.

    Parameters
    ----------
    part : str or Component
        A name, a file's function (``mine.py:pi``), or a component.
    path : path-like
        The file to write; replaced as a whole or not at all. A name that ends in ``.ssp`` gives
        a system: the controller `part` and its plant, connected; ``.mo`` gives Modelica source.
    native : bool
        Whether it contains compiled C, and needs no Python on the host; else it contains readable
        Python.
    fmi : {2, 3}
        Version of the standard; 3 needs `native`.
    platforms : sequence of str, optional
        With `native`: such as ``linux64``, ``win64``, ``darwin64``; default: this machine's
        platform.
    plant : str or Component, optional
        For an FMU: the FMU contains the whole closed loop of this plant and the controller `part`.
        For a system: the plant to use instead of the one in `params` or the default one.
    tangents : int
        How many tangent vectors the FMU carries, for exponents over FMUs.
    params : ParameterFile, optional
        Its values become the start values.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    KeyError
        If there is no part of this name.
    ValueError
        If the part cannot be exported in this way; the message says why.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import ballscrew, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ballscrew.export("pid", Path(folder) / "pid.fmu").name
    'pid.fmu'
    """

    from .exporting import SYSTEM, Export
    from .options import read_whole_number
    from .orchestration.loop.loop import plant_of
    from .orchestration.loop.parts import resolve, resolve_plant
    from .solver.files import temporary_folder

    path = Path(path)
    if fmi not in (2, 3):
        raise ValueError(f"fmi is {fmi!r}, expected 2 or 3")
    if not native and (fmi != 2 or platforms is not None):
        raise ValueError(f"fmi = {fmi}, platforms = {platforms}: these are for native=True")
    if tangents and (plant is not None or path.suffix == SYSTEM):
        raise ValueError(f"tangents = {tangents}: these apply to a single part, not to a loop")
    name = _as_it_is_now(part) if isinstance(part, str) else resolve("part", part).name
    around = None if plant is None else resolve_plant(plant, fmus=False).name
    if path.suffix == SYSTEM:
        around = plant_of(params, around)
    how = Export(
        around or "", read_whole_number("tangents", tangents, 0, 12), params, native, fmi, platforms
    )
    with temporary_folder("export") as folder:
        how.write(name, path, Path(folder))
    return path


def run(  # noqa: PLR0913
    loop: Loop | SystemLoop | PartLike,
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    step: float | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    coupling: str | Coupling | None = None,
    mapping: Mapping[str, str] | None = None,
    sampled: float | None = None,
    progress: Callable[[float], None] | None = None,
    params: ParameterFile | Path | str | None = None,
) -> RunResult:
    """Run a closed loop of FMUs, with a verdict on the coupling.

    Parameters
    ----------
    loop : Loop, SystemLoop, or a controller
        ``run("iol", stop=2.0)`` is ``run(Loop("iol", stop=2.0))``.
    plant, reference, stop, step, plant_values, controller_values, coupling, mapping, sampled
        As in `Loop`, with its defaults; if `loop` is a `Loop`, the values to change in it.
    progress : function of float, optional
        Called with the time that the run has reached [s].
    params : ParameterFile or path-like, optional
        Values of plant and controller, and the plant if it is not given; other arguments have
        priority.

    Returns
    -------
    RunResult
        ``trusted`` says whether the coupling moved no output by more than 1 % of its range.

    Raises
    ------
    ValueError
        If a part, a parameter or the coupling is invalid; the message says why.
    RuntimeError
        If an FMU rejects its initial values.

    Notes
    -----
    The equations are in chapters 2 and 3 of the thesis; for the coupling
    see ``docs/coupling.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.run("iol", stop=0.5)
    >>> result.trusted
    True
    >>> round(float(abs(result.run.commands["u"]).max()), 1)
    32.1
    """
    from .loop_results import RunResult
    from .orchestration.loop.closed_loop import run_closed_loop
    from .orchestration.loop.loop import Loop, with_file

    found = _loop(
        loop,
        plant=plant,
        reference=reference,
        stop=stop,
        step=step,
        plant_values=plant_values,
        controller_values=controller_values,
        coupling=coupling,
        mapping=mapping,
        sampled=sampled,
    )
    told = _told(params)
    if told is not None:
        if not isinstance(found, Loop):
            raise ValueError("params is for a loop of two parts; an .ssp contains its values")
        found = with_file(found, told, chosen=plant is not None or found is loop)
    return RunResult.of(run_closed_loop(found, progress))


def swap(  # noqa: PLR0913
    controllers: Sequence[Loop | PartLike],
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    step: float | None = None,
    plant_values: Values | None = None,
    sampled: float | None = None,
    noise: bool = False,
    controller_values: Mapping[str, Values] | None = None,
    mapping: Mapping[str, Mapping[str, str]] | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Comparison:
    """Run several controllers on the same plant, and compare them.

    Parameters
    ----------
    controllers : sequence of controllers, or of Loop
    plant, reference, stop, step, plant_values
        As in `run`.
    sampled : float, optional
        Sampling period of all controllers [s]; if left out, the controllers are not changed.
    noise : bool
        Whether all controllers measure through the instruments of `catalogue` that fit them.
    controller_values : mapping of str to mapping of str to float, optional
        Parameters with other than nominal values, in SI units, for each controller by its name;
        ``hand`` is the name of ``hand.fmu``.
    mapping : mapping of str to mapping of str to str, optional
        Names of ports, ``theirs -> ours``, for each controller by its name.
    progress : function of str and float, optional
        Called with the controller's name and the time that its run has reached [s].

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError, RuntimeError
        As `run`.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.swap(["iol", "pid"], stop=0.2)
    >>> [r.loop.label for r in result.results]
    ['iol', 'pid']
    >>> result = ballscrew.swap(["pid"], stop=0.2, sampled=2e-3)
    >>> result.results[0].loop.label, result.results[0].run.sampling_period
    ('pid+sampled', 0.002)
    >>> result = ballscrew.swap(["iol", "pid"], stop=0.2, controller_values={"pid": {"Kp": 300.0}})
    >>> result.results[1].loop.controller_values
    {'Kp': 300.0}
    """
    from .loop_results import Comparison
    from .orchestration.loop.closed_loop import swap as swapped
    from .orchestration.loop.parts import in_practice

    if sampled is not None and not sampled > 0:
        raise ValueError(f"sampled is {sampled:g} s, expected more than 0")
    if isinstance(controllers, str | Path):
        controllers = [controllers]
    same = {"plant": plant, "reference": reference, "stop": stop, "step": step}
    loops = [_loop(c, **same, plant_values=plant_values) for c in controllers]
    if not loops:
        raise ValueError("controllers is empty; expected one or more")
    names = [loop.controller.own_name for loop in loops]
    values_of = _of_each(names, "controller_values", controller_values)
    ports_of = _of_each(names, "mapping", mapping)
    for k, loop in enumerate(loops):
        part, _, notes = in_practice(loop.controller, sampled, noise)
        values = {**loop.controller_values, **values_of[k]}
        loops[k] = replace(
            loop,
            controller=part,
            controller_values=values,
            mapping={**loop.mapping, **ports_of[k]},
            notes=(*loop.notes, *notes),
            sampled=sampled or loop.sampled,
        )
    return Comparison.of(swapped(loops, progress))


def lyapunov(  # noqa: PLR0913
    loop: Loop | PartLike,
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    step: float | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    mapping: Mapping[str, str] | None = None,
    tolerance: float = 1e-11,
    budget: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Exponents:
    """Lyapunov exponents of a closed loop, and the kind of its long-term motion.

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

    Raises
    ------
    ValueError
        If a part or a parameter is invalid, or exponents of this loop cannot be computed.

    Notes
    -----
    Tangent vectors follow the variational equations with the exact Jacobian, and are
    orthonormalized as in Benettin et al. (1980). See ``docs/stability.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.lyapunov("iol", stop=2.0)
    >>> result.motion.kind.value
    'stuck on a line of equilibria'
    >>> result.exponents.shape
    (4,)
    """
    from .orchestration.loop.loop import Loop
    from .study_results import Exponents

    if stop is None and not isinstance(loop, Loop):
        stop = 300.0
    followed = _followed_loop(
        loop,
        plant=plant,
        reference=reference,
        stop=stop,
        step=step,
        plant_values=plant_values,
        controller_values=controller_values,
        mapping=mapping,
    )
    if followed.step is not None:
        from .stability.lyapunov_over_fmus import loop_lyapunov_over_fmus

        return Exponents.of(loop_lyapunov_over_fmus(followed, progress))
    from .stability.lyapunov import Watching, loop_lyapunov

    return Exponents.of(loop_lyapunov(followed, tolerance, Watching(progress, budget)))


def stability_map(  # noqa: PLR0913
    loop: Loop | PartLike,
    x: str,
    y: str,
    folder: Path | str,
    plant: PartLike | None = None,
    reference: ReferenceLike | None = None,
    stop: float | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    exponents: bool = False,
    resume: bool = False,
    workers: int = 1,
    tolerance: float | None = None,
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

    Returns
    -------
    StabilityMap

    Raises
    ------
    ValueError
        If an axis or a parameter is invalid, or the folder contains another map.
    OSError
        If the results cannot be written.

    Examples
    --------
    >>> import ballscrew, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     axes = {"x": "sigma0_hat=66966:66968:2", "y": "sigma1_hat=340:350:2"}
    ...     found = ballscrew.stability_map("iol", **axes, folder=folder, stop=1.0)
    >>> sum(found.summary.verdicts.values())
    4
    """
    from .stability.stability_map import make_map, plan_map
    from .study_results import StabilityMap

    processes = _processes(workers)
    followed = _followed_loop(
        loop,
        plant=plant,
        reference=reference,
        stop=stop,
        plant_values=plant_values,
        controller_values=controller_values,
    )
    plan = plan_map(followed, x, y, exponents, tolerance)
    summary = make_map(plan, Path(folder), processes, resume)
    found = StabilityMap(summary, Path(folder))
    found.add_report()
    return found


def swap_study(
    study: Path | str, folder: Path | str, resume: bool = False, workers: int = 1
) -> SwapStudy:
    """Tune several controllers in the same way, and compare them on other duties.

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

    Raises
    ------
    ValueError
        If the study is invalid, or the folder contains another one.
    OSError
        If the results cannot be written.

    Notes
    -----
    Controllers are compared by the ratio of their rms errors, with intervals after Welch (1947).

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
        _as_it_is_now(part)
    result = SwapStudy.of(do_study(plan, Path(folder), _processes(workers), resume))
    discard_parts(Path(folder))
    return result


def tune(  # noqa: PLR0913
    loop: Loop | PartLike,
    plant: PartLike | None = None,
    reference: str | None = None,
    stop: float | None = None,
    limit: float | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    budget: int = 100,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> TunedGains:
    """Find the gains of one controller for one machine, and test them on another motion.

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

    Raises
    ------
    ValueError
        If the controller has no ranges for its gains, the machine has no limit, or a value is
        invalid.

    Notes
    -----
    The search is CMA-ES (N. Hansen, "The CMA evolution strategy", 2006), as in studies. See
    ``docs/howto/tune.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.tune("pid", "drive_lugre", limit=20.0, budget=4)
    >>> sorted(result.values)
    ['Kd', 'Ki', 'Kp']
    >>> [m.state for m in result.margins]
    ['stuck', 'sliding']
    """
    from .options import read_whole_number
    from .orchestration.fmu.limits import check_length
    from .orchestration.study.tune import tune_loop
    from .study_results import TunedGains

    length = None if stop is None else check_length("stop", stop)
    count = read_whole_number("budget", budget, 2)
    found = tune_loop(
        _loop(loop, plant=plant, plant_values=plant_values, controller_values=controller_values),
        reference,
        length,
        limit,
        count,
        read_whole_number("seed", seed, 0),
        progress,
    )
    return TunedGains.of(found)


def run_trial(
    trial: str,
    law: str | None = None,
    seed: int = 0,
    values: Values | None = None,
    params: Path | str | None = None,
) -> RigRecord:
    """Run a trial on the virtual test rig, and record it with its instruments.

    Parameters
    ----------
    trial : str
        A trial's name, such as ``2.4/7``: Table 2.4, number 7.
    law : str
        Friction law between block and table; default that of `params`, or ``modified_lugre``.
    seed : int
        Seed of all noise.
    values : mapping of str to float, optional
        Parameters with other than nominal values, such as ``plant.sigma0``, ``encoder.counts`` or
        ``trial.speed``.
    params : path-like, optional
        Parameter file of the machine; the trials are scaled to its size. Without it, the
        axis of the thesis.

    Returns
    -------
    RigRecord
        ``record`` has the measured signals, ``truth`` the true ones, arrays of shape (samples,).

    Raises
    ------
    ValueError
        If there is no such trial, law or parameter, or the trial does not apply to the machine.

    Examples
    --------
    >>> import ballscrew
    >>> record = ballscrew.run_trial("2.8/1", law="lugre")
    >>> sorted(record.record)[:3]
    ['force', 'force_filtered', 'force_ref']
    """
    from .measured_results import RigRecord
    from .measurement.rig.bench import run_trial as recorded
    from .plant import DEFAULT_LAW

    told = None if params is None else read_parameters(params)
    law = law or (told and told.law) or DEFAULT_LAW
    return RigRecord.of(recorded(trial, law, values, seed, told=told))


@_arguments_named()
def read_force_records(
    paths: Sequence[Path | str],
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    mass: float | None = None,
    lead: float | None = None,
) -> list[Record]:
    """Read records of force and position, for `identify`.

    Parameters
    ----------
    paths : sequence of path-like
        Files of measured data in any known format, or folders written by the rig.
    mapping : mapping of str to str, optional
        Names of columns, from the name in the file to ``time``, ``x`` or ``force``.
    units : mapping of str to str, optional
        Unit of each of these columns; default: the unit in the file, else SI.
    mass : float, optional
        Mass between load cell and friction [kg].
    lead : float, optional
        Lead of the screw: travel per turn [m], for angles and torques.

    Returns
    -------
    list of Record

    Raises
    ------
    BadRecord
        In one line: what cannot be used and why.
    """
    from .measurement.records.reading import read_force_records as read

    return read(_paths(paths), mapping, units, mass, lead)


@_arguments_named()
def read_drive_records(
    paths: Sequence[Path | str],
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> list[Record]:
    """Read records of a drive's command and position, for `diagnose`.

    Parameters
    ----------
    paths : sequence of path-like
        Files of measured data in any known format.
    mapping, units, lead
        As in `read_force_records`; columns are ``time``, ``u``, ``x`` and, optionally, ``i``.

    Returns
    -------
    list of Record

    Raises
    ------
    BadRecord
        In one line: what cannot be used and why.
    """
    from .measurement.records.reading import read_drive_records as read

    return read(_paths(paths), mapping, units, lead)


def read_parameters(path: Path | str) -> ParameterFile:
    """Read a parameter file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    ParameterFile
        Values with units, intervals and sources; see ``docs/parameters.md``.

    Raises
    ------
    BadParameters
        In one line: what is wrong in the file, and where.
    """
    from .orchestration.loop.parameter_file import read_parameters as read

    return read(path)


@_arguments_named()
def identify(  # noqa: PLR0913
    records: Path | str | Sequence[Record | Path | str],
    law: str,
    fixed: Values | None = None,
    offset: bool = False,
    params: ParameterFile | Path | str | None = None,
    mass: float | bool = False,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> IdentifiedLaw:
    """Find the parameters of a friction law in records of force and position.

    Parameters
    ----------
    records : path-like, or sequence of Record or path-like
        Result of `read_force_records`; or paths of files with the columns ``time``, ``x`` and
        ``force`` in SI units or in units stated in the file.
    law : str
        A law of `catalogue`.
    fixed : mapping of str to float, optional
        Parameters that are known, in SI units.
    offset : bool
        Whether a constant force is also fitted.
    params : ParameterFile or path-like, optional
        Known values; the written file keeps the values that the records do not identify.
    mass : float or bool
        Mass between load cell and friction [kg], for files; True: it is also fitted. Default: `m`
        of `params`, else as in `read_force_records`.
    mapping, units, lead
        As in `read_force_records`.

    Returns
    -------
    IdentifiedLaw
        ``parameters`` have 95 % intervals; for each parameter that is not identified, the reason
        and a remedy are given.

    Raises
    ------
    ValueError
        If there is no such law, a parameter cannot be fixed at the given value, or a file cannot be
        used (BadRecord, BadParameters).

    Notes
    -----
    Maximum likelihood by Fisher scoring, with errors from pieces of the records.
    """
    from .measured_results import IdentifiedLaw
    from .measurement.identification.identify import identify_files
    from .options import check_name
    from .plant import LAWS

    check_name("law", law, LAWS)
    columns, how = (mapping, units, lead), (law, fixed, offset, _told(params), mass)
    return IdentifiedLaw.of(identify_files(_paths(records), *how, *columns))


@_arguments_named()
def diagnose(
    data: Path | str | Sequence[Path | str],
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
    take: str | None = None,
) -> DiagnosisResult:
    """Find the errors of a simulation of recorded runs, their causes, and the possible improvement.

    Parameters
    ----------
    data : path-like or sequence of path-like
        Files of measured data with ``time`` [s], ``u`` [V], ``x`` [m] and, optionally, ``i`` [A].
    params : path-like, optional
        Parameter file of the model to be tested; default: the nominal axis.
    law : str, optional
        Friction law, instead of the law in the file.
    mapping, units, lead
        As in `read_drive_records`.
    take : str, optional
        A cause to include in the model, one of several suspects; its gain is measured.

    Returns
    -------
    DiagnosisResult
        ``causes`` improve the model on data not used to select or fit them; ``verdict``
        may be that no cause can be named; ``suspects`` is the smallest set that contains the true
        cause in 95 of 100 records like those of the calibration.

    Raises
    ------
    BadRecord, BadParameters
        In one line: what cannot be used and why.
    """
    from .measured_results import DiagnosisResult
    from .measurement.diagnosis.diagnose import diagnose as diagnosed
    from .options import check_name
    from .plant import LAWS

    if law is not None:
        check_name("law", law, LAWS)
    if take is not None:
        from .measurement.diagnosis.causes import CAUSES

        check_name("take", take, CAUSES)
    return DiagnosisResult.of(
        diagnosed(_paths(data), params, law, mapping, units=units, lead=lead, take=take)
    )


@_arguments_named()
def compare(
    data: Path | str | Sequence[Path | str],
    params: Path | str,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> ModelComparison:
    """How well the model of a parameter file predicts records; nothing is fitted to them.

    Parameters
    ----------
    data : path-like or sequence of path-like
        As in `diagnose`.
    params : path-like
        Parameter file of any command, or your own. A file of `diagnose` has three models:
        the prior one, the one with adjusted values, and the corrected one.
    mapping, units, lead
        As in `read_drive_records`.

    Returns
    -------
    ModelComparison
        ``models`` has the rms residuals of each model, by part of the motion: of the
        force [N], and of the position predicted from the start of each second [m].

    Raises
    ------
    BadRecord, BadParameters
        In one line: what cannot be used and why.
    """
    from .measured_results import ModelComparison
    from .measurement.diagnosis.compare import compare as compared

    return ModelComparison.of(compared(_paths(data), params, mapping, units, lead))


def _loop(loop: Any, **asked: Any) -> Any:
    """A loop with these values, or a given loop with those changed that are not None."""
    from .orchestration.loop.loop import Loop, SystemLoop

    given = {name: value for name, value in asked.items() if value is not None}
    return replace(loop, **given) if isinstance(loop, Loop | SystemLoop) else Loop(loop, **given)


def _followed_loop(loop: Any, **asked: Any) -> Loop:
    """A loop with a constant set-point, whose values and ports are checked now."""
    from .orchestration.loop.loop import Loop

    found = _loop(loop, **asked)
    if not isinstance(found, Loop):
        raise ValueError(f"{found.label}: an .ssp can only be run; give a Loop of its two parts")
    if found.step is None:
        if found.mapping:
            raise ValueError("mapping is for FMUs; give their communication step as well")
        for part in (found.plant, found.controller):
            if not part.has_equations:
                raise ValueError(f"{part}: an FMU has no equations; give a communication step")
    found.check_values()
    return found


def _processes(workers: int) -> Processes:
    from .options import read_whole_number
    from .orchestration.study.workers import Processes
    from .worker_options import MOST_WORKERS

    return Processes(read_whole_number("workers", workers, 1, MOST_WORKERS))


def _of_each(
    names: Sequence[str], argument: str, given: Mapping[str, Mapping[str, Any]] | None
) -> list[Mapping[str, Any]]:
    """The values given for each controller, by its name."""
    for name in given or {}:
        if name not in names:
            raise ValueError(f"{argument} has {name!r}, expected one of {', '.join(names)}")
    return [(given or {}).get(name, {}) for name in names]


def _told(params: ParameterFile | Path | str | None) -> ParameterFile | None:
    return read_parameters(params) if isinstance(params, str | Path) else params


def _paths(given: Any) -> Any:
    """A sequence of files, also if a single file is given."""
    return [given] if isinstance(given, str | Path) else given


def _as_it_is_now(part: str) -> str:
    """The same part; a Python file is read again."""
    from .plant.instruments import PartName
    from .solver.component_file import names_file, read_component

    if names_file(name := PartName.of(part).bare):
        read_component(name)
    return part

"""The public functions: what the commands do, for programs and notebooks.

Values are in SI units throughout. A part is named (see `catalogue`), a function of a Python file
that returns a component (``mine.py:pi``), a path of an FMU, or a `Component` that was made a minute
ago.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import sympy as sp

    from .orchestration.couplings import Coupling
    from .orchestration.parameter_file import ParameterFile
    from .orchestration.reference_signal import Reference
    from .orchestration.workers import Processes
    from .records.drive_record import DriveRecord
    from .records.force_record import Record
    from .results.comparison import Comparison
    from .results.diagnosis_result import DiagnosisResult
    from .results.exponents import Exponents
    from .results.identified_law import IdentifiedLaw
    from .results.map_result import StabilityMap
    from .results.rig_record import RigRecord
    from .results.run_result import RunResult
    from .results.swap_study import SwapStudy
    from .solver.component import Component, ForceTerm

    Part = str | Path | Component
    Values = Mapping[str, float]


def catalogue() -> dict[str, tuple[str, ...]]:
    """Names of the parts that are there.

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
    from .instruments import INSTRUMENTS
    from .plant import LAWS, PLANTS

    named = {"plants": PLANTS, "controllers": CONTROLLERS, "instruments": INSTRUMENTS, "laws": LAWS}
    return {kind: (*names,) for kind, names in named.items()}


def component(name: str) -> Component:
    """The component of a name in the catalogue or of a Python file, with its equations.

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
        If there is none of this name; the message lists those that there are.
    ValueError
        If the file gives no component; the message says why, and in which line.

    Examples
    --------
    >>> import ballscrew
    >>> [s.name for s in ballscrew.component("plant").all_states]
    ['x', 'v', 'i', 'z']
    """
    from .fmus.catalogue import component as made

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
        A law of `catalogue`, with ``classical`` the body sticks and slides as modes; or dry
        friction of your own, a term called ``friction`` that opposes sliding by ``sign(v)``, with
        which it does so, too.
    values : mapping of str to float, optional
        Default values of the law's parameters, in SI units.
    velocity : str
        The state that is the speed of sliding: of the body on what it slides on [m/s]. Where its
        unit is rad/s, a law of the catalogue is in N*m and rad.
    position : str
        The state that goes on as it does at no `velocity` where the body sticks.
    breakaway : expression, optional
        Force up to which the body sticks [N]; by default that of sliding at no speed.

    Returns
    -------
    Component
        Its output ``friction`` [N] opposes motion.

    Raises
    ------
    KeyError
        If there is no such law; the message lists those that there are.
    ContractError
        If the body has no such balance, the law no such parameter, or the term no sign.
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
    part: str | Component,
    path: Path | str,
    native: bool = False,
    fmi: int = 2,
    platforms: Sequence[str] | None = None,
) -> Path:
    """Write a part as an FMU for co-simulation.

    Parameters
    ----------
    part : str or Component
        A name, a file's function (``mine.py:pi``), or a component.
    path : path-like
        The FMU to write; replaced as a whole or not at all.
    native : bool
        Whether it holds compiled C, and needs no Python on the host; else it holds readable Python.
    fmi : {2, 3}
        Version of the standard; 3 needs `native`.
    platforms : sequence of str, optional
        With `native`: such as ``linux64``, ``win64``, ``darwin64``; default this machine's.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    KeyError
        If there is no part of this name.
    ValueError
        If the part cannot be exported so; the message says why.
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
    from .fmus import export as readable
    from .fmus.native.export import export_native

    made = component(part) if isinstance(part, str) else part
    if native:
        return export_native(made, path, fmi=fmi, platforms=platforms).path
    if fmi != 2 or platforms is not None:
        raise ValueError(f"fmi = {fmi}, platforms = {platforms}: these are for native=True")
    return readable.export(made, path)


def run(  # noqa: PLR0913
    controller: Part,
    plant: Part = "plant",
    reference: float | str | Reference = 0.08,
    stop: float = 20.0,
    step: float | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    coupling: str | Coupling | None = None,
    mapping: Mapping[str, str] | None = None,
) -> RunResult:
    """Run a closed loop of two FMUs, with a verdict on the coupling.

    Parameters
    ----------
    controller, plant : str, path-like or Component
        A name, a file's function (``mine.py:pi``), the path of an FMU, or a component.
    reference : float, str or Reference
        Set-point [m], or set-point over time: a motion in words, as
        ``"move:distance=0.02,speed=0.1"``, the path of a table, or a `Reference`.
    stop : float
        Length of the run [s].
    step : float, optional
        Communication step [s]; left out, it is halved until the run is trusted.
    plant_values, controller_values : mapping of str to float, optional
        Parameters that are not nominal, in SI units.
    coupling : str or Coupling, optional
        How the two are coupled, as ``"gauss-seidel"``; by default the interface-Jacobian coupling
        where the parts have its ports, else the best that they can do.
    mapping : mapping of str to str, optional
        Names of ports, ``theirs -> ours``.

    Returns
    -------
    RunResult
        ``trusted`` says whether the coupling moved no output by more than 1 % of its range.

    Raises
    ------
    KeyError, ValueError
        If a part, a parameter or the coupling makes no sense; the message says why.
    RuntimeError
        If an FMU refuses its initial values.

    Notes
    -----
    The equations are those of the thesis, chapters 2 and 3; on the coupling see
    ``docs/coupling.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.run("iol", stop=0.5)
    >>> result.trusted
    True
    >>> round(float(abs(result.run.commands["u"]).max()), 1)
    32.1
    """
    from .loop_options import read_coupling
    from .orchestration.closed_loop import Study, run_study
    from .orchestration.couplings import Coupling
    from .results.run_result import RunResult

    if coupling is not None and not isinstance(coupling, Coupling):
        coupling = read_coupling("coupling", coupling)
    study = Study(
        _controller(controller),
        _plant(plant),
        _over_time(reference),
        *_lengths(stop, step),
        coupling,
        plant_values=_numbers("plant_values", plant_values),
        controller_values=_numbers("controller_values", controller_values),
        mapping=mapping,
    )
    return RunResult.of(run_study(study))


def swap(  # noqa: PLR0913
    controllers: Sequence[Part],
    plant: Part = "plant",
    reference: float | str | Reference = 0.08,
    stop: float = 20.0,
    step: float | None = None,
    plant_values: Values | None = None,
    sampled: float | None = None,
    noise: bool = False,
    controller_values: Mapping[str, Values] | None = None,
    mapping: Mapping[str, Mapping[str, str]] | None = None,
) -> Comparison:
    """Run several controllers on the same plant, and compare them.

    Parameters
    ----------
    controllers : sequence of str, path-like or Component
    plant, reference, stop, step, plant_values
        As in `run`.
    sampled : float, optional
        Sampling period of all controllers [s]; left out, each is as it is.
    noise : bool
        Whether all measure through the instruments of `catalogue` that fit them.
    controller_values : mapping of str to mapping of str to float, optional
        Parameters that are not nominal, in SI units, for each controller by its name; ``hand`` is
        the name of ``hand.fmu``.
    mapping : mapping of str to mapping of str to str, optional
        Names of ports, ``theirs -> ours``, for each controller by its name.

    Returns
    -------
    Comparison

    Raises
    ------
    KeyError, ValueError, RuntimeError
        As `run`.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.swap(["iol", "pid"], stop=0.2)
    >>> [r.study.label for r in result.results]
    ['iol', 'pid']
    >>> result = ballscrew.swap(["pid"], stop=0.2, sampled=2e-3)
    >>> result.results[0].study.label, result.results[0].run.sampling_period
    ('pid+sampled', 0.002)
    >>> result = ballscrew.swap(["iol", "pid"], stop=0.2, controller_values={"pid": {"Kp": 300.0}})
    >>> result.results[1].study.controller_values
    {'Kp': 300.0}
    """
    from .orchestration.closed_loop import Study
    from .orchestration.swap import swap as swapped
    from .results.comparison import Comparison

    if sampled is not None and not sampled > 0:
        raise ValueError(f"sampled is {sampled:g} s, expected more than 0")
    on, goal = _plant(plant), _over_time(reference)
    given = [_controller(c) for c in _paths(controllers)]
    if not given:
        raise ValueError("controllers is empty, expected one or more")
    values_of = [
        _numbers("controller_values", own)
        for own in _of_each(given, "controller_values", controller_values)
    ]
    values_on = _numbers("plant_values", plant_values)
    ports_of = _of_each(given, "mapping", mapping)
    studies = []
    for name, own, ports in zip(given, values_of, ports_of, strict=True):
        named, values, notes = _in_practice(name, sampled, noise)
        study = Study(named, on, goal, *_lengths(stop, step), plant_values=values_on)
        studies.append(
            replace(study, controller_values={**own, **values}, mapping=ports, notes=notes)
        )
    return Comparison.of(swapped(studies))


def lyapunov(
    controller: Part,
    plant: Part = "plant",
    stop: float = 300.0,
    setpoint: float = 0.08,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
    step: float | None = None,
    mapping: Mapping[str, str] | None = None,
) -> Exponents:
    """Lyapunov exponents of a closed loop, and what its motion becomes.

    Parameters
    ----------
    controller, plant : str, path-like or Component
        A name, a file's function (``mine.py:pi``), or a component; with `step` also the path of an
        FMU. The controller ``none`` leaves a plant without inputs alone.
    stop : float
        Length of the motion [s].
    setpoint : float
        Constant set-point [m].
    plant_values, controller_values : mapping of str to float, optional
        Parameters that are not nominal, in SI units.
    step : float, optional
        Communication step of the FMUs of both parts and their master [s]; left out, the equations
        are followed in one solver.
    mapping : mapping of str to str, optional
        With `step`: names of ports of a third-party FMU, ``theirs -> ours``.

    Returns
    -------
    Exponents
        ``exponents`` and ``error``, shape (states,) [nats/s]; ``trusted`` says whether the
        attractor could be classified.

    Raises
    ------
    KeyError, ValueError
        If a part or a parameter makes no sense, or the loop has no exponents here (sampled ones).

    Notes
    -----
    Tangents are followed by the variational equations with the exact Jacobian, and orthonormalized
    as Benettin et al. (1980) do. See ``docs/stability.md``.

    Examples
    --------
    >>> import ballscrew
    >>> result = ballscrew.lyapunov("iol", stop=2.0)
    >>> result.motion.kind.value
    'stuck on a line of equilibria'
    >>> result.exponents.shape
    (4,)
    """
    from .options import read_number
    from .results.exponents import Exponents

    over_fmus = step is not None
    law, on = _controller(controller, over_fmus), _plant(plant, over_fmus)
    stop, step = _lengths(stop, step)
    setpoint = read_number("setpoint", setpoint)
    values = _values("plant", on, plant_values), _values("controller", law, controller_values)
    if step is None:
        from .stability.loop_lyapunov import loop_lyapunov

        if mapping:
            raise ValueError("mapping is for FMUs; give their communication step, too")
        return Exponents.of(loop_lyapunov(law, stop, setpoint, on, *values))
    from .stability.fmu_parts import FmuLoop
    from .stability.lyapunov_over_fmus import loop_lyapunov_over_fmus

    loop = FmuLoop(law, on, setpoint, *values, mapping=dict(mapping or {}))
    return Exponents.of(loop_lyapunov_over_fmus(loop, stop, step))


def stability_map(  # noqa: PLR0913
    controller: Part,
    x: str,
    y: str,
    folder: Path | str,
    plant: Part = "plant",
    stop: float = 20.0,
    setpoint: float = 0.08,
    exponents: bool = False,
    refine: bool = False,
    resume: bool = False,
    workers: int = 1,
    step: float | None = None,
    mapping: Mapping[str, str] | None = None,
    plant_values: Values | None = None,
    controller_values: Values | None = None,
) -> StabilityMap:
    """What becomes of a closed loop over a grid of two of its parameters.

    Parameters
    ----------
    controller, plant : str, path-like or Component
        Names of the catalogue, files' functions (``mine.py:pi``), or components; with `step` also
        paths of FMUs. The controller ``none`` leaves a plant without inputs alone.
    x, y : str
        Axes, ``NAME=LOW:HIGH:COUNT``, such as ``sigma0_hat=66966:66968:21``.
    folder : path-like
        Where the map is kept; a run that was killed goes on there with `resume`.
    stop, setpoint : float
        Length of each run [s]; constant set-point [m].
    exponents : bool
        Whether each cell has its largest Lyapunov exponent, too.
    refine : bool
        Whether the borders between verdicts are found within each pair of cells.
    resume : bool
        Whether to finish the map that the folder holds.
    workers : int
        Processes.
    step : float, optional
        Communication step of the FMUs of both parts and their master [s]; left out, the equations
        are followed in one solver.
    mapping : mapping of str to str, optional
        With `step`: names of ports of a third-party FMU, ``theirs -> ours``.
    plant_values, controller_values : mapping of str to float, optional
        Parameters that are not nominal, in SI units, the same in all cells.

    Returns
    -------
    StabilityMap

    Raises
    ------
    ValueError
        If an axis or a parameter makes no sense, or the folder holds another map.
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
    from .options import read_number
    from .results.map_result import StabilityMap
    from .stability.stability_map import make_map
    from .stability.study import MapStudy, read_axis

    controller, plant = _controller(controller, step is not None), _plant(plant, step is not None)
    stop, step = _lengths(stop, step)
    across, along = (read_axis(text, plant, controller) for text in (x, y))
    given = (
        _values("plant", plant, plant_values),
        _values("controller", controller, controller_values),
    )
    processes = _processes(workers)
    tolerance = 1e-8 if exponents else 1e-6
    if mapping and step is None:
        raise ValueError("mapping is for FMUs; give their communication step, too")
    fmus = None
    if step is not None:
        from .stability.fmu_parts import over_fmus

        fmus = over_fmus(plant, controller, step, mapping or {}, exponents)
    study = MapStudy(
        controller,
        across,
        along,
        plant,
        *given,
        setpoint=read_number("setpoint", setpoint),
        stop=stop,
        exponents=exponents,
        tolerance=tolerance,
        fmus=fmus,
    )
    study.check()
    summary = make_map(study, Path(folder), processes, resume, refine)
    return StabilityMap(summary, Path(folder))


def swap_study(
    study: Path | str, folder: Path | str, resume: bool = False, workers: int = 1
) -> SwapStudy:
    """Tune several controllers alike, judge them on what no tuning saw, and compare.

    Parameters
    ----------
    study : path-like
        A study file, see ``docs/study.md``.
    folder : path-like
        Where tasks that are done are kept until all are; a study that was killed goes on there with
        `resume`.
    resume : bool
        Whether to finish the study that the folder holds.
    workers : int
        Processes.

    Returns
    -------
    SwapStudy
        ``trusted`` says whether no run failed and a twentieth of them, done again over FMUs, came
        out the same.

    Raises
    ------
    ValueError
        If the study makes no sense, or the folder holds another one.
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
    '2 controllers, 1 duties, 4 runs'
    """
    from .orchestration.study.plan import read_plan
    from .orchestration.study.study import discard_parts, do_study
    from .results.swap_study import SwapStudy

    plan = read_plan(study)
    for part in (plan.plant, *(e.component for e in plan.entrants)):
        _as_it_is_now(part)
    result = SwapStudy.of(do_study(plan, Path(folder), _processes(workers), resume))
    discard_parts(Path(folder))
    return result


def run_trial(
    trial: str, law: str = "modified_lugre", seed: int = 0, values: Values | None = None
) -> RigRecord:
    """Run a trial of the thesis on the virtual test rig, and record it with its instruments.

    Parameters
    ----------
    trial : str
        A trial's name, such as ``2.4/7``: Table 2.4, number 7.
    law : str
        Friction law between block and table.
    seed : int
        Decides all noise.
    values : mapping of str to float, optional
        Parameters that are not nominal, as ``plant.sigma0`` or ``encoder.counts``.

    Returns
    -------
    RigRecord
        ``record`` is what the instruments show, ``truth`` what was, arrays of shape (samples,).

    Raises
    ------
    ValueError
        If there is no such trial, law or parameter.

    Examples
    --------
    >>> import ballscrew
    >>> record = ballscrew.run_trial("2.8/1", law="lugre")
    >>> sorted(record.record)[:3]
    ['force', 'force_filtered', 'force_ref']
    """
    from .results.rig_record import RigRecord
    from .rig.bench import run_trial as recorded

    return RigRecord.of(recorded(trial, law, values, seed))


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
        CSV or MAT files, or folders that the rig wrote.
    mapping : mapping of str to str, optional
        Names of columns, ``theirs -> ours``: ``time``, ``x``, ``force``.
    units : mapping of str to str, optional
        Unit of a column of ours; default what the file says, else SI.
    mass : float, optional
        Mass between load cell and friction [kg].
    lead : float, optional
        Way of the screw per turn [m], for angles and torques.

    Returns
    -------
    list of Record

    Raises
    ------
    BadRecord
        With one line that says what cannot be used and why.
    """
    from .records.force_record import read_records

    return read_records(_paths(paths), mapping, units, mass, lead)


def read_drive_records(
    paths: Sequence[Path | str],
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> list[DriveRecord]:
    """Read records of a drive's command and position, for `diagnose`.

    Parameters
    ----------
    paths : sequence of path-like
        CSV, MAT or Parquet files.
    mapping, units, lead
        As in `read_force_records`; columns are ``time``, ``u``, ``x`` and perhaps ``i``.

    Returns
    -------
    list of DriveRecord

    Raises
    ------
    BadRecord
        With one line that says what cannot be used and why.
    """
    from .records.drive_record import read_drive_records as read

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
        With one line that says where the file makes no sense.
    """
    from .orchestration.parameter_reading import read_parameters as read

    return read(path)


def identify(
    records: Path | str | Sequence[Record | Path | str],
    law: str,
    fixed: Values | None = None,
    offset: bool = False,
    params: ParameterFile | None = None,
) -> IdentifiedLaw:
    """Find the parameters of a friction law in records of force and position.

    Parameters
    ----------
    records : path-like, or sequence of Record or path-like
        Of `read_force_records`; files with the columns ``time``, ``x`` and ``force`` in SI units,
        or that say their units, also by their paths.
    law : str
        A law of `catalogue`.
    fixed : mapping of str to float, optional
        Parameters that are known, in SI units.
    offset : bool
        Whether a constant force is fitted, too.
    params : ParameterFile, optional
        What is known; the written file keeps what the records do not show.

    Returns
    -------
    IdentifiedLaw
        ``parameters`` have 95 % intervals; what is not identified says why and what would do.

    Raises
    ------
    ValueError
        If there is no such law, a parameter cannot be held so, or a file cannot be used.

    Notes
    -----
    Maximum likelihood by Fisher scoring, with errors from pieces of the records; the thesis' own
    formulas stand beside it.
    """
    from .identification.identify import check_held
    from .identification.identify import identify as identified
    from .options import check_name
    from .plant import LAWS
    from .results.identified_law import IdentifiedLaw

    check_name("law", law, LAWS)
    check_held(law, dict(fixed or {}), offset)
    found: list[Record] = []
    for record in _paths(records):
        found += read_force_records([record]) if isinstance(record, str | Path) else [record]
    return IdentifiedLaw.of(identified(found, law, params, dict(fixed or {}), offset))


def diagnose(
    data: Path | str | Sequence[Path | str],
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    lead: float | None = None,
) -> DiagnosisResult:
    """What a simulation of recorded runs gets wrong, why, and how much better it can be.

    Parameters
    ----------
    data : path-like or sequence of path-like
        CSV, MAT or Parquet files with ``time`` [s], ``u`` [V] and ``x`` [m], perhaps ``i`` [A].
    params : path-like, optional
        Parameter file of the model as it is believed to be; the nominal axis by default.
    law : str, optional
        Friction law, in place of the file's.
    mapping, units, lead
        As in `read_drive_records`.

    Returns
    -------
    DiagnosisResult
        ``causes`` are those that gain on data that neither their choice nor their fit has seen;
        ``verdict`` may be that none can be named.

    Raises
    ------
    BadRecord, BadParameters
        With one line that says what cannot be used and why.
    """
    from .diagnosis.diagnose import diagnose as diagnosed
    from .options import check_name
    from .plant import LAWS
    from .results.diagnosis_result import DiagnosisResult

    if law is not None:
        check_name("law", law, LAWS)
    return DiagnosisResult.of(diagnosed(_paths(data), params, law, mapping, units=units, lead=lead))


def _in_practice(
    controller: str, sampled: float | None, noise: bool
) -> tuple[str, dict[str, float], tuple[str, ...]]:
    """A controller as studies take it, with its sampling period and notes."""
    if sampled is None and not noise:
        return controller, {}, ()
    from .orchestration.in_practice import in_practice

    named, practice = in_practice(controller, sampled is not None, noise)
    return named, {} if sampled is None else {practice.period: sampled}, practice.notes


def _over_time(reference: float | str | Reference) -> Reference:
    """A set-point over time; a number is a constant one, text a motion or a file."""
    from .loop_options import read_set_point
    from .options import read_number
    from .orchestration.reference_signal import Reference

    if isinstance(reference, Reference):
        return reference
    if isinstance(reference, str | Path):
        return read_set_point(str(reference))
    return Reference.constant(read_number("reference", reference))


def _numbers(argument: str, values: Values | None) -> dict[str, float]:
    """Values of parameters, each checked to be a number."""
    from .options import read_number

    return {n: read_number(f"{argument}[{n!r}]", v) for n, v in (values or {}).items()}


def _values(side: str, part: str, values: Values | None) -> dict[str, float]:
    """Values of parameters of a part that has them, checked."""
    from .orchestration.closed_loop import check_part_values

    given = _numbers(f"{side}_values", values)
    check_part_values(side, part, given)
    return given


def _processes(workers: int) -> Processes:
    from .options import read_whole_number
    from .orchestration.workers import Processes
    from .worker_options import MOST_WORKERS

    return Processes(read_whole_number("workers", workers, 1, MOST_WORKERS))


def _lengths(stop: float, step: float | None) -> tuple[float, float | None]:
    """The length of a motion and its communication step [s], checked as the command does."""
    from .options import read_length, read_step

    stop = read_length("stop", stop)
    return stop, None if step is None else read_step("step", step, stop)


def _controller(part: Part, fmus: bool = True) -> str:
    """A controller by a name, as all that runs takes it."""
    from .controllers import ALONE, CONTROLLERS

    return _named("controller", part, (*CONTROLLERS, *ALONE), fmus)


def _plant(part: Part, fmus: bool = True) -> str:
    """A plant by a name, as all that runs takes it."""
    from .plant import PLANTS

    return _named("plant", part, (*PLANTS,), fmus)


def _named(argument: str, part: Part, known: Sequence[str], fmus: bool) -> str:
    """A part by a name, checked; a Python file's is read again, a component is kept in memory."""
    from .options import BadRequest, check_part
    from .solver.component import Component
    from .solver.component_file import name_in_memory

    if isinstance(part, Component):
        return name_in_memory(part)
    if not isinstance(part, str | Path):
        raise BadRequest(f"{argument} is {part!r}, expected a name, a path or a Component")
    check_part(argument, str(part), known, fmus)
    return str(part)


def _of_each(
    controllers: Sequence[str], argument: str, given: Mapping[str, Mapping[str, Any]] | None
) -> list[dict[str, Any]]:
    """What is given for each controller by its name."""
    from .orchestration.parts import own_name

    names = [own_name(c) for c in controllers]
    for name in given or {}:
        if name not in names:
            raise ValueError(f"{argument} has {name!r}, expected one of {', '.join(names)}")
    return [dict((given or {}).get(name, {})) for name in names]


def _paths(given: Any) -> Any:
    """A sequence of files; one of them may be given alone."""
    return [given] if isinstance(given, str | Path) else given


def _as_it_is_now(part: str) -> str:
    """The same part; if it comes from a Python file, the file is read again."""
    from .instruments import bare
    from .solver.component_file import names_file, read_component

    if names_file(name := bare(part)):
        read_component(name)
    return part

"""The public functions for measured data: the virtual rig, reading, identification, diagnosis.

A file that cannot be used raises `UserError`, a ValueError, with one line that says where and why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .api import check_name, file_of

if TYPE_CHECKING:
    from .measured_results import DiagnosisResult, IdentifiedLaw, ModelComparison, RigRecord
    from .measurement.records.record import Record
    from .orchestration.loop.parameter_file import ParameterFile

    Data = Path | str | Sequence[Path | str]
    Names = Mapping[str, str]
    Progress = Callable[[str], None]


def run_trial(
    trial: str,
    law: str | None = None,
    seed: int = 0,
    values: Mapping[str, float] | None = None,
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

    file = file_of(params)
    law = law or (file and file.law) or DEFAULT_LAW
    return RigRecord.of(recorded(trial, law, values, seed, file=file))


def read_force_records(
    paths: Data,
    mapping: Names | None = None,
    units: Names | None = None,
    mass: float | None = None,
    lead: float | None = None,
) -> list[Record]:
    """Read records of force and position, for `identify`.

    Parameters
    ----------
    paths : path-like or sequence of path-like
        Files of measured data in any known format, or folders written by the rig.
    mapping : mapping of str to str, optional
        Names of columns, from the name in the file to ``time``, ``x`` or ``force``.
    units : mapping of str to str, optional
        Unit of each of these columns, or its size, such as ms, mm, rad, ``2.5e-6*m`` or N*m;
        default: the unit in the file, else SI.
    mass : float, optional
        Mass between load cell and friction [kg].
    lead : float, optional
        Lead of the screw: travel per turn [m], for rad, deg, rev, rpm and N*m. Default: by `p`, or
        the gain of a drive with command torque, of the parameter file.
    """
    from .measurement.records.reading import read_force_records as read

    return read(_paths(paths), mapping, units, mass, lead)


def read_drive_records(
    paths: Data,
    mapping: Names | None = None,
    units: Names | None = None,
    lead: float | None = None,
) -> list[Record]:
    """Read records of a drive's command and position, for `diagnose`.

    Parameters
    ----------
    paths, mapping, units, lead
        As in `read_force_records`; columns are ``time``, ``u``, ``x`` and, optionally, ``i``.
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
    """
    from .orchestration.loop.parameter_file import read_parameters as read

    return read(path)


def identify(  # noqa: PLR0913
    records: Path | str | Sequence[Record | Path | str],
    law: str,
    fixed: Mapping[str, float] | None = None,
    offset: bool = False,
    params: ParameterFile | Path | str | None = None,
    mass: float | bool = False,
    mapping: Names | None = None,
    units: Names | None = None,
    lead: float | None = None,
    progress: Progress | None = None,
) -> IdentifiedLaw:
    """Find the parameters of a friction law in records of force and position.

    Maximum likelihood by Fisher scoring, with errors from pieces of the records.

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
        of `params`, that of the rig, or 1 kg.
    mapping, units, lead
        As in `read_force_records`.
    progress : function of str, optional
        Called with the current step of the work.

    Returns
    -------
    IdentifiedLaw
        ``parameters`` have 95 % intervals; for each parameter that is not identified, the reason
        and a remedy are given.
    """
    from .measured_results import IdentifiedLaw
    from .measurement.identification.identify import identify_files
    from .plant import LAWS

    check_name("law", law, LAWS)
    asked = law, fixed, offset, file_of(params), mass, mapping, units, lead
    found = identify_files(_paths(records), *asked, progress=progress or _silent)
    return IdentifiedLaw.of(found)


def diagnose(
    data: Data,
    params: Path | str | None = None,
    law: str | None = None,
    mapping: Names | None = None,
    units: Names | None = None,
    lead: float | None = None,
    take: str | None = None,
    progress: Progress | None = None,
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
    progress : function of str, optional
        As in `identify`.

    Returns
    -------
    DiagnosisResult
        ``causes`` improve the model on data not used to select or fit them; ``verdict``
        may be that no cause can be named; ``suspects`` are others whose scores come near.
    """
    from .measured_results import DiagnosisResult
    from .measurement.diagnosis.causes import CAUSES
    from .measurement.diagnosis.diagnosis import diagnose_records
    from .measurement.diagnosis.model import drive_of
    from .measurement.records.reading import read_drive_records
    from .orchestration.loop.parameter_file import ParameterFile, read_parameters
    from .plant import LAWS

    for name, value, known in (("law", law, LAWS), ("take", take, CAUSES)):
        if value is not None:
            check_name(name, value, known)
    file = (ParameterFile() if params is None else read_parameters(params)).with_lead(lead)
    records = read_drive_records(_paths(data), mapping, units, lead or file.lead)
    found = diagnose_records(records, drive_of(file, law), progress or _silent, take)
    return DiagnosisResult.of(found)


def compare(
    data: Data,
    params: Path | str,
    mapping: Names | None = None,
    units: Names | None = None,
    lead: float | None = None,
    progress: Progress | None = None,
) -> ModelComparison:
    """How well the model of a parameter file predicts records; nothing is fitted to them.

    Parameters
    ----------
    data, mapping, units, lead, progress
        As in `diagnose`.
    params : path-like
        Parameter file of any command, or your own. A file of `diagnose` has three models:
        the prior one, the one with adjusted values, and the corrected one.

    Returns
    -------
    ModelComparison
        ``models`` has the rms residuals of each model, by part of the motion: of the
        force [N], and of the position predicted from the start of each second [m].
    """
    from .measured_results import ModelComparison
    from .measurement.diagnosis.compare import compare_records
    from .measurement.records.reading import read_drive_records
    from .orchestration.loop.parameter_file import read_parameters

    progress = progress or _silent
    progress("reading")
    file = read_parameters(params).with_lead(lead)
    records = read_drive_records(_paths(data), mapping, units, lead or file.lead)
    return ModelComparison.of(compare_records(records, file, progress))


def _paths(given: Any) -> Any:
    """A sequence of files, also if a single file is given."""
    return [given] if isinstance(given, str | Path) else given


def _silent(doing: str) -> None:
    """Say nothing of the work."""

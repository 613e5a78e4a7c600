"""The plant with the causes of a diagnosis: component, parameter file, predicted position."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...orchestration.loop.parameter_file import Diagnosed, ParameterFile, Value
from ...plant.classical import with_sticking
from ...plant.direct_drive import with_command_limit
from ...plant.instruments.amplifier import PARAMETERS as AMPLIFIER
from ...plant.instruments.amplifier import with_amplifier
from ...plant.rotary_drive import turned
from ...solver.arrays import Matrix, Vector
from ...solver.codegen import generate
from ...solver.component import Component, Parameter
from ...solver.errors import ContractError
from ...solver.kernel import IntegrationError, Kernel, Model
from ..identification.fitted_law import fitted_law
from .causes import CAUSES
from .causes.friction import PRESLIDING, bristled
from .model import Drive, curve_of
from .motion import Course

if TYPE_CHECKING:
    from .diagnosis import Diagnosis

PRIOR = "prior value, adjusted to measured data"
FOUND = "found in measured data"

Causes = Mapping[str, Mapping[str, float]]
_Number = TypeVar("_Number")

# Order of causes: first forces, while there is one body that cannot stick; then joints that divide
# the body; then sticking; last, causes between the command and the force.
PARTING = ("compliance", "backlash")
IN_COMMAND = ("resistance_drift", "voltage_saturation", "input_delay")


def with_causes(drive: Drive, found: Sequence[tuple[str, Mapping[str, float]]]) -> Component:
    """The plant of a drive with the causes that were found in it.

    Parameters
    ----------
    drive : Drive
    found : sequence of (cause, values)
        Names of `CAUSES` with their values, SI. If each record has its own value, such as
        ``friction_cos.1`` and ``friction_cos.2``, that of the last record is used.

    Returns
    -------
    Component
        Its parameters' defaults are the drive's and the found values; their `source` says which.

    Raises
    ------
    ContractError
        If a cause is unknown or not possible in this plant, or a value has no parameter there or
        is outside its range.
    """
    own = {name: _last_record(numbers) for name, numbers in found}
    for name in own:
        if name not in CAUSES:
            raise ContractError(f"no cause {name!r}; there are {', '.join(CAUSES)}")
        if because := CAUSES[name].beyond((), drive):
            raise ContractError(f"{name}: {because}")
    values = {n: v for numbers in own.values() for n, v in numbers.items()}
    drive = _with_law_of(drive, own)
    if PRESLIDING in own:
        values.pop("damping_ratio", None)
        values["sigma1"] = drive.values["sigma1"]
    plant = replace(drive.plant, name="extended_plant").with_defaults(drive.values, PRIOR)
    curve = curve_of(drive.law)
    first = [n for n in own if n not in (*PARTING, *IN_COMMAND)]
    for name in (*first, *(n for n in PARTING if n in own)):
        plant = CAUSES[name].extend(plant, curve, own[name])
    if fitted_law(drive.law).rigid:
        parted = "vb" in [s.name for s in plant.states]
        plant = with_sticking(plant, *(("vb", "xb") if parted else ("v", "x")))
    plant = with_amplifier(plant) if drive.has_motor else with_command_limit(plant)
    for name in (n for n in IN_COMMAND if n in own):
        plant = CAUSES[name].extend(plant, curve, own[name])
    return plant.with_defaults(values, FOUND)


def as_it_moves(plant: Component, drive: Drive) -> Component:
    """The plant of a drive; for a rotating body, converted from m and N to rad and N*m."""
    return turned(plant) if drive.turns else plant


def _with_law_of(drive: Drive, found: Mapping[str, Mapping[str, float]]) -> Drive:
    """The drive with its law changed by the causes: bristles are a separate law."""
    if PRESLIDING not in found:
        return drive
    numbers = found[PRESLIDING]
    return bristled(drive, numbers["sigma0"], numbers.get("damping_ratio", 1.0))


def _last_record(values: Mapping[str, _Number]) -> dict[str, _Number]:
    """The values without record numbers in their names; the last record's, if each has its own."""

    keys = sorted(values, key=lambda key: int(key.partition(".")[2] or 0))
    return {key.partition(".")[0]: values[key] for key in keys}


def corrected(result: Diagnosis, plant: Component | None, file: ParameterFile) -> ParameterFile:
    """The parameter file of a diagnosis: corrected values, each with its source.

    `plant` has the causes, where one can be made. A value of the prior model `file` that the
    diagnosis does not change keeps its interval and source, and so do values that are not part of
    it: amplifier, controllers, rig. Values of a motor that is left out, see `commanded`, are not
    written.
    """
    found = {c.name: _last_record(c.parameters) for c in result.causes}
    drive = _with_law_of(result.corrected, found) if plant else result.corrected
    plant = plant or with_causes(result.corrected, [])
    records = ", ".join(result.records)
    intervals: dict[str, tuple[float, float]] = {}
    for cause in result.causes:
        intervals |= _last_record(cause.intervals)

    def value_of(p: Parameter) -> Value:
        before = file.plant.get(p.name)
        if p.source == FOUND:
            source = f"found by ballscrew diagnose in {records}"
            return Value(p.default, p.unit, intervals.get(p.name), source)
        if before is not None and (before.value == p.default or p.name not in result.prior.values):
            return replace(before, unit=p.unit)
        if p.default != result.prior.values.get(p.name, p.default):
            return Value(p.default, p.unit, None, f"corrected by ballscrew diagnose to {records}")
        return Value(p.default, p.unit, None, "prior")

    names = {p.name for p in (*drive.plant.all_parameters, *AMPLIFIER)}
    own = {p.name: value_of(p) for p in plant.all_parameters if p.name in names}
    apart = [p for p in plant.all_parameters if p.name not in names and p.source == FOUND]
    others = file.plant if file.kind == drive.kind else {}
    return replace(
        file,
        path=None,
        kind=drive.kind,
        command="" if drive.has_motor else drive.command,
        law=drive.law,
        plant=own | {n: v for n, v in others.items() if n not in own},
        found={p.name: value_of(p) for p in apart},
        tolerance={},
        not_identified={},
        diagnosis=Diagnosed(
            records=result.records,
            command=result.command,
            command_shift=result.command_shift,
            law=result.prior.law,
            prior=result.prior.values,
            adjusted=result.adjusted.values,
            causes=found,
        ),
    ).turning()


# -- the predicted position --------------------------------------------------------------------

_AHEAD = 1.0  # time over which a position is predicted from a known state [s]
_BESIDE = {"xb": "x", "vb": "v", "xl": "x", "vl": "v"}  # initial states from the encoder's side

NOT_PREDICTED = (ContractError, IntegrationError)
"""Errors by which no position can be predicted; the message says why."""


class Predictor:
    """The equations of a drive with causes, to predict the motion of a record.

    The method is the same for every law: the package's solver solves the component under the
    recorded command. The causes have none in the command, which changes the command instead. `like`
    is a predictor of a drive with the same causes and other values, whose equations are used.
    Raises one of `NOT_PREDICTED`.
    """

    def __init__(self, drive: Drive, causes: Causes, like: Predictor | None = None) -> None:
        plant = with_causes(drive, list(causes.items()))
        self._values = {p.name: p.default for p in plant.all_parameters}
        self._kernel: Kernel = like._kernel if like else generate(plant)
        if like is None:
            self._kernel.compile()
        self._names = [s.name for s in self._kernel.states]
        self._measured = [self._names.index("x"), self._names.index("v")]

    def __call__(
        self,
        course: Course,
        seconds: Sequence[tuple[int, int]] | None = None,
        states: Matrix | None = None,
    ) -> Vector:
        """Position from the recorded state at the start of each second, shape (n,) [m].

        Only the `seconds`, (first, end), are predicted if they are given; other samples are NaN.
        `states` are those of `states`, if they are known already. Raises one of `NOT_PREDICTED`.
        """
        states = self.states(course) if states is None else states
        if seconds is None:
            seconds = list(itertools.pairwise(ends_of_seconds([course])))
        model, command, out = self._along(course), course.given_u, np.full(len(course.x), np.nan)
        for first, last in seconds:
            model.x[:] = states[first]
            model.x[self._measured] = course.x[first], course.v[first]
            _let_go(model)
            now = command[first:last, None]
            given = np.vstack([now[:1], now[:-1]]), now
            out[first:last] = model.simulate(course.time[first:last], given).states["x"]
        return out

    def states(self, course: Course) -> Matrix:
        """The component's state at each sample, shape (n, states).

        States that are not recorded (bristles, the current, a block behind a joint) come from
        solving it from sample to sample, with its position and velocity reset to the recorded ones
        at each. At rest, the bristles then balance the force of the command.
        """
        model, command = self._along(course), course.given_u
        for name, encoder in _BESIDE.items():
            if name in self._names:
                model.x[self._names.index(name)] = getattr(course, encoder)[0]
        motion, measured = np.column_stack([course.x, course.v]), self._measured
        states, time = np.empty((len(motion), len(self._names))), course.time.tolist()
        if len(self._names) == len(measured):
            states[:, measured] = motion
            return states
        for k, t in enumerate(time):
            model.x[measured] = motion[k]
            states[k] = model.x
            if k + 1 < len(motion):
                _let_go(model)
                model.u[0] = command[k]
                model.advance(t, time[k + 1])
        return states

    def _along(self, course: Course) -> Model:
        """The equations with the values of this record."""
        values = dict(self._values)
        if course.offset_name:
            values["offset"] += course.own_offset
        return Model(self._kernel, values)


def _let_go(model: Model) -> None:
    """Set the first mode, so that velocity and forces decide again whether the body sticks."""
    if model.kernel.modes:
        model.u[-1] = 0.0


def ends_of_seconds(courses: Sequence[Course]) -> list[int]:
    """Ends of the seconds over which positions are predicted, among all samples."""
    ends = [0]
    for c in courses:
        start, n = ends[-1], len(c.x)
        every = max(2, min(round(_AHEAD / c.step), n))
        ends += [start + k for k in (*range(every, n, every), n)]
    return ends

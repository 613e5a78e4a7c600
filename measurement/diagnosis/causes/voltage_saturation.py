"""An amplifier that cannot supply the commanded voltage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import sympy as sp

from ....plant.instruments.amplifier import clip
from ....solver.arrays import Vector
from ....solver.component import symbol
from ..drive import Drive
from ..modelled_record import ModelledRecord
from .cause import Cause, Courses, Values, of_command, parameter, voltage

# limits over the largest command; the last one cuts nothing and is the end of the search
_LEVELS = np.concatenate(
    [np.geomspace(0.02, 0.36, 12), 1.0 - np.append(np.geomspace(0.6, 0.001, 24), 0.0)]
)
_SAGS = (0.1, 0.3, 1.0)  # resistance of a supply over that of the motor
_SCALES = np.geomspace(0.02, 12.0, 17)  # scales over the largest command; a bend, not a limit
_SURE = 0.3
_U, _LIMIT, _SCALE = map(symbol, ("u", "voltage_limit", "voltage_scale"))


def _largest(courses: Courses) -> float:
    return max(float(np.abs(c.u).max()) for c in courses)


def _sags(courses: Courses, model: Drive) -> list[Values]:
    if not model.has_motor:
        return []
    return [
        {"voltage_limit": float(level), "supply_resistance": share * model.values["R"]}
        for share in _SAGS
        for level in _largest(courses) * _LEVELS[::3]
    ]


def _drawn(courses: Courses, model: Drive, values: Values) -> Sequence[Mapping[str, Vector]]:
    """Steady-state current of the limited voltage, for records without a measured current [A]."""

    def settled(course: ModelledRecord) -> Vector:
        generated = np.sign(course.u) * model.back_emf * course.middle_v
        resistance = model.values["R"] + values["supply_resistance"]
        return np.maximum((values["voltage_limit"] - generated) / resistance, 0.0)

    return [{} if c.has_current else {"i": settled(c)} for c in courses]


_MOST = sp.Max(_LIMIT - symbol("supply_resistance") * sp.Abs(symbol("i")), 0)
_HARD = parameter("voltage_limit", "V", "largest voltage, either sign", 1e6)
CAUSE = Cause(
    "voltage_saturation",
    "the amplifier gives less voltage than the largest commands demand",
    (
        voltage(
            {_U: clip(_U, -_LIMIT, _LIMIT)},
            (_HARD,),
            lambda courses, model: [
                {"voltage_limit": float(level)} for level in _LEVELS * _largest(courses)
            ],
            "voltage_limit",
            _SURE,
        ),
        voltage(
            {_U: _SCALE * sp.tanh(_U / _SCALE)},
            (parameter("voltage_scale", "V", "limiting voltage of a nonlinear amplifier", 1e6),),
            lambda courses, model: [
                {"voltage_scale": _largest(courses) * float(k)} for k in _SCALES
            ],
            "voltage_scale",
            _SURE,
        ),
        voltage(
            {_U: clip(_U, -_MOST, _MOST)},
            (
                _HARD,
                parameter(
                    "supply_resistance",
                    "Ohm",
                    "resistance by which the limit falls with the current",
                ),
            ),
            _sags,
            "voltage_limit",
            _SURE,
            _drawn,
        ),
    ),
    confirm="measure the motor's voltage at the largest command",
    mistaken_for=("nonlinear_viscous", "resistance_drift"),
    smaller=of_command,
)

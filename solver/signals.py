"""What a component and its kernel say of parameters and inputs; names of inputs for the set-point.

Nothing here needs SymPy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

SET_POINT = "x_d"
START_VALUE = 0.08  # [m] for loops and systems, so that their default run is the nominal step
DERIVATIVES = {"v_d": 1, "a_d": 2}
"""Inputs for feed-forward, and the order of the set-point's derivative of each."""
MEASURED = "_measured"  # ends the name of what an instrument gives of a signal
REFERENCES = ("reference", "reference_derivative")  # roles in a component


def set_point_orders(names: Sequence[str]) -> dict[str, int]:
    """Which of these inputs take the set-point (0) or its derivatives, and the order of each.

    An FMU has names and no roles, so names decide: ``x_d`` is the set-point, ``v_d`` and ``a_d``
    beside it are its derivatives; without ``x_d`` the only input is the set-point. Empty if it is
    not clear.
    """
    if names.count(SET_POINT) == 1:
        return {n: order for n, order in {SET_POINT: 0, **DERIVATIVES}.items() if n in names}
    return dict.fromkeys(names, 0) if len(names) == 1 else {}


@dataclass(frozen=True)
class Parameter:
    """A constant of the model.

    Parameters
    ----------
    name : str
    default : float
        In `unit`.
    unit : str
        SI, with ``*``, ``/`` and ``^``, such as ``N*s/m``; ``1`` for none.
    meaning : str
    source : str
        Where the default comes from.
    minimum, maximum : float, optional
        Inclusive bounds of valid values.
    nominal : float, optional
        Typical magnitude; zero: the magnitude of the default.
    """

    name: str
    default: float
    unit: str
    meaning: str
    source: str
    minimum: float = -math.inf
    maximum: float = math.inf
    nominal: float = 0.0


@dataclass(frozen=True)
class Input:
    """A signal that comes from outside and is held between communication points.

    Parameters
    ----------
    name, unit, meaning : str
    start : float
        Value if nothing is connected.
    nominal : float
        Typical magnitude.
    role : {"signal", "measurement", "reference", "reference_derivative", "internal"}
        A controller's ``measurement`` is part of the feedback law, its ``reference`` and
        ``reference_derivative`` are not. Beside a reference ``x_d``, the inputs ``v_d`` and ``a_d``
        are its derivatives in any case, as in an FMU, and are zero if nothing is connected;
        ``internal`` inputs are set by the FMU itself and are no FMI variables.
    law : tuple of str
        For an actuated input of a plant: the outputs on which a feedback law may act.
    """

    name: str
    unit: str
    meaning: str
    start: float = 0.0
    nominal: float = 1.0
    role: str = "signal"
    law: tuple[str, ...] = ()


def unit_in(unit: str, words: Mapping[str, str]) -> str:
    """A unit with some unit names replaced: ``V*s/m`` becomes ``N*s/m`` if V becomes N."""

    def replaced(found: re.Match[str]) -> str:
        before, word, after = found.groups()
        word = words.get(word, word)
        whole = word.isalpha() or not (before or after)
        return before + (word if whole else f"({word})") + after

    return re.sub(r"(/?)([A-Za-z]+)(\^?)", replaced, unit)

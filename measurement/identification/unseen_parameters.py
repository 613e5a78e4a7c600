"""Parameters that records do not identify: no sliding, no break-away, similar elements."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ...plant.maxwell_slip import ELEMENTS
from .fit_result import Fit, draw_coordinates, without_direction
from .fitted_law import BRISTLES, OFFSET, FittedLaw, claim_of
from .intervals import CONFIDENCE
from .law_along_record import with_backlash
from .layout import StackedRecords
from .optimizer import UNDER

_RIGID_YIELDING = 2e-5  # assumed presliding distance of a law without a stiffness [m]
BROKEN_AWAY = 5.0  # distance until a block slides, in units of Fs/sigma0
_SLID = 50.0  # total sliding distance needed after that, in the same units
_SPEEDS = 1.5  # least ratio of the speeds between which most of that distance is moved
_FALLEN = 0.7  # share of Vs that the speeds must reach: a third of the Stribeck fall
_REACHED = 0.9  # share of the break-away force that records must reach
# largest position error over the presliding distance if a bend is to give the final force
_SHARP, _REACHED_SHARPLY = 1e-3, 0.7


def presliding_way(law: FittedLaw, values: Mapping[str, float], end: str = "") -> float:
    """Presliding distance of a law with constant initial stiffness [m].

    Parameters
    ----------
    law : FittedLaw
    values : mapping of str to float
        Parameters as fitted.
    end : str, optional
        Suffix of the parameters' names, if the directions have separate parameters.
    """
    if law.directional and not end:  # of the mass, which has no direction
        end = "_pos"
    own = {n: values[n + end] for n in law.parameters}
    if law.name == "maxwell_slip":
        return own["Fs"] / sum(own[f"k{i}"] for i in range(1, ELEMENTS + 1))
    if law.name in BRISTLES:
        return own["Fs"] / own["sigma0"]
    stiffness = claim_of(law.name, "stiffness", own)
    return (
        abs(claim_of(law.name, "steady_state", own) / stiffness) if stiffness else _RIGID_YIELDING
    )


def peak_unseen(fit: Fit, course: StackedRecords, parameter: str) -> bool:
    """Whether a parameter describes break-away and the records do not show a break-away.

    Either the records end below it, so that the parameter is only extrapolated from the bend of the
    loading curve, which a sensor's scale error also causes; or no peak of static friction is
    visible. Dahl's law bends from the start, so without the end of the curve its initial stiffness
    is not identified either.
    """
    name = without_direction(parameter)
    end = parameter[len(name) :]
    static = "Fc" if fit.law.name == "dahl" else "Fs"
    falls = name in ("Fs", "Vs") and {"Fc", "Fs"} <= set(fit.law.parameters)
    if falls and fit.values["Fs" + end] < (1 + UNDER) * fit.values["Fc" + end]:
        return True
    if name not in (fit.law.parameters if fit.law.name == "dahl" else ("Fs",)):
        return False
    friction = (fit.predicted - course.inertial)[fit.spoken] - fit.values.get(OFFSET, 0.0)
    pull = {"_pos": friction, "_neg": -friction}.get(end, np.abs(friction))
    way = presliding_way(fit.law, fit.values, end)
    sharp = max(float(np.max(course.backlash)) / way, float(np.max(course.gain_std))) < _SHARP
    reached = _REACHED_SHARPLY if sharp else _REACHED
    return float(np.max(pull)) < reached * fit.values[static + end]


def hardly_slides(fit: Fit, course: StackedRecords, parameter: str) -> bool:
    """Whether a parameter describes sliding and the records do not slide enough to identify it.

    If the records show almost only presliding, a very small sensor error looks like a Stribeck
    curve. If they slide at one speed, or at speeds at which that curve has hardly fallen, its
    remaining fall, its width and the viscous slope are not identified.
    """
    name = without_direction(parameter)
    rigid = fit.law.rigid
    curve = ["Fc", "Vs", "sigma2"]
    sliding = curve.copy()
    if fit.law.name == "maxwell_slip":  # shares of the force at which all elements slip
        sliding += ["C", "Fs", *(f"alpha{i}" for i in range(1, ELEMENTS + 1))]
    if name == OFFSET or "Vs" not in fit.law.parameters or (name not in sliding and not rigid):
        return False
    end = parameter[len(name) :]
    yielding = presliding_way(fit.law, fit.values, end)
    dragged = with_backlash(
        course.x, course.starts, np.full(course.records, BROKEN_AWAY * yielding)
    )
    moves = np.diff(dragged, prepend=dragged[0])
    moves[course.starts[:-1]] = 0.0
    ways = {"_pos": np.maximum(moves, 0.0), "_neg": np.maximum(-moves, 0.0)}.get(end, np.abs(moves))
    slid = float(ways.sum())
    if slid < _SLID * yielding:
        return True
    if name not in curve:
        return False
    order = np.argsort(np.abs(course.v))
    covered = np.cumsum(ways[order]) / slid
    slow, fast = np.abs(course.v)[order][np.searchsorted(covered, (0.1, 0.9))]
    return bool(fast < _SPEEDS * slow or fast < _FALLEN * fit.values["Vs" + end])


def blurred_elements(fit: Fit, resolution: float) -> set[str]:
    """Parameter names of Maxwell-slip elements that records do not distinguish from others.

    An element is distinguished if, for all plausible parameters, its force is more than the
    resolution of the load cell, and it yields after the previous and before the next element.

    Parameters
    ----------
    fit : Fit
    resolution : float
        Resolution of the load cell [N].
    """
    if fit.law.name != "maxwell_slip":
        return set()
    names = set()
    drawn = draw_coordinates(fit)
    for first in range(0, len(fit.names) - len(fit.law.beside), len(fit.law.parameters)):
        own = drawn[:, first : first + len(fit.law.parameters)]
        stiffness, shares = own[:, :ELEMENTS], own[:, ELEMENTS : 2 * ELEMENTS]
        held = shares * own[:, -2:-1]
        ways = held / stiffness
        before = np.column_stack([np.zeros(len(ways)), ways[:, :-1]])
        after = np.column_stack([ways[:, 1:], np.full(len(ways), math.inf)])
        told = np.mean((held > 2 * resolution) & (before < ways) & (ways < after), axis=0)
        for i in np.flatnonzero(told < CONFIDENCE):
            names |= {fit.names[first + i], fit.names[first + ELEMENTS + i]}
    return names

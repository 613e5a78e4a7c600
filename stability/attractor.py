"""Verdicts on long-term motion: rest, a cycle, a torus, chaos, or divergence; with the evidence."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from ..solver.arrays import Vector
from ..solver.kernel import Model
from ..solver.spectrum import Returns
from .equilibria import Equilibrium

CLOSED = 1e-3  # share of the size of a motion: a smaller remaining distance counts as closed
SAME = 1e-2  # relative difference up to which periods and amplitudes are the same
WIDER, LEAST = 3.0, 1e-5  # times a change, and share of an exponent, in the bound of its error
LISTED = 14  # most listed states and eigenvalues
AGAIN = "a tenth of the tolerance changes the verdict"

# values of `would_decide`
LONGER_RUN, EXPONENTS = "a longer run", "the exponents"
OTHER_SOLVER = "a solver that can continue beyond this point"


class Kind(StrEnum):
    """Long-term motion."""

    FIXED_POINT = "isolated fixed point"
    LINE = "stuck on a line of equilibria"
    REST = "at rest"
    CYCLE = "limit cycle"
    TORUS = "torus"
    CHAOS = "chaos"
    DIVERGES = "diverges"
    CREEPING = "creeping along equilibria"
    BOUNDED = "bounded motion of a quantized loop"
    UNDECIDED = "undecided"
    WINDING = "stuck while an integral winds up"


@dataclass(frozen=True)
class Attractor:
    """A verdict on a motion.

    Attributes
    ----------
    kind : Kind
    evidence : str
        One or two sentences with the numbers on which the verdict is based.
    would_decide : str
        If undecided: what would allow a decision.
    equilibrium : Equilibrium or None
        The equilibrium at rest.
    period : float or None
        Of a cycle [s].
    amplitude : dict of str to float
        Half the range of each state in the cycle, or in the last part of the motion.
    return_error : float or None
        Distance between states one period apart, over the motion's size.
    since : float or None
        Time of the divergence [s].
    limit : ndarray, shape (count,), or None
        The exponents' limits [nats/s], largest first; minus infinity for directions that are
        contracted at once.
    limit_error : ndarray, shape (count,), or None
        Bound of the error of each [nats/s]: of eigenvalues by round-off in the Jacobian, of whole
        periods of a cycle from two halves and the distance to the orbit, in chaos half of a 95 %
        interval from the scatter of blocks; and three times the change by a tenth of the tolerance,
        if that is larger.
    """

    kind: Kind
    evidence: str
    would_decide: str = ""
    equilibrium: Equilibrium | None = None
    period: float | None = None
    amplitude: dict[str, float] = field(default_factory=dict)
    return_error: float | None = None
    since: float | None = None
    limit: Vector | None = None
    limit_error: Vector | None = None


def ended(failure: str, diverged: bool, end: float, so_far: Attractor | None = None) -> Attractor:
    """The verdict if a motion cannot be followed beyond `end`: divergence, or that until then."""
    if diverged:
        return Attractor(Kind.DIVERGES, failure, since=end)
    if so_far is None:
        return Attractor(Kind.UNDECIDED, failure, OTHER_SOLVER)
    would = OTHER_SOLVER if so_far.kind is Kind.UNDECIDED else so_far.would_decide
    return replace(
        so_far, evidence=f"{so_far.evidence}; beyond that, {failure}", would_decide=would
    )


def ranges(model: Model, passes: Returns) -> dict[str, float]:
    """Half the range of each state."""
    names = [s.name for s in model.kernel.states]
    return dict(zip(names, (0.5 * (passes.high - passes.low)).tolist(), strict=True))


def over_nominal(model: Model, amplitude: dict[str, float]) -> dict[str, float]:
    """Amplitudes as multiples of the states' nominal magnitudes."""
    nominal = zip((s.name for s in model.kernel.states), model.kernel.nominal, strict=True)
    return {name: amplitude[name] / float(size) for name, size in nominal}


def listed(texts: list[str]) -> str:
    """The first `LISTED` texts and the number of the others: nodes along delays are many."""
    rest = len(texts) - LISTED
    return ", ".join(texts[:LISTED]) + (f" and {rest} more" if rest > 0 else "")


def listed_rates(values: npt.NDArray[np.inexact[Any]], unit: str) -> str:
    """Rates with their unit; directions that vanish, at a sample or an event, are counted."""
    known = [v for v in values.tolist() if np.isfinite(v.real)]
    texts = [f"{v.real:.4g}" + (f"{v.imag:+.4g}i" if v.imag else "") for v in known]
    gone = len(values) - len(known)
    return f"{listed(texts)} {unit}" + (f"; {gone} directions vanish at once" if gone else "")


def bars(estimates: Vector, others: Vector, least: float = LEAST) -> Vector:
    """Bounds of the errors of estimates, from those of a second run; zero for minus infinity.

    They are no intervals of a known probability: a tenth of the tolerance does not always lower an
    error to a tenth. Of 420 finite-time exponents of iol, nctf and pid 38 % differ by less than
    the plain change from those at 1e-13, and all by less than these bounds.
    """
    with np.errstate(invalid="ignore"):
        found = np.maximum(WIDER * np.abs(estimates - others), least * np.abs(others))
    return np.where(np.isfinite(found), found, 0.0)


def agreed(first: Kind, second: Kind) -> Kind | None:
    """The verdict from those at two tolerances; None if they contradict each other.

    A creep may come to rest: at one of the tolerances this may be later.
    """
    if {first, second} == {Kind.CREEPING, Kind.LINE}:
        return Kind.CREEPING
    return first if first is second else None


def agree(first: Attractor, second: Attractor) -> Attractor:
    """The second verdict, at a tenth of the tolerance, if the first one agrees; else undecided."""
    kind = agreed(first.kind, second.kind)
    text = f"{first.kind.value} ({first.evidence}) against {second.kind.value}"
    if first.kind is second.kind and first.period and second.period:
        shorter, longer = sorted((first.period, second.period))
        periods = longer / shorter  # a cycle also closes after several periods
        swings = [
            abs(second.amplitude[n] - a) / max(a, abs(second.amplitude[n]))
            for n, a in first.amplitude.items()
            if a > 0.0
        ]
        whole = abs(periods - round(periods)) <= SAME * periods
        allowed = SAME if round(periods) == 1 else CLOSED  # subharmonics begin small
        kind = kind if whole and max(swings, default=0.0) <= allowed else None
        text = f"periods of {first.period:.6g} and {second.period:.6g} s, or their amplitudes"
        second = replace(second, period=shorter) if round(periods) > 1 else second
    if kind is None:
        would = "tighter ones, until two in succession agree"
        return Attractor(Kind.UNDECIDED, f"{AGAIN}: {text}", would)
    if kind is not second.kind:
        return first
    if first.limit is None or second.limit is None or second.limit_error is None:
        return second
    if second.kind is Kind.CHAOS:  # two orbits of one attractor have random differences
        return second
    error = np.maximum(second.limit_error, bars(first.limit, second.limit, 0.0))
    return replace(second, limit_error=error)

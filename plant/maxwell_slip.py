"""Generalized Maxwell-slip friction, without events.

V. Lampaert, F. Al-Bender, J. Swevers, "A generalized Maxwell-slip friction model appropriate for
control purposes", Physics and Control (2003): massless blocks on springs side by side, element i
with the stiffness k_i and the share alpha_i of the Stribeck curve s(v):

    sticking: dF_i/dt = k_i v                                 until |F_i| reaches alpha_i s(v),
    slipping: dF_i/dt = C (alpha_i sgn(v) - F_i/s(v))         until v changes sign,
    F = sum of F_i + sigma2 v

Whether an element slips is a memory: two elements of equal force and speed may differ in it.
Instead of a switch it is a state here, q_i. It goes to sgn(v) over a distance of `MEMORY_LENGTH`
once |F_i| is above alpha_i s(v) (half of the full rate at an excess of the share `OVERSHOOT`),
stays there while v keeps its sign, and returns to 0 over the same distance after a reversal. Below
`TIPPING` it returns to 0, above it continues to sgn(v): an element that just reaches a rising limit
either slips or sticks. The element slips by the share max(0, q_i sgn v); the attraction decreases
to zero below `SLOWEST_SLIP`, so that nothing jumps at v = 0. The difference to the law with
switches is measured in ``tests/plant/test_exact_solutions.py``: at most 0.4 mN of 2.35 N.

The elements' own damping is left out. Slipping at less than C alpha_i/k_i (1 - Fc/Fs) may load an
element faster than its spring would be loaded, which generates energy: the published law is
certainly passive only for motion that does not stay below that speed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import sympy as sp

from ..solver.component import ForceTerm, Output, Parameter, State, symbol
from .law import Claims, Estimation, friction_term
from .lugre import PARAMETERS as LUGRE
from .lugre import stribeck

ELEMENTS = 4
MEMORY_LENGTH = sp.Float("1e-9")  # m
OVERSHOOT = sp.Float("1e-3")
TIPPING = sp.Float("0.1")
SLOWEST_SLIP = sp.Float("1e-7")  # m/s

_DEFAULT = {p.name: p.default for p in LUGRE}


def _shares(elements: int) -> list[float]:
    """Shares of the Stribeck curve for elements of equal stiffness.

    Loaded slowly from rest, the force of LuGre is Fs (1 - exp(-u)) with u = sigma0 x/Fs; that of
    the elements is a polygon. The polygon consists of tangents to that curve where its slope is 1,
    1 - 1/n, ..., 1/n, 0, so that stiffness and largest force are those of LuGre.
    """

    def moment(slope: float) -> float:
        return slope * (1 - math.log(slope)) if slope else 0.0

    slopes = [1 - j / elements for j in range(elements + 1)]
    return [moment(a) - moment(b) for a, b in pairwise(slopes)]


def _names(stem: str) -> list[str]:
    return [f"{stem}{i}" for i in range(1, ELEMENTS + 1)]


_SHARE = "share of element {} in the Stribeck curve"
_TANGENTS = "tangents to the LuGre law's slow loading curve"
_STIFFNESS, _SOURCE = _DEFAULT["sigma0"] / ELEMENTS, f"Table 2.9: sigma0/{ELEMENTS}"
_ATTRACTION = "attraction: how fast slipping elements follow the Stribeck curve"
_RATE = "sigma0 Vs: the rate of the LuGre law at the Stribeck velocity"

PARAMETERS = (
    *(
        Parameter(f"k{i}", _STIFFNESS, "N/m", f"stiffness of element {i}", _SOURCE, minimum=1e-3)
        for i in range(1, ELEMENTS + 1)
    ),
    *(
        Parameter(f"alpha{i}", share, "1", _SHARE.format(i), _TANGENTS, minimum=1e-6)
        for i, share in enumerate(_shares(ELEMENTS), start=1)
    ),
    Parameter("C", _DEFAULT["sigma0"] * _DEFAULT["Vs"], "N/s", _ATTRACTION, _RATE, minimum=0.0),
    *(p for p in LUGRE if p.name in ("sigma2", "Fc", "Fs", "Vs")),
)

_K, _ALPHA = ([symbol(name) for name in _names(stem)] for stem in ("k", "alpha"))
_LEAST, _MOST = (f(symbol("Fc"), symbol("Fs")) for f in (sp.Min, sp.Max))


def _guesses(seen: Mapping[str, float]) -> list[dict[str, float]]:
    guess = {p.name: p.default for p in PARAMETERS} | {"C": seen["stiffness"] * seen["Vs"]}
    return [guess | dict.fromkeys(_names("k"), seen["stiffness"] / ELEMENTS)]


def _from_ratios(*values: Any) -> Iterable[Any]:
    """Shares add up to one, since a common factor is one of Fc and Fs; the last ratio is one."""
    ratios = [*values[ELEMENTS : 2 * ELEMENTS - 1], values[2 * ELEMENTS - 1] ** 0]
    return *values[:ELEMENTS], *(r / sum(ratios) for r in ratios), *values[2 * ELEMENTS :]


def _to_ratios(*values: Any) -> Iterable[Any]:
    shares = values[ELEMENTS : 2 * ELEMENTS]
    return *values[:ELEMENTS], *(s / shares[-1] for s in shares), *values[2 * ELEMENTS :]


CLAIMS = Claims(
    steady_state=sp.Add(*_ALPHA) * stribeck(symbol("v")) * sp.sign(symbol("v"))
    + symbol("sigma2") * symbol("v"),
    stiffness=sp.Add(*_K),
    passive_above=symbol("C")
    * sp.Max(*(a / k for a, k in zip(_ALPHA, _K, strict=True)))
    * (1 - _LEAST / _MOST),
    lags=True,
    breaks_away_sooner_when_loaded_faster=True,
    estimation=Estimation(
        "elements",
        _guesses,
        tuple(_names("alpha")),
        _from_ratios,
        _to_ratios,
        of_sliding=("C", "Fs", *_names("alpha")),
    ),
)


def maxwell_slip(velocity: sp.Expr) -> ForceTerm:
    """The friction term of a body that moves with `velocity` [m/s]."""
    speed, curve = sp.Abs(velocity), stribeck(velocity)
    moving = velocity / (speed + SLOWEST_SLIP)  # sgn(v), smooth at rest
    states, forces = [], []
    for i, (k, share) in enumerate(zip(_K, _ALPHA, strict=True), start=1):
        z, q = symbol(f"z{i}"), symbol(f"q{i}")
        force = k * z
        forwards = velocity > 0
        over = sp.Piecewise((force, forwards), (-force, True)) / (share * curve) - 1
        reached = sp.Piecewise((over / (over + OVERSHOOT), over > 0), (0, True))
        along = sp.Piecewise((q, forwards), (-q, True))  # 1 while slipping, 0 while sticking
        kept = 10 * along * (along - TIPPING) * (1 - along)
        lost = -along
        upkeep = sp.Piecewise((kept, along > 0), (lost, True))
        memory = velocity * (reached * (1 - along) + upkeep) / MEMORY_LENGTH
        following = symbol("C") / k * (share * moving - sp.Abs(moving) * force / curve)
        slipping = sp.Piecewise((along, along > 0), (0, True))
        rate = (1 - slipping) * velocity + slipping * following
        forces.append(force)
        states += [
            State(f"z{i}", "m", f"deflection of element {i}", rate, nominal=1e-5),
            State(f"q{i}", "1", f"slip of element {i} by direction, 0 if it sticks", memory),
        ]
    elastic = sp.Add(*forces)
    total = elastic + symbol("sigma2") * velocity
    # a memory that switches has no useful error measure
    shown = [Output(s.name, s.unit, s.meaning, symbol(s.name), s.nominal) for s in states[::2]]
    mean = elastic / sp.Add(*_K)
    shown.append(Output("z", "m", "mean deflection, weighted by stiffness", mean, nominal=1e-5))
    return friction_term("generalized Maxwell-slip friction", total, PARAMETERS, states, shown)

"""Interface of a friction law, and its claimed properties.

A law is a function of the velocity that returns a `ForceTerm` with an output ``friction``
[N], positive if it opposes motion in +x. If the law has a deflection, it also has a state or
an output ``z`` [m]: the elastic part of the force divided by the stiffness at rest.

In addition to the function, each law's file has a `Claims` named ``CLAIMS``. The conformance suite
tests the law against it; other modules take the steady-state curve and the stiffness from it, and
what an estimation of its parameters from records asks.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

import sympy as sp

from ..solver.component import Component, ForceTerm, Output, Parameter, State, in_units
from ..solver.errors import UnknownName
from . import LAWS, TURNING

Law = Callable[[sp.Expr], ForceTerm]


@dataclass(frozen=True)
class Estimation:
    """What an estimation of a law's parameters from records asks; both directions are alike."""

    # form of the exact step along a record, see ``measurement/identification/c/laws.c``; empty:
    # the equations are solved
    form: str = ""
    # first guesses of the parameters but Fc, Fs, Vs and sigma2 of a Stribeck curve, from these and
    # from rough features of records: "stiffness" [N/m], "sliding" and "largest" force [N]
    guesses: Callable[[Mapping[str, float]], list[dict[str, float]]] | None = None
    # parameters that cannot be estimated one by one; positive numbers in their place, of which all
    # parameters are functions, and the inverse
    together: tuple[str, ...] = ()
    parameters: Callable[..., Iterable[Any]] | None = None
    numbers: Callable[..., Iterable[Any]] | None = None
    of_sliding: tuple[str, ...] = ()  # seen only if the body slides far, beside Fc, Vs and sigma2
    of_break_away: tuple[str, ...] = ("Fs",)  # seen only if the body breaks away
    unseen: tuple[str, ...] = ()  # never seen: these keep their defaults


@dataclass(frozen=True)
class Claims:
    """Claimed properties of a friction law, in symbols of its parameters and the velocity ``v``."""

    # friction [N] after a long time at the constant velocity ``v``; None: no such value exists
    steady_state: sp.Expr | None
    # dF/dx [N/m] at zero force and zero deflection, for motion in the direction of ``v``; None:
    # rigid; zero: smooth, without a deflection
    stiffness: sp.Expr | None
    # condition on the parameters under which the law is passive: no motion from the undeflected
    # state can extract more work than was put in
    passive_if: sp.Basic = sp.true
    # speed [m/s]; the condition is valid only for motion that does not stay below it (passing
    # through it is allowed)
    passive_above: sp.Expr = sp.S.Zero
    follows_path_only: bool = False  # friction depends on the path and not on the speed
    # If the velocity oscillates without changing sign, friction is higher at rising velocity than
    # at falling velocity
    lags: bool = False
    # the largest friction before sliding falls as the loading rate grows
    breaks_away_sooner_when_loaded_faster: bool = False
    estimation: Estimation = field(default_factory=Estimation)


def friction_term(
    kind: str,
    force: sp.Expr,
    parameters: tuple[Parameter, ...],
    states: Iterable[State] = (),
    outputs: Iterable[Output] = (),
) -> ForceTerm:
    """The term of a law whose `force` [N] is positive if it opposes motion in +x."""
    shown = Output("friction", "N", "friction force, opposing motion", force, nominal=1.0)
    meaning = f"{kind}, opposing motion"
    return ForceTerm("friction", -force, meaning, (*states,), parameters, (*outputs, shown))


def law(name: str) -> Law:
    """The friction law of this name; raises `UnknownName`."""
    module, function = _place(name)
    return cast("Law", getattr(importlib.import_module(module), function))


def turning(term: ForceTerm) -> ForceTerm:
    """The term of a rotating body: the same numbers, in N*m instead of N and rad instead of m."""
    return cast("ForceTerm", in_units(term, TURNING))


def with_each_law(
    make: Callable[[Law, str], Component], base: str
) -> Callable[[str], Callable[[], Component]]:
    """``__getattr__`` of a module of plants: ``<base>_<law>`` is the plant with that law."""

    def plant_named(name: str) -> Callable[[], Component]:
        known = name.removeprefix(f"{base}_")
        if known == name or known not in LAWS:
            raise AttributeError(f"module {make.__module__!r} has no attribute {name!r}")
        return partial(make, law(known), name)

    return plant_named


def claims(name: str) -> Claims:
    """Claimed properties of the friction law of this name; raises `UnknownName`."""
    return cast("Claims", importlib.import_module(_place(name)[0]).CLAIMS)


def _place(name: str) -> list[str]:
    if name not in LAWS:
        raise UnknownName(f"no friction law {name!r}; there are {', '.join(LAWS)}")
    return LAWS[name].split(":")

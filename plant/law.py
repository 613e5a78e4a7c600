"""What a friction law is to the rest of the project, and what it promises.

A law is a function of the velocity that returns a `ForceTerm` with an output ``friction`` [N],
positive where it opposes motion in +x, and, where the law has something like a deflection, a state
or an output ``z`` [m]: the elastic part of the force divided by the stiffness at rest.

Beside the function, each law's file has a `Claims` named ``CLAIMS``. The conformance suite holds
the law to it; whoever needs a steady-state curve or a stiffness takes it from there.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import cast

import sympy as sp

from ..solver.component import Component, ForceTerm, in_units
from . import LAWS, TURNING

Law = Callable[[sp.Expr], ForceTerm]


@dataclass(frozen=True)
class Claims:
    """What a friction law promises, in symbols of its parameters and of the velocity ``v``.

    Attributes
    ----------
    steady_state : expression or None
        Friction [N] after a long time at the constant velocity ``v``; None: there is no such value.
    stiffness : expression or None
        dF/dx [N/m] at no force and no deflection, for motion in the direction of ``v``; None:
        rigid.
    passive_if : relation
        Condition on the parameters under which no motion from the undeflected state ever takes out
        more work than was put in.
    passive_above : expression
        Speed [m/s] below which the motion may not linger (crossing it is fine) for that to hold.
    follows_path_only : bool
        Friction depends on the path, not on how fast it is run through.
    lags : bool
        At a velocity that swings without changing sign, friction is higher on the way up than down.
    breaks_away_sooner_when_loaded_faster : bool
        The largest friction before sliding falls as the loading rate grows.
    """

    steady_state: sp.Expr | None
    stiffness: sp.Expr | None
    passive_if: sp.Basic = sp.true
    passive_above: sp.Expr = sp.S.Zero
    follows_path_only: bool = False
    lags: bool = False
    breaks_away_sooner_when_loaded_faster: bool = False


class UnknownLaw(KeyError):
    """A name that is no friction law; the message lists those that are."""

    def __str__(self) -> str:
        return str(self.args[0])


def law(name: str) -> Law:
    """The friction law of this name.

    Raises
    ------
    UnknownLaw
    """
    module, function = _place(name)
    return cast("Law", getattr(importlib.import_module(module), function))


def turning(term: ForceTerm) -> ForceTerm:
    """The term of a body that turns: the same numbers in N*m for N and in rad for m."""
    return cast("ForceTerm", in_units(term, TURNING))


def with_each_law(
    make: Callable[[Law, str], Component], base: str
) -> Callable[[str], Callable[[], Component]]:
    """What a module of plants answers to the names of `PLANTS`: ``<base>_<law>`` has that law.

    Parameters
    ----------
    make : function of (law, name) to a Component
    base : str

    Returns
    -------
    function
        The module's ``__getattr__``.
    """

    def plant_named(name: str) -> Callable[[], Component]:
        known = name.removeprefix(f"{base}_")
        if known == name or known not in LAWS:
            raise AttributeError(f"module {make.__module__!r} has no attribute {name!r}")
        return partial(make, law(known), name)

    return plant_named


def claims(name: str) -> Claims:
    """What the friction law of this name promises.

    Raises
    ------
    UnknownLaw
    """
    return cast("Claims", importlib.import_module(_place(name)[0]).CLAIMS)


def _place(name: str) -> list[str]:
    if name not in LAWS:
        raise UnknownLaw(f"no friction law {name!r}; there are {', '.join(LAWS)}")
    return LAWS[name].split(":")

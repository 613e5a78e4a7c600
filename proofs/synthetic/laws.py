"""Friction laws whose features are known, because each is added separately.

`rigid` is a smooth sign of the velocity times terms that are active if their parameter is not zero;
`sprung` is a yielding spring. They are not models of a real machine.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from unittest import mock

import sympy as sp
from features.criteria import Cell, decide_features
from features.experiments import observe

from ballscrew.plant import LAWS
from ballscrew.solver.component import ForceTerm, Output, Parameter, State, symbol

CREEP = sp.Float("1e-8")
"""Speed at which the smooth sign turns over [m/s]: a tenth of a micrometre in the longest hold."""
STRIBECK_VELOCITY = sp.Float("1e-3")  # m/s
MEMORY_TIME = sp.Float("0.1")  # s
AGEING_TIME = sp.Float("2.0")  # s
CONTACT_LENGTH = sp.Float("5e-6")  # m

# Compiled code is stored by the law's name, so a changed law needs another name.
_CONTENT = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]
RIGID, SPRUNG = f"synthetic_rigid_{_CONTENT}", f"synthetic_sprung_{_CONTENT}"
NAMES = {RIGID: "synthetic.laws:rigid", SPRUNG: "synthetic.laws:sprung"}


def _parameter(name: str, default: float, unit: str, meaning: str) -> Parameter:
    return Parameter(name, default, unit, meaning, "made up")


def _term(
    force: sp.Expr, states: tuple[State, ...], parameters: tuple[Parameter, ...]
) -> ForceTerm:
    return ForceTerm(
        name="friction",
        force=-force,
        meaning="synthetic friction",
        states=states,
        parameters=parameters,
        outputs=(Output("friction", "N", "friction force, opposing motion", force),),
    )


def rigid(velocity: sp.Expr) -> ForceTerm:
    """A law without presliding: friction acts as soon as the block moves.

    Its terms are the Coulomb force, a share that decreases with speed, a share that grows at rest
    and is removed by sliding, a viscous share, and a share that follows changes of the velocity.
    """
    coulomb, fading, ageing, viscous, memory = map(
        symbol, ("coulomb", "fading", "ageing", "viscous", "memory")
    )
    age, before = symbol("age"), symbol("before")
    held = coulomb + fading * sp.exp(-((velocity / STRIBECK_VELOCITY) ** 2)) + ageing * age
    force = sp.tanh(velocity / CREEP) * held + viscous * velocity + memory * (velocity - before)
    states = (
        State(
            "age",
            "1",
            "age of the contact",
            (1 - age) / AGEING_TIME - sp.Abs(velocity) / CONTACT_LENGTH * age,
        ),
        State("before", "m/s", "velocity a moment ago", (velocity - before) / MEMORY_TIME),
    )
    return _term(
        force,
        states,
        (
            _parameter("coulomb", 0.0, "N", "at any speed"),
            _parameter("fading", 0.0, "N", "at low speed only"),
            _parameter("ageing", 0.0, "N", "after long sticking"),
            _parameter("viscous", 0.0, "N*s/m", "by the velocity"),
            _parameter("memory", 0.0, "N*s/m", "by the change of velocity"),
        ),
    )


def sprung(velocity: sp.Expr) -> ForceTerm:
    """Presliding only: a spring that slides at `limit`, the more abruptly the larger `hardness`."""
    stiffness, limit, hardness, z = map(symbol, ("stiffness", "limit", "hardness", "z"))
    share = stiffness * z / limit
    # tiny, so that the power has a derivative at zero force
    power = sp.exp((hardness - 1) * sp.log(sp.Abs(share) + sp.Float("1e-12")))
    rate = velocity - sp.Abs(velocity) * power * share
    return _term(
        stiffness * z,
        (State("z", "m", "deflection", rate, nominal=1e-5),),
        (
            _parameter("stiffness", 66967.231, "N/m", "of the spring"),
            _parameter("limit", 2.0, "N", "largest force"),
            _parameter("hardness", 20.0, "1", "how abruptly the spring gives way"),
        ),
    )


# active parameters, and the resulting features in the order of FEATURES
MADE = {
    "Coulomb friction alone": (RIGID, {"coulomb": 1.3}, "no conditional no no no"),
    "viscous friction alone": (RIGID, {"viscous": 173.0}, "no yes no no no"),
    "twice the viscous friction": (
        RIGID,
        {"coulomb": 1.3, "viscous": 346.0},
        "no no no no no",
    ),
    "weaker with speed": (RIGID, {"coulomb": 3.0, "viscous": -100.0}, "no no no no no"),
    "a static Stribeck curve": (
        RIGID,
        {"coulomb": 1.3, "fading": 1.0, "viscous": 173.0},
        "yes yes no no no",
    ),
    "a break-away force that is too large": (
        RIGID,
        {"coulomb": 1.3, "fading": 1.8, "viscous": 173.0},
        "no yes no no no",
    ),
    "frictional memory alone": (
        RIGID,
        {"coulomb": 1.3, "memory": 200.0},
        "no conditional yes no no",
    ),
    "memory the wrong way round": (
        RIGID,
        {"coulomb": 1.3, "memory": -200.0},
        "no conditional no no no",
    ),
    "a contact that ages": (
        RIGID,
        {"coulomb": 1.3, "ageing": 1.0},
        "yes conditional no yes no",
    ),
    "a spring that slides at 2 N": (SPRUNG, {}, "no conditional no no yes"),
    "a spring that is too soft": (
        SPRUNG,
        {"stiffness": 20e3},
        "no conditional no no no",
    ),
    "a spring that yields early": (
        SPRUNG,
        {"hardness": 1.0},
        "no conditional no no conditional",
    ),
}


def judged(what: str) -> dict[str, Cell]:
    """Decisions on a law of `MADE`, which is in the list of laws only while it runs."""
    law, values, _ = MADE[what]
    with mock.patch.dict(LAWS, {law: NAMES[law]}):
        return decide_features(observe(law, values))

"""What time moves again is not at rest, however still it stands at the end of a run."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import sympy as sp
from known_systems import maker

from ballscrew.orchestration.whole_loop import held_loop_kernel, term_name
from ballscrew.plant.with_friction import with_friction
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    ForceBalance,
    ForceTerm,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model
from ballscrew.stability.attractor import Kind
from ballscrew.stability.equilibria import is_driven, stands
from ballscrew.stability.lyapunov import lyapunov
from ballscrew.stability.signal_motion import signal_motion

W = 0.3
PERIOD = 2 * math.pi / W


@cache
def mass():
    """A unit mass on a unit spring with Coulomb friction F, pulled by cos(w t)."""
    body = Component(
        "mass",
        "a mass with a force",
        parameters=(Parameter("w", W, "rad/s", "frequency", "made up"),),
        states=(State("x", "m", "x", symbol("v")), State("v", "m/s", "v")),
        outputs=(Output("x", "m", "x", symbol("x")),),
        balances=(
            ForceBalance(
                "v",
                sp.Integer(1),
                (ForceTerm("force", sp.cos(symbol("w") * TIME) - symbol("x"), "force"),),
            ),
        ),
    )
    return generate(with_friction(body, "classical", {"sigma2": 0.0}))


def becomes(friction, periods, start=0.0):
    values = {"Fc": friction, "Fs": friction, "x_start": start}
    return lyapunov(maker(mass(), values), periods * PERIOD, 1e-9).motion


@pytest.mark.parametrize("periods", [2.0, 30.0, 30.05])
def test_a_mass_that_sticks_at_the_end_of_a_run_is_in_a_cycle_if_its_force_moves_it_again(periods):
    motion = becomes(0.6, periods)
    assert motion.kind is Kind.CYCLE, motion.evidence
    assert motion.period == pytest.approx(PERIOD, rel=1e-6)


def test_a_force_that_moves_it_for_a_short_part_of_each_period_moves_it():
    motion = becomes(0.95, 20.0)
    assert motion.kind is not Kind.LINE, motion.evidence


@pytest.mark.parametrize("start", [0.0, 0.04])
def test_a_mass_that_its_force_never_moves_is_stuck(start):
    motion = becomes(1.05, 20.0, start)
    assert motion.kind is Kind.LINE, motion.evidence
    assert motion.equilibrium.state[0] == start


@cache
def slow():
    """x' = a - x + swing cos(w t), and an integral of `fed` cos(w t)."""
    swing, fed = symbol("swing"), symbol("fed")
    force = sp.cos(symbol("w") * TIME)
    return generate(
        Component(
            "slow",
            "falls fast after a force that is slow",
            parameters=tuple(
                Parameter(n, value, "1", n, "made up")
                for n, value in (("w", 1e-4), ("swing", 0.0), ("fed", 0.0))
            ),
            states=(
                State("x", "1", "x", 1 - symbol("x") + swing * force),
                State("y", "1", "y", fed * force),
            ),
            outputs=(Output("x", "1", "x", symbol("x")),),
        )
    )


@pytest.mark.parametrize(
    ("values", "rests"),
    [
        ({}, True),
        ({"swing": 1e-12, "fed": 1e-14}, True),
        ({"swing": 1e-2}, False),
        ({"w": 1.0, "fed": 1e-2}, False),
    ],
)
def test_an_equilibrium_that_moves_with_time_is_none(values, rests):
    motion = lyapunov(maker(slow(), values), 1e3, 1e-9).motion
    assert (motion.kind is Kind.LINE) == rests, motion.evidence


@dataclass
class Course:
    """A run with one output."""

    time: np.ndarray
    outputs: dict
    stopped: str = ""
    diverged: bool = False


def steps(end, period):
    """It stands still but for a tenth of each period: it moves on, and back in the next."""
    time = np.linspace(0.0, end, 4001)
    ramp = np.clip((time % period) / (0.1 * period), 0.0, 1.0)
    odd = np.floor(time / period) % 2
    return Course(time, {"x": np.where(odd, 1.0 - ramp, ramp)})


@pytest.mark.parametrize("periods", [2.9, 1.95])
def test_signals_that_stood_as_long_before_and_moved_again_are_not_at_rest(periods):
    motion = signal_motion(steps(periods, 1.0), {"x": 1.0})
    assert motion.kind is Kind.UNDECIDED, motion.evidence


def test_signals_that_stand_longer_than_ever_are_at_rest():
    course = steps(10.0, 4.0)
    course.outputs["x"][course.time > 4.4] = 0.0
    assert signal_motion(course, {"x": 1.0}).kind is Kind.REST
    course.outputs["x"][course.time < 3.0] = course.outputs["x"][0]  # nor does the begin count
    assert signal_motion(course, {"x": 1.0}).kind is Kind.REST


@pytest.mark.parametrize("speed", [0.0, 1e-3])
def test_only_a_set_point_that_moves_is_asked_after_at_many_instants(speed, monkeypatch):
    kernel = held_loop_kernel("plant", "pid")
    model = Model(kernel, {}, 1e-6)
    names = [i.name for i in kernel.inputs]
    model.u[names.index("x_d")] = 0.08
    model.u[names.index(term_name("x_d", 1))] = speed
    model.advance(0.0, 60.0)
    asked = []
    derivatives = Model.derivatives
    monkeypatch.setattr(Model, "derivatives", lambda *a: asked.append(a) or derivatives(*a))
    assert stands(model, 60.0, 10.0, model.x, 1.0) == (speed == 0.0)
    assert is_driven(model, 60.0, 10.0) == (speed != 0.0)
    assert (len(asked) > 100) == (speed != 0.0)

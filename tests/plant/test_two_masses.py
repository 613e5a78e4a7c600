"""Two bodies and what joins them: inertia, momentum, the spring's mode, a gap that only pushes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.plant.ball_screw import ball_screw, bare_ball_screw
from ballscrew.plant.classical import classical
from ballscrew.plant.direct_drive import bare_direct_drive
from ballscrew.plant.two_masses import with_gap, with_spring
from ballscrew.solver.component import ForceTerm, symbol
from ballscrew.solver.errors import ContractError

pytestmark = pytest.mark.ci

GAP, STIFFNESS, SIDES, MASS = 2e-5, 1e6, 1e8, 2.0


def no_friction(velocity):
    return ForceTerm("friction", 0 * velocity, "no friction")


BARE = bare_direct_drive(no_friction)
JOINTS = {
    "spring": with_spring(BARE),
    "gap": with_gap(BARE),
    "spring, then gap": with_gap(with_spring(BARE)),
    "gap, then spring": with_spring(with_gap(BARE)),
}
VALUES = {"gap": GAP, "stiffness": STIFFNESS, "contact_stiffness": SIDES, "m": MASS}
VALUES |= {"gain": 1.0, "offset": 0.0, "u": 0.0}


def rates_of(plant):
    names = ("x", "v", "xb", "vb")
    table = {symbol(n): v for n, v in VALUES.items()}
    return sp.lambdify(
        [symbol(n) for n in names], [sp.sympify(plant.derivative(n)).subs(table) for n in names]
    )


RATES = {name: rates_of(plant) for name, plant in JOINTS.items()}


def pull(joint, longer, faster=0.0):
    """Force on the block [N]."""
    return 0.5 * MASS * float(RATES[joint](longer, faster, 0.0, 0.0)[3])


def screw(rotor=4.2e-7):
    axis = bare_ball_screw()
    parameters = (replace(p, default=rotor) if p.name == "Jm" else p for p in axis.parameters)
    return replace(axis, parameters=tuple(parameters))


metres = st.floats(-1e-4, 1e-4)
speeds = st.floats(-0.05, 0.05)


@pytest.mark.parametrize("joint", JOINTS)
@settings(max_examples=20, deadline=None)
@given(x=metres, xb=metres, v=speeds, vb=speeds)
def test_what_one_body_gains_in_momentum_the_other_loses(joint, x, xb, v, vb):
    _, near, _, far = RATES[joint](x, v, xb, vb)
    assert near == pytest.approx(-far, abs=1e-9)


def test_a_spring_swings_at_its_frequency_with_a_tenth_of_critical_damping():
    rates = RATES["spring"]
    step = 1e-9
    by_way = (rates(0.0, 0.0, step, 0.0)[3] - rates(0.0, 0.0, 0.0, 0.0)[3]) / step
    by_speed = (rates(0.0, 0.0, 0.0, step)[3] - rates(0.0, 0.0, 0.0, 0.0)[3]) / step
    frequency = math.sqrt(STIFFNESS / (0.5 * MASS))
    assert -by_way == pytest.approx(frequency**2, rel=1e-6)
    assert -by_speed == pytest.approx(2 * 0.1 * frequency, rel=1e-6)


@pytest.mark.parametrize("joint", ["gap", "spring, then gap", "gap, then spring"])
def test_within_the_gap_there_is_no_force(joint):
    for place in np.linspace(-0.499, 0.499, 11) * GAP:
        assert pull(joint, place, 0.01) == 0.0


@pytest.mark.parametrize("joint", ["gap", "spring, then gap"])
@settings(max_examples=30, deadline=None)
@given(depth=st.floats(0.0, 1e-5), faster=speeds)
def test_a_side_only_pushes(joint, depth, faster):
    assert pull(joint, 0.5 * GAP + depth, faster) >= 0.0
    assert pull(joint, -0.5 * GAP - depth, faster) <= 0.0


def test_a_side_is_as_stiff_and_damped_as_it_is_said_to_be():
    """Critically damped against half of the mass; the damping comes up over ten nanometres."""
    assert pull("gap", 0.5 * GAP + 1e-8) == pytest.approx(SIDES * 1e-8, rel=1e-6)
    damping = 2.0 * math.sqrt(SIDES * 0.5 * MASS) * 0.01 / 2.0
    assert pull("gap", 0.5 * GAP + 1e-8, 0.01) == pytest.approx(1.0 + damping, rel=1e-6)


def test_the_rotor_is_before_the_joint_and_the_block_with_its_friction_behind():
    parted = with_spring(screw())
    near, far = parted.balances
    angle = 2 * math.pi * 1000.0
    table = {symbol("Jm"): 4.2e-7, symbol("p"): 1000.0, symbol("m"): 1.3}
    assert float(near.inertia.subs(table)) == pytest.approx(4.2e-7 * angle**2, rel=1e-9)
    assert float(far.inertia.subs(table)) == pytest.approx(1.3)
    assert [t.name for t in near.terms] == ["motor", "joint"]
    assert [t.name for t in far.terms] == ["friction", "joint"]
    (friction,) = (t for t in far.terms if t.name == "friction")
    assert symbol("vb") in friction.force.free_symbols
    assert symbol("v") not in friction.force.free_symbols
    assert [o.name for o in parted.outputs][:4] == ["x", "v", "z", "i"]


@pytest.mark.parametrize("join", [with_spring, with_gap])
def test_a_screw_without_a_rotor_is_refused_with_what_to_do(join):
    with pytest.raises(ContractError, match=r"Jm is 0 .*give its inertia, Table 2\.1"):
        join(screw(rotor=0.0))


def test_a_plant_that_sticks_already_is_refused():
    with pytest.raises(ContractError, match="do this before adding sticking"):
        with_spring(ball_screw(classical))

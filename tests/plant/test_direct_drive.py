"""The drive without a motor against its printed equation; its limit; its sticking."""

import pytest

from ballscrew.plant.classical import classical
from ballscrew.plant.direct_drive import bare_direct_drive, direct_drive, with_command_limit
from ballscrew.solver.component import symbol

EMPS = {"m": 95.11, "gain": 35.15, "offset": -3.16, "sigma2": 203.5, "Fc": 20.39, "Fs": 25.0}
EMPS |= {"Vs": 1e-3, "sigma0": 1e6, "sigma1": 300.0, "Kv": 1e8}


def at(expression, **values):
    table = {symbol(n): v for n, v in (EMPS | values).items()}
    return float(expression.subs(table))


def test_force_is_gain_times_command_less_friction_and_offset():
    drive = direct_drive()
    state = {"x": 0.1, "v": 0.02, "z": 1e-5, "u": 3.0}
    friction = at(drive.output("friction").value, **state)
    expected = (EMPS["gain"] * 3.0 - friction - EMPS["offset"]) / EMPS["m"]
    assert at(drive.derivative("v"), **state) == pytest.approx(expected, rel=1e-12)
    assert friction > 10.0


@pytest.mark.ci
@pytest.mark.parametrize(("command", "moves"), [(0.60, False), (0.64, True)])
def test_sticks_until_the_command_exceeds_break_away_and_offset(command, moves):
    stuck = direct_drive(classical).modes[0]
    (forward,) = (e for e in stuck.events if e.name == "breaks away forward")
    assert EMPS["gain"] * 0.62 - EMPS["offset"] == pytest.approx(EMPS["Fs"], rel=0.01)
    assert (at(forward.indicator, u=command) > 0) == moves


@pytest.mark.ci
@pytest.mark.parametrize(("command", "arrives"), [(3.0, 2.0), (-3.0, -2.0), (1.5, 1.5)])
def test_a_limit_cuts_the_command_either_way(command, arrives):
    drive = with_command_limit(bare_direct_drive())
    (force,) = (t.force for t in drive.terms if t.name == "drive")
    assert at(force, u=command, voltage_limit=2.0) == pytest.approx(EMPS["gain"] * arrives)

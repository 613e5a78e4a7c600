"""The drive without a motor against its printed equation; its limit; its sticking."""

import pytest

from ballscrew.plant.direct_drive import bare_direct_drive, with_command_limit
from ballscrew.solver.component import symbol

EMPS = {"m": 95.11, "gain": 35.15, "offset": -3.16, "sigma2": 203.5, "Fc": 20.39, "Fs": 25.0}
EMPS |= {"Vs": 1e-3, "sigma0": 1e6, "sigma1": 300.0, "Kv": 1e8}


def at(expression, **values):
    table = {symbol(n): v for n, v in (EMPS | values).items()}
    return float(expression.subs(table))


@pytest.mark.ci
@pytest.mark.parametrize(("command", "arrives"), [(3.0, 2.0), (-3.0, -2.0), (1.5, 1.5)])
def test_a_limit_cuts_the_command_either_way(command, arrives):
    drive = with_command_limit(bare_direct_drive())
    (force,) = (t.force for t in drive.terms if t.name == "drive")
    assert at(force, u=command, voltage_limit=2.0) == pytest.approx(EMPS["gain"] * arrives)

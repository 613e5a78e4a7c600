"""The fuzzy controller: the rule table at its nodes, and the surface in between."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from ballscrew.controllers.fuzzy_pd_i import PEAKS, RULES, fuzzy_pd_i
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

DEFAULT = {p.name: p.default for p in fuzzy_pd_i().parameters}
NODES = [float(p) for p in PEAKS]


@pytest.fixture(scope="module")
def command():
    model = Model(fmu_kernel("fuzzy_pd_i"))

    def at(error, speed):
        """Of a scaled error and a scaled speed reversed."""
        model.set_input("x_d", error * DEFAULT["range_e"])
        model.set_input("v", -speed * DEFAULT["range_v"])
        return model.outputs(0.0, model.x)["u"]

    return at


def test_between_the_nodes_it_is_bilinear_and_beyond_them_it_stays(command):
    table = RegularGridInterpolator((NODES, NODES), np.array(RULES, dtype=float))
    random = np.random.default_rng(0)
    for e, s in random.uniform(-1.5, 1.5, (300, 2)):
        wanted = DEFAULT["full"] * table(np.clip([e, s], -1, 1))[0]
        assert command(e, s) == pytest.approx(wanted, abs=1e-9)

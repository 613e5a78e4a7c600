"""All components of the catalogue, in the three tiers.

The first have states, modes, samples, limits and the feedback law. CI adds an observer and an
instrument, among others; the rest takes hours.
"""

import pytest

from ballscrew.controllers import CONTROLLERS
from ballscrew.orchestration.loop.catalogue import NAMES

FIRST = "plant", "plant_classical", "pid_sampled"
MORE = "nctf", "plant_maxwell_slip", "iol", "iol_observed", "relay", "position_encoder"


def in_tiers(names):
    marks = {n: pytest.mark.ci if n in MORE else pytest.mark.prove for n in names}
    return [n if n in FIRST else pytest.param(n, marks=marks[n]) for n in names]


EVERY_COMPONENT = in_tiers(NAMES)
EVERY_CONTROLLER = in_tiers(CONTROLLERS)

# representative controllers, for tests that generate and compile each loop, which takes seconds
IN_LOOPS = "iol iol_true_acceleration nctf pid pid_sampled iol+sampled p_pi relay".split()
IN_LOOPS += ["pid_sampled+position_encoder"]

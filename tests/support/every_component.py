"""All components of the catalogue; those outside a sample take long and are for ``make prove``.

The sample has components with and without states, modes, samples, limits, a feedback law, an
observer, events.
"""

import pytest

from ballscrew.controllers import CONTROLLERS
from ballscrew.fmus.catalogue import NAMES

SAMPLE = (
    "plant plant_classical plant_maxwell_slip iol nctf pid pid_sampled iol_observed relay "
    "position_encoder"
).split()


def sampled(names):
    return [n if n in SAMPLE else pytest.param(n, marks=pytest.mark.long) for n in names]


EVERY_COMPONENT = sampled(NAMES)
EVERY_CONTROLLER = sampled(CONTROLLERS)

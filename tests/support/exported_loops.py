"""Representative controllers, for tests that generate and compile each loop.

This takes seconds per loop. Two of the laws after ``pid_encoder`` in the list have properties that
none before has: references in addition to the set-point, and modes. As parts, all controllers are
in every suite.
"""

from ballscrew.controllers import CONTROLLERS

_NAMES = [*CONTROLLERS]
IN_LOOPS = [*_NAMES[: _NAMES.index("pid_encoder") + 1], "p_pi", "relay"]

"""Controllers whose whole loops stand for all, where each loop is generated and compiled.

That takes seconds for each. Of the laws that follow ``pid_encoder`` in the list, two have what none
before has: references beside the set-point, and modes. As parts, all go through every suite.
"""

from ballscrew.controllers import CONTROLLERS

_NAMES = [*CONTROLLERS]
IN_LOOPS = [*_NAMES[: _NAMES.index("pid_encoder") + 1], "p_pi", "relay"]

"""Friction, co-simulation and stability of a ball-screw axis."""

import os.path

__version__ = "0.1.0"

# Installed, the parts stand inside this package. In a checkout they stand beside it, and Python
# started there finds this folder first.
if not os.path.isdir(os.path.join(__path__[0], "solver")):
    __path__.append(os.path.dirname(__path__[0]))

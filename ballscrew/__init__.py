"""Friction, co-simulation and stability of a ball-screw axis."""

__version__ = "0.1.0"

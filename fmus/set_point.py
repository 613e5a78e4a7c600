"""Names of the inputs by which a controller is told what to follow."""

SET_POINT = "x_d"
START_VALUE = 0.08  # [m] of loops and systems, so that their default run shows the nominal step
DERIVATIVES = {"v_d": 1, "a_d": 2}
"""Inputs for feed-forward, and the order of the set-point's derivative that each takes."""

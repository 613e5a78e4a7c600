"""Names of a controller's set-point inputs."""

SET_POINT = "x_d"
START_VALUE = 0.08  # [m] for loops and systems, so that their default run is the nominal step
DERIVATIVES = {"v_d": 1, "a_d": 2}
"""Inputs for feed-forward, and the order of the set-point's derivative of each."""

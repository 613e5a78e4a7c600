"""The set-point of a controller: names of the inputs that take it."""

from collections.abc import Sequence

SET_POINT = "x_d"
START_VALUE = 0.08  # [m] for loops and systems, so that their default run is the nominal step
DERIVATIVES = {"v_d": 1, "a_d": 2}
"""Inputs for feed-forward, and the order of the set-point's derivative of each."""
MEASURED = "_measured"  # ends the name of what an instrument gives of a signal
REFERENCES = ("reference", "reference_derivative")  # roles in a component


def set_point_orders(names: Sequence[str]) -> dict[str, int]:
    """Which of these inputs take the set-point (0) or its derivatives, and the order of each.

    An FMU has names and no roles, so names decide: ``x_d`` is the set-point, ``v_d`` and ``a_d``
    beside it are its derivatives; without ``x_d`` the only input is the set-point. Empty if it is
    not clear.
    """
    if names.count(SET_POINT) == 1:
        return {n: order for n, order in {SET_POINT: 0, **DERIVATIVES}.items() if n in names}
    return dict.fromkeys(names, 0) if len(names) == 1 else {}

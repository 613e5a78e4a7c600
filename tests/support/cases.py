"""Small inputs from public reports that once failed, and what tests of them share."""

from __future__ import annotations

from pathlib import Path

import case_inputs
import numpy as np
from scipy.linalg import expm


def case(name: str, folder: Path) -> Path:
    """A new folder in this one with the files of a case."""
    made = folder / name
    made.mkdir()
    getattr(case_inputs, name)(made)
    return made


def cart_position(t: float, setpoint: float = 0.1, m: float = 1.0) -> float:
    """Position [m] of the cases' cart under their PD controller: the exact solution.

    m x'' = u - 2 x', u = 25 (setpoint - x) - 8 x', from rest at 0.
    """
    moved = expm(np.array([[0.0, 1.0], [-25.0 / m, -10.0 / m]]) * t) @ np.array([-setpoint, 0.0])
    return float(setpoint + moved[0])


def trajectory(folder: Path) -> np.ndarray:
    """The signals of a run by name."""
    return np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True)

"""Dahl friction against the solution of its equation."""

import numpy as np
import pytest
from prescribed_motion import prescribed_friction, ways

SIGMA, FC = 87750.0, 2.0


def course(alpha=1.0, sign=1.0):
    grid = np.linspace(0, 0.1, 201)
    return prescribed_friction(
        "dahl", grid, np.full(201, sign * 1e-3), {"alpha": alpha}, tolerance=1e-10
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_from_rest_is_eq_2_5_and_2_6_with_their_signs_corrected(sign):
    """F = +-Fc (1 - exp(-sigma |x| / Fc)); printed, 2.5 has a growing exponential."""
    got = course(sign=sign)
    exact = sign * FC * (1 - np.exp(-SIGMA * np.abs(got.outputs["x"]) / FC))
    np.testing.assert_allclose(got.outputs["friction"], exact, atol=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 0.5, 2.0])
def test_any_exponent_follows_the_solution_of_its_equation(alpha):
    """(1 - F/Fc)^(1 - alpha) = 1 - (1 - alpha) sigma x/Fc, and Fc once that has reached zero."""
    got = course(alpha)
    left = np.maximum(1 - (1 - alpha) * SIGMA * got.outputs["x"] / FC, 0.0)
    exact = FC * (1 - left ** (1 / (1 - alpha)))
    np.testing.assert_allclose(got.outputs["friction"], exact, atol=1e-5 * FC)


def test_friction_put_outside_its_bounds_comes_back():
    for alpha in (0.5, 1.0, 2.0):
        start = {"alpha": alpha, "z_start": 1.2 * FC / SIGMA}
        friction = prescribed_friction("dahl", *ways((1e-3, 5e-3)), start).outputs["friction"]
        assert friction[0] == pytest.approx(1.2 * FC)
        assert friction[-1] == pytest.approx(FC, rel=5e-3)

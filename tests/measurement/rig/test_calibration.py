"""The calibration of the capacitance sensor: right within what it states, and no better."""

import numpy as np

from ballscrew.measurement.rig.setup import POINTS, calibrate

EPSILON_AREA = 8.854e-12 * 1e-4


def capacitance(x, separation):
    return EPSILON_AREA / (separation + x)


def test_a_true_quadratic_is_found_exactly():
    c = np.linspace(4e-12, 6e-12, 8)
    x = 3e-4 - 9e-5 * c / 1e-12 + 6e-6 * (c / 1e-12) ** 2
    found = calibrate(c, x)
    np.testing.assert_allclose(found.coefficients, [3e-4, -9e-5, 6e-6], rtol=1e-9)
    np.testing.assert_allclose(found.displacement(c), x, atol=1e-15)
    assert found.error < 1e-13


def test_what_a_quadratic_cannot_follow_is_less_than_the_micrometers_error_and_is_stated():
    for separation in (140e-6, 150e-6, 160e-6):
        found = calibrate(capacitance(POINTS, separation))
        x = np.linspace(0, 70e-6, 701)
        off = np.abs(found.displacement(capacitance(x, separation)) - x)
        assert 1e-7 < off.max() < 0.5e-6
        assert off.max() < 1.2 * found.error


def test_the_displacement_is_within_its_stated_error_at_the_stated_rate():
    """95 % intervals, with half a micrometre of error in each setting of the micrometer."""
    rng = np.random.default_rng(5)
    x = np.linspace(0, 70e-6, 29)
    inside = []
    for _ in range(2000):
        separation = 150e-6 + rng.uniform(-10e-6, 10e-6)
        moved = POINTS + 0.5e-6 * rng.standard_normal(len(POINTS))
        found = calibrate(capacitance(moved, separation))
        c = capacitance(x, separation)
        inside.append(np.abs(found.displacement(c) - x) <= found.uncertainty(c))
    rate = np.mean(inside)
    assert 0.93 < rate < 0.97

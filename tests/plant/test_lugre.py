"""LuGre friction and its relatives: exact solutions, and where they are not passive."""

import math

import numpy as np
import pytest
from prescribed_motion import prescribed_friction, ways

from ballscrew.plant.directional_lugre import PARAMETERS as DIRECTIONAL

S0, S1, S2, FC, FS, VS = 66967.231, 344.56, 173.0, 1.284, 2.35, 1.13975e-3


def g(v):
    return FC + (FS - FC) * np.exp(-((v / VS) ** 2))


@pytest.mark.parametrize(("name", "bound"), [("lugre", 1e-8), ("modified_lugre", 1e-4)])
@pytest.mark.parametrize("v", [2e-4, -5e-3])
def test_at_a_constant_velocity_the_deflection_decays_to_its_end_as_an_exponential(name, bound, v):
    grid = np.linspace(0, 5 * g(v) / S0 / abs(v), 101)
    got = prescribed_friction(name, grid, np.full(101, v), tolerance=1e-10).outputs
    z = math.copysign(g(v) / S0, v) * (1 - np.exp(-S0 * abs(v) * grid / g(v)))
    friction = S0 * z + S1 * (v - S0 * abs(v) / g(v) * z) + S2 * v
    np.testing.assert_allclose(got["z"], z, atol=bound * FS / S0)
    np.testing.assert_allclose(got["friction"], friction, atol=bound * FS)


def test_the_nominal_lugre_law_is_not_passive():
    """Bent slowly, then a pulse of 2 m/s over ten micrometres: more work comes out than went in."""
    motion = ways((1e-4, 1.1e-4), (2.0, 9.6e-6))
    assert prescribed_friction("lugre", *motion).outputs["work"][-1] < -3e-4
    limit = S2 * FC / (FS - FC)
    assert prescribed_friction("lugre", *motion, {"sigma1": limit}).outputs["work"][-1] > 0


def test_the_modified_law_gives_out_work_to_motion_slower_than_its_sign_function():
    """Bent by 10 um in a second, let go of at a nanometre per second; LuGre's own |v| does not."""
    motion = ways((1e-5, 1e-5), (-1e-9, 1e-5))
    assert prescribed_friction("modified_lugre", *motion).outputs["work"][-1] < -2e-6
    assert prescribed_friction("lugre", *motion).outputs["work"][-1] > 0


def test_with_both_directions_alike_the_directional_law_is_the_modified_one():
    same = {p.name: v for p in DIRECTIONAL for n, v in NOMINAL.items() if p.name[:-4] == n}
    assert len(same) == 12
    grid = np.linspace(0, 2.0, 801)
    velocity = 2e-3 * np.sin(9 * grid)
    one = prescribed_friction("directional_lugre", grid, velocity, same).outputs["friction"]
    other = prescribed_friction("modified_lugre", grid, velocity).outputs["friction"]
    np.testing.assert_allclose(one, other, atol=1e-7)


NOMINAL = {"sigma0": S0, "sigma1": S1, "sigma2": S2, "Fc": FC, "Fs": FS, "Vs": VS}
TABLE_2_3 = {
    1: {"Fc": 1.11, "Fs": 2.3, "Vs": 0.001943, "sigma2": 193.4},
    -1: {"Fc": 1.458, "Fs": 2.4, "Vs": 0.0003365, "sigma2": 152.6},
}


@pytest.mark.parametrize("direction", [1, -1])
def test_each_direction_slides_on_its_own_column_of_table_2_3(direction):
    q = TABLE_2_3[direction]
    for speed in (2e-4, 1e-3, 5e-3):
        curve = q["Fc"] + (q["Fs"] - q["Fc"]) * math.exp(-((speed / q["Vs"]) ** 2))
        course = prescribed_friction("directional_lugre", *ways((direction * speed, 2e-3)))
        expected = direction * (curve + q["sigma2"] * speed)
        assert course.outputs["friction"][-1] == pytest.approx(expected, rel=1e-4)


def test_different_stiffness_by_side_gives_out_no_work_in_a_small_swing():
    """The stiffness goes with the side on which the bristles are bent, not with the motion."""
    values = {"sigma0_pos": 1e5, "sigma0_neg": 5e4, "sigma1_pos": 0.0, "sigma1_neg": 0.0}
    grid = np.linspace(0, 20.0, 20001)
    course = prescribed_friction("directional_lugre", grid, 1e-5 * np.cos(2 * np.pi * grid), values)
    assert np.min(np.diff(course.outputs["work"][::1000])) > 0
    jumps = np.abs(np.diff(course.outputs["friction"]))
    assert np.max(jumps) < 2 * 1e5 * 1e-5 * 1e-3

"""The official Reference FMUs, compiled from their sources, against their published results."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from reference_fmus import reference_fmu, reference_result
from scipy.integrate import solve_ivp

from ballscrew.orchestration.isolated import IsolatedInstance

MODELS = ("BouncingBall", "Dahlquist", "VanDerPol", "Stair", "Resource", "Feedthrough")


def course(path, times, values=None):
    """Outputs at the times, by name."""
    instance = IsolatedInstance(path, "instance")
    try:
        instance.initialize(values or {}, times[-1])
        read = instance.reader(instance.outputs)
        rows = [read()]
        for t, end in itertools.pairwise(times):
            instance.step(t, end - t)
            rows.append(read())
    finally:
        instance.close()
    return dict(zip(instance.outputs, np.array(rows).T, strict=True))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", MODELS)
def test_co_simulation_of_a_reference_fmu_gives_its_published_result(tmp_path, name, fmi):
    """Their solver is Euler's, and so are their results: the same to the last bits."""
    path = reference_fmu(tmp_path, name, fmi)
    expected = reference_result(name)
    found = course(path, expected["time"])
    assert found.keys() == expected.keys() - {"time"} or fmi == 2
    for output, values in found.items():
        np.testing.assert_allclose(values, expected[output], rtol=1e-12, atol=1e-12)


def falling(times, g=9.81, e=0.7, v_min=0.1):
    """Height of the ball of the reference model, bounce by bounce."""
    heights, t, h, v = [], 0.0, 1.0, 0.0
    for time in times:
        while g and (hit := (v + np.sqrt(v * v + 2 * g * h)) / g) <= time - t:
            t, h, v = t + hit, 0.0, e * (g * hit - v)
            if v < v_min:
                g = v = 0.0
        heights.append(h + v * (time - t) - g * (time - t) ** 2 / 2)
    return np.array(heights)


def van_der_pol(times):
    def slope(_, x):
        return [x[1], (1 - x[0] ** 2) * x[1] - x[0]]

    return solve_ivp(slope, (0, times[-1]), [2, 0], "DOP853", times, rtol=1e-12, atol=1e-12).y[0]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "output", "exact", "euler"),
    [
        ("BouncingBall", "h", falling, 0.03),
        ("Dahlquist", "x", lambda t: np.exp(-t), 0.02),
        ("VanDerPol", "x0", van_der_pol, 0.4),
    ],
)
def test_model_exchange_of_a_reference_fmu_is_the_exact_solution(
    tmp_path, name, output, exact, euler, fmi
):
    """The published results are Euler's with large steps; exact solutions are as far from them."""
    published = reference_result(name)
    times = published["time"]
    found = course(reference_fmu(tmp_path, name, fmi, exchanges=True), times)[output]
    np.testing.assert_allclose(found, exact(times), rtol=0, atol=2e-6)
    np.testing.assert_allclose(found, published[output], rtol=0, atol=euler)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", ["Stair", "Resource", "Feedthrough"])
def test_model_exchange_without_continuous_states_gives_the_published_result(tmp_path, name, fmi):
    expected = reference_result(name)
    found = course(reference_fmu(tmp_path, name, fmi, exchanges=True), expected["time"])
    for output, values in found.items():
        np.testing.assert_array_equal(values, expected[output])

"""The official Reference FMUs, compiled from their sources, against their published results."""

import itertools
import re

import numpy as np
import pytest
from reference_fmus import reference_fmu, reference_result

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance, StepFailed
from ballscrew.orchestration.fmu.isolated import IsolatedInstance

pytestmark = pytest.mark.ci  # their sources are not part of this project

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


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "output", "exact", "euler"),
    [("BouncingBall", "h", falling, 0.03), ("Dahlquist", "x", lambda t: np.exp(-t), 0.02)],
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


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("Int32_input", 0.5, "Int32_input is of type Int32 and was given 0.5, expected a whole"),
        ("Int8_input", 128.0, "Int8_input is of type Int8 and was given 128, expected a whole"),
        ("Int64_input", 2.0**63, "was given 9.22337e+18, expected a whole number in its range"),
        ("Boolean_input", 2.0, "Boolean_input is of type Boolean and was given 2, expected 0 or 1"),
    ],
)
def test_values_that_a_type_does_not_hold_are_refused(tmp_path, name, value, message):
    instance = FmuInstance(reference_fmu(tmp_path, "Feedthrough", 3), "feedthrough")
    instance.initialize({}, 1.0)
    with pytest.raises(StepFailed, match=re.escape(message)):
        instance.writer([name])(np.array([value]))
    instance.close()


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("slope", "message"),
    [
        ('logError(comp, "no slope"); return Error;', "failed with status 3 (error): no slope"),
        ("dx[0] = 0.0 / 0.0; return OK;", "CVODE failed: At t = 0.5"),
        ("dx[0] = M(x) * M(x) * 1e9; return OK;", "CVODE "),
    ],
)
def test_equations_that_fail_end_the_run_in_words_and_print_nothing(
    tmp_path, capfd, slope, message, fmi
):
    old = b"dx[0] = M(der_x);"
    change = (old, f"if (comp->time > 0.5) {{ {slope} }} {old.decode()}".encode())
    path = reference_fmu(tmp_path, "Dahlquist", fmi, exchanges=True, change=change)
    instance = FmuInstance(path, "part")
    instance.initialize({}, 1.0)
    for k in range(5):
        instance.step(k * 0.1, 0.1)
    with pytest.raises(StepFailed) as failed:
        instance.step(0.5, 0.1)
    assert message in str(failed.value)
    assert "\n" not in str(failed.value)
    instance.close()
    assert capfd.readouterr() == ("", "")

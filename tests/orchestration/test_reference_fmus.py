"""The official Reference FMUs, compiled from their sources, against their published results."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from reference_fmus import reference_fmu, reference_result

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

"""The plant's FMU alone, driven by fmpy's simulate_fmu."""

import numpy as np
import pytest
from wired_loop import HOSTS, OUTPUTS, ask

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance

STEP = 2e-3
VOLTS = [20.0] * 50 + [-30.0] * 100 + [12.0] * 50 + [0.0] * 50  # in each step


def test_simulate_fmu_drives_the_plant_forth_back_and_to_a_halt(fmus):
    """It holds inputs for a step, and so does an instance that gets the same inputs here."""
    times = np.arange(len(VOLTS) + 1) * STEP
    corners = [k for k in range(1, len(VOLTS)) if VOLTS[k] != VOLTS[k - 1]]
    ends = [0, *[k for k in corners for _ in range(2)], len(VOLTS)]
    levels = [u for k in (0, *corners) for u in [VOLTS[k]] * 2]
    series = {"time": times[ends].tolist(), "u": levels}
    job = {"fmu": str(fmus["plant"]), "series": series, "step": STEP, "stop": times[-1]}
    course = ask(HOSTS / "simulate_fmu_host.py", job | {"outputs": list(OUTPUTS)})
    plant = FmuInstance(fmus["plant"], "plant")
    plant.initialize({}, times[-1])
    read, write = plant.reader(OUTPUTS), plant.writer(["u"])
    rows = [read()]
    for t, u in zip(times, VOLTS, strict=False):
        write(np.array([u]))
        plant.step(t, STEP)
        rows.append(read())
    plant.close()
    np.testing.assert_allclose(course["time"], times, atol=1e-12)
    for name, expected in zip(OUTPUTS, np.array(rows).T, strict=True):
        assert course[name] == pytest.approx(expected, abs=1e-8 * np.ptp(expected)), name
    assert min(course["v"]) < -0.05 < 0.05 < max(course["v"])

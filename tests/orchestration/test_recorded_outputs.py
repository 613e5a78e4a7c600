"""All outputs of a controller are in the table, whatever their type."""

import numpy as np
import pytest
from pythonfmu.builder import FmuBuilder

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.run import run_closed_loop

COUNTING = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Integer, Real


class Counting(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.x_d = self.u = self.error = 0.0
        self.steps = 7
        for name in ("x", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("error", "u"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.register_variable(Integer("steps", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.steps += 1
        self.error = self.x_d - self.x
        self.u = 400.0 * self.error
        return True
"""


@pytest.mark.parametrize("coupling", [None, Coupling.GAUSS_SEIDEL])
def test_other_outputs_of_a_controller_are_recorded_beside_its_command(tmp_path, coupling):
    script = tmp_path / "counting.py"
    script.write_text(COUNTING)
    FmuBuilder.build_FMU(script, dest=tmp_path / "Counting.fmu")
    result = run_closed_loop(
        Loop(str(tmp_path / "Counting.fmu"), stop=0.01, step=1e-3, coupling=coupling)
    )
    run = result.run
    np.testing.assert_array_equal(400.0 * run.others["controller.error"], run.commands["u"])
    np.testing.assert_array_equal(np.diff(run.others["controller.steps"][:-1]), 1.0)
    header = next(iter(result.trajectory_csv())).decode().strip().split(",")
    assert header[-3:] == ["x_d", "controller.error", "controller.steps"]

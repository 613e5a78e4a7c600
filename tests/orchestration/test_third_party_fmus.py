"""FMUs that are not ours: other names of ports, probing, and what happens without saved states."""

import textwrap

import numpy as np
import pytest
from pythonfmu.builder import FmuBuilder

from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.orchestration.wiring import WiringError

SCRIPT = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.position = 0.0
        self.speed = 0.0
        self.goal = 0.0
        self.voltage = 0.0
        for name in ("position", "speed", "goal"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("voltage", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.voltage = {gain} * (self.goal - self.position) - 2.0 * self.speed
        return True
"""
MAP = {"position": "x", "speed": "v", "goal": "x_d", "voltage": "u"}


@pytest.fixture(scope="module")
def third_party(tmp_path_factory):
    """A controller somebody wrote with pythonfmu alone: it answers in its step, reports nothing."""
    folder = tmp_path_factory.mktemp("third_party")

    def build(name, saves, gain=400.0):
        script = folder / f"script_{name.lower()}.py"
        script.write_text(textwrap.dedent(SCRIPT.format(name=name, gain=gain)))
        path = folder / f"{name}.fmu"
        options = {"canGetAndSetFMUstate": True} if saves else {}
        FmuBuilder.build_FMU(script, dest=path, **options)
        return str(path)

    return build


@pytest.fixture(scope="module")
def finely(third_party):
    """The same at a tenth of the step, in this process, where that is a matter of seconds."""

    def run(name, saves):
        fine = Loop(third_party(name, saves), mapping=MAP, stop=1.0, step=1e-4, isolate=False)
        return run_closed_loop(fine).run

    return run


def test_a_stranger_that_reports_no_derivatives_is_probed(third_party, finely):
    result = run_closed_loop(
        Loop(third_party("Probed", True), mapping=MAP, stop=1.0, step=1e-3)
    ).run
    assert result.coupling is Coupling.INTERFACE_JACOBIAN
    assert "probed" in result.coupling_reason
    assert result.verdict.trusted
    assert set(result.commands) == {"u"}  # under our names, so that the figures can be computed
    fine = finely("Probed2", True)
    off = np.abs(result.outputs["x"] - fine.outputs["x"][::10]).max()
    assert off < 2 * result.verdict.error_estimate["x"] + 1e-7


def test_a_stranger_that_cannot_be_taken_back_is_held_and_judged_by_smaller_steps(
    third_party, finely
):
    result = run_closed_loop(Loop(third_party("Held", False), mapping=MAP, stop=1.0, step=1e-3)).run
    assert "its command is held" in result.coupling_reason
    assert result.effect_rate_max == {}
    assert np.isfinite(result.verdict.contraction)
    fine = finely("Held2", False)
    off = np.abs(result.outputs["x"] - fine.outputs["x"][::10]).max()
    assert 0.5 * off < result.verdict.error_estimate["x"] < 10 * off + 1e-9
    assert result.verdict.trusted == (result.verdict.error_estimate["x"] < 1e-2 * 0.08) or not (
        result.verdict.trusted
    )


def test_ports_that_do_not_match_are_named_with_the_nearest(third_party):
    path = third_party("Unmapped", True)
    with pytest.raises(WiringError, match=r"nothing is connected to the input 'u'.*voltage.*--map"):
        run_closed_loop(Loop(path, stop=0.01, step=1e-3))
    with pytest.raises(WiringError, match=r"has no input that fits"):
        run_closed_loop(Loop(path, mapping={"voltage": "u"}, stop=0.01, step=1e-3))
    with pytest.raises(WiringError, match=r"neither side has a port 'positoin'; nearest: position"):
        run_closed_loop(Loop(path, mapping={"positoin": "x"}, stop=0.01, step=1e-3))


COUNTER = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.position = 0.0
        self.voltage = 0.0
        self.register_variable(Real("position", causality=Fmi2Causality.input))
        self.register_variable(Real("voltage", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        assert current_time + step_size < 0.0101
        self.voltage += 0.125
        return True
"""


def test_a_controller_that_cannot_be_taken_back_is_stepped_once_a_step_and_never_past_the_end(
    tmp_path,
):
    script = tmp_path / "script_counter.py"
    script.write_text(COUNTER.format(name="Counter"))
    FmuBuilder.build_FMU(script, dest=tmp_path / "Counter.fmu")
    study = Loop(
        str(tmp_path / "Counter.fmu"),
        mapping={"position": "x", "voltage": "u"},
        stop=0.01,
        step=1e-3,
        coupling=Coupling.GAUSS_SEIDEL,
    )
    run = run_closed_loop(study).run
    assert run.stopped == ""
    np.testing.assert_array_equal(run.commands["u"][:-1], 0.125 * np.arange(1, 11))

"""Systems of more than two FMUs against the whole of them in one solver of SciPy's."""

import numpy as np
import pytest
import small_fmus
from networks_of_parts import (
    CUT_IN_THREE,
    LAW_WIRES,
    PERIOD,
    TWO_AXES,
    axis,
    friction,
    motor,
    position_controller,
    screw,
    two_axis_controller,
    whole_axes,
    whole_drive,
    write_system,
)
from pythonfmu.builder import FmuBuilder
from runner import stored
from verdict import networks
from verdict.parts import deceived, wrong

from ballscrew.fmus.native.export import export_native
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import SystemLoop
from ballscrew.orchestration.master.couplings import Coupling


def off(found, truth):
    """Largest difference as a share of the range."""
    return np.abs(found - truth).max() / np.ptp(truth)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """The drive's .ssp without and with its friction's law ports wired."""
    folder = tmp_path_factory.mktemp("drive")
    parts = {"motor": motor, "screw": screw, "friction": friction}
    fmus = {n: export_native(made(), folder / f"{n}.fmu").path for n, made in parts.items()}
    fmus["controller"] = export_native(position_controller(), folder / "controller.fmu").path
    return {
        wired: write_system(folder / f"{wired}.ssp", fmus, [*CUT_IN_THREE, *law])
        for wired, law in {"plain": (), "law": LAW_WIRES}.items()
    }


@pytest.mark.parametrize("wired", ["law", pytest.param("plain", marks=pytest.mark.ci)])
def test_a_plant_cut_in_motor_screw_and_friction_is_the_whole_plant(drive, wired):
    run = run_closed_loop(SystemLoop(drive[wired], stop=0.3)).run
    assert run.coupling is Coupling.INTERFACE_JACOBIAN  # the law acts within the screw
    assert run.verdict.trusted
    truth = whole_drive(run.time)
    assert off(run.outputs["x"], truth[:, 0]) < 0.01
    assert off(run.outputs["v"], truth[:, 1]) < 0.01


@pytest.mark.ci
def test_two_axes_on_one_digital_controller(tmp_path):
    side = export_native(axis(), tmp_path / "axis.fmu").path
    elements = {
        "controller": export_native(two_axis_controller(), tmp_path / "controller.fmu").path,
        "left": side,
        "right": side,
    }
    path = write_system(tmp_path / "axes.ssp", elements, TWO_AXES)
    run = run_closed_loop(SystemLoop(path, stop=1.0, values={"right.m": 2.5})).run
    assert run.verdict.trusted
    assert run.sampling_period == PERIOD
    truth = whole_axes(run.time, (1.0, 2.5))
    at_samples = np.isclose(run.time / PERIOD, np.round(run.time / PERIOD), atol=1e-6)
    found = [run.outputs["x"], run.outputs["v"], run.others["right.x"], run.others["right.v"]]
    for course, exact in zip(found, truth.T, strict=True):
        assert off(course[at_samples], exact[at_samples]) < 0.01


# random networks, see proofs/verdict/networks.py


@pytest.mark.ci
def test_random_networks_made_again_end_as_stored_and_no_wrong_one_is_trusted(tmp_path):
    rows, fmus = stored("networks")["again"], networks.blocks(tmp_path)
    again = [networks.outcome(row["seed"], fmus) for row in rows]
    assert [o["trusted"] for o in again] == [row["trusted"] for row in rows]
    assert [o["error"] for o in again] == pytest.approx([row["error"] for row in rows], rel=1e-3)
    assert not deceived(again)
    assert any(map(wrong, again))


# parameters that are Strings or of an Enumeration

WORDED = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class Worded(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.law, self.sign = 0.0, "none", 1
        self.register_variable(Real("x", causality=Fmi2Causality.input))
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(String("law", **fixed))
        self.register_variable(Integer("sign", **fixed))
        self.register_variable(
            Real("u", causality=Fmi2Causality.output, getter=lambda: self.gain() * (0.05 - self.x))
        )

    def gain(self):
        return {"none": 0.0, "weak": 100.0, "as strong": 200.0}[self.law] * (-1.0) ** self.sign

    def do_step(self, current_time, step_size):
        return True
"""
# what pythonfmu cannot write
ENUMERATION = """<TypeDefinitions><SimpleType name="Sign"><Enumeration>
<Item name="minus" value="1"/><Item name="plus" value="2"/></Enumeration></SimpleType>
</TypeDefinitions><ModelVariables>"""


def with_words(folder):
    """An FMU u = gain (0.05 - x), whose gain has a name and whose sign is of an enumeration."""
    (folder / "worded.py").write_text(WORDED)
    FmuBuilder.build_FMU(folder / "worded.py", dest=folder / "Worded.fmu")
    integer = "<Integer", '<Enumeration declaredType="Sign"'
    small_fmus.edited(str(folder / "Worded.fmu"), integer, ("<ModelVariables>", ENUMERATION))
    return folder / "Worded.fmu"


@pytest.mark.ci
def test_a_parameter_set_gives_a_text_and_an_item_by_its_name(tmp_path):
    wires = "axis.x -> ctl.x", "ctl.u -> axis.u"
    values = {"ctl": {"law": ("String", "as strong"), "sign": ("Enumeration", "plus")}}
    elements = {"axis": fmu("plant"), "ctl": with_words(tmp_path)}
    path = write_system(tmp_path / "set.ssp", elements, wires, values)

    def gain(**more):
        run = run_closed_loop(SystemLoop(path, stop=0.002, step=1e-3, **more)).run
        return float(run.commands["u"][0]) / 0.05

    assert gain() == gain(isolate=False) == pytest.approx(200.0)
    assert gain(values={"ctl.law": "weak", "ctl.sign": "minus"}) == pytest.approx(-100.0)
    assert gain(values={"ctl.sign": 1}) == pytest.approx(-200.0)

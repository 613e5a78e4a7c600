"""Units that two FMUs declare are converted between them, or refused; never passed over.

The exact solution is that of the loop in metres and newtons.
"""

import numpy as np
import pytest
import small_fmus
from case_inputs import DEFINED, UNITS, cart_in, pd_in, system
from cases import cart_position

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop, SystemLoop
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.reference_signal import Reference

GOAL = Reference.constant(0.1)


def pair(folder, plant, controller):
    cart_in(folder, **plant)
    pd_in(folder, **controller)


def followed(folder):
    """The run of both FMUs, in this process."""
    names = str(folder / "pd.fmu"), str(folder / "cart.fmu")
    return run_closed_loop(Loop(*names, GOAL, stop=0.5, step=1e-3, isolate=False))


@pytest.mark.parametrize(
    ("plant", "controller"),
    [
        # what the plant measures, what the controller measures, the set-point
        ({"x": "mm"}, {"x": "m", "x_d": "m"}),
        ({"x": "m"}, {"x": "m", "x_d": "mm"}),
        ({"x": "mm"}, {"x": "mm", "x_d": "mm"}),
        ({"x": "mm"}, {"x": "m"}),
        ({"x": "deg", "v": "rpm"}, {"x": "rad", "v": "rad/s", "x_d": "deg"}),
        ({"u": "kN", "x": "m"}, {"u": "N", "x": "mm"}),
    ],
)
def test_what_both_declare_is_converted_wherever_it_is(tmp_path, plant, controller):
    pair(tmp_path, plant, controller)
    result = followed(tmp_path)
    run = result.run
    x, v, u = (UNITS[plant[n]][1] if n in plant else 1.0 for n in ("x", "v", "u"))
    assert result.trusted
    assert run.outputs["x"][-1] * x == pytest.approx(cart_position(0.5), rel=1e-3)
    assert run.reference[-1] * x == pytest.approx(0.1)  # to be compared with x
    law = 25 * (0.1 - run.outputs["x"][-1] * x) - 8 * run.outputs["v"][-1] * v
    assert run.commands["u"][-1] * u == pytest.approx(law, abs=1e-9)
    assert run.units == {name: plant.get(name, "") for name in ("x", "v", "u")}


def test_a_command_that_the_plant_does_not_declare_has_the_controllers_unit(tmp_path):
    pair(tmp_path, {}, {"u": "kN"})
    assert followed(tmp_path).run.units["u"] == "kN"


def test_offsets_of_units_are_converted(tmp_path):
    """A position in degrees Celsius, as odd as it is, tells what becomes of offsets."""
    pair(tmp_path, {"x": "degC", "offset": 273.15}, {"x": "K", "x_d": "K"})
    run = followed(tmp_path).run
    assert run.outputs["x"][-1] + 273.15 == pytest.approx(cart_position(0.5), rel=1e-3)
    assert run.reference[-1] == pytest.approx(0.1 - 273.15)


@pytest.mark.parametrize(
    ("plant", "controller", "told"),
    [
        ({"x": "m"}, {"x": "rad"}, ("plant.x to controller.x", "'m'", "'rad'")),
        ({"u": "N"}, {"u": "m/s"}, ("controller.u to plant.u", "'m/s'", "'N'")),
        ({"x": "m", "v": "m/s"}, {"x_d": "deg"}, ("controller.x_d", "'deg'", "set-point")),
        ({"x": "furlong"}, {"x": "m"}, ("furlong", "not defined")),
    ],
)
def test_what_contradicts_is_refused_in_one_line(tmp_path, command, plant, controller, told):
    pair(tmp_path, plant, controller)
    words = "run --no-isolate --controller pd.fmu --plant cart.fmu --stop 0.5 --out out"
    code, _, said = command(tmp_path, words)
    (line,) = said.strip().splitlines()
    assert code == 2
    assert all(word in line for word in told)
    assert not (tmp_path / "out" / "trajectory.csv").exists()


def test_where_one_side_declares_nothing_it_goes_on_with_one_note(tmp_path):
    pair(tmp_path, {"x": "m", "v": "m/s", "u": "N"}, {})
    result = followed(tmp_path)
    assert result.run.outputs["x"][-1] == pytest.approx(cart_position(0.5), rel=1e-3)
    (note,) = (note for note in result.notes if "unit of" in note)
    assert all(port in note for port in ("x [m]", "v [m/s]", "u [N]"))


@pytest.mark.ci
@pytest.mark.parametrize("reports", [True, False])
def test_the_law_and_probed_derivatives_pass_through_the_conversions(tmp_path, reports):
    """u = 300 (x_d - x) - 5 v [V] on our plant, which takes derivatives: reported, or probed."""

    def run_in(length, voltage):
        size, volts = UNITS[length][1], UNITS[voltage][1]
        ports = [("x", "input", 0, f'unit="{length}"'), ("v", "input", 0, 'unit="m/s"')]
        ports += [("x_d", "input", 0, f'unit="{length}"')]
        law = f"$u$=(300.0*($x_d$-$x$)*{size!r}-5.0*$v$)/{volts!r};"
        ports.append(("u", "output", None, f'unit="{voltage}"'))
        if reports:
            ports += [(n, "output", None, "") for n in ("u_gain_x", "u_gain_v", "u_rate")]
            law += f"$u_gain_x$=-300.0*{size!r}/{volts!r};$u_gain_v$=-5.0/{volts!r};$u_rate$=0;"
        path = str(tmp_path / f"{length}.fmu")
        small_fmus.build(path, length, ports, out=law, units=DEFINED)
        coupling = Coupling.INTERFACE_JACOBIAN
        return run_closed_loop(
            Loop(path, stop=0.3, step=1e-3, isolate=False, coupling=coupling)
        ).run

    expected, found = run_in("m", "V"), run_in("mm", "mV")
    assert expected.verdict.trusted
    assert found.verdict.trusted
    for name in ("x", "v", "i"):
        bound = 1e-6 * np.ptp(expected.outputs[name])
        np.testing.assert_allclose(found.outputs[name], expected.outputs[name], rtol=0, atol=bound)


def test_a_system_takes_the_set_point_in_metres_and_labels_what_it_records(tmp_path):
    pair(tmp_path, {"x": "mm", "u": "N"}, {"x": "m", "x_d": "mm", "u": "kN"})
    system(tmp_path, "s.ssp")
    loop = SystemLoop(tmp_path / "s.ssp", GOAL, stop=0.5, step=1e-3, isolate=False)
    run, expected = run_closed_loop(loop).run, followed(tmp_path).run
    assert run.units == {"x": "mm", "v": "", "u": "N"}
    np.testing.assert_allclose(run.outputs["x"], expected.outputs["x"], rtol=1e-9)
    np.testing.assert_allclose(run.commands["u"], expected.commands["u"], atol=1e-9)
    np.testing.assert_allclose(run.reference, 100.0)

"""Units that two FMUs declare are converted between them, or refused; never passed over."""

from __future__ import annotations

import math
import zipfile
from types import ModuleType

import numpy as np
import pytest
from cases import ballscrew, cart_position, case, last_row, maker

from ballscrew.cli import main
from ballscrew.orchestration.couplings import Coupling
from ballscrew.orchestration.loop import Loop, SystemLoop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from ballscrew.stability.fmu_cell import run_fmu_cell
from ballscrew.stability.fmu_parts import OverFmus, opened_parts
from ballscrew.stability.map_plan import Axis, MapPlan

TANGENT = Coupling.INTERFACE_JACOBIAN
RUN = "--setpoint 0.1 --stop 0.5 --step 1e-3 --out out"
UNITS = (
    "<UnitDefinitions>"
    '<Unit name="m"><BaseUnit m="1"/></Unit>'
    '<Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>'
    '<Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>'
    '<Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>'
    '<Unit name="kN"><BaseUnit kg="1" m="1" s="-2" factor="1000"/></Unit>'
    '<Unit name="rad"><BaseUnit rad="1"/></Unit>'
    '<Unit name="deg"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit>'
    '<Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>'
    '<Unit name="rpm"><BaseUnit rad="1" s="-1" factor="0.10471975511965977"/></Unit>'
    '<Unit name="V"><BaseUnit kg="1" m="2" s="-3" A="-1"/></Unit>'
    '<Unit name="mV"><BaseUnit kg="1" m="2" s="-3" A="-1" factor="0.001"/></Unit>'
    '<Unit name="K"><BaseUnit K="1"/></Unit>'
    '<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>'
    "</UnitDefinitions>"
)


@pytest.fixture(scope="module")
def mk() -> ModuleType:
    return maker()


def plant(mk, path, name, x="", v="", u="", size=1.0, speed=1.0, force=1.0, bias=0.0):
    """The cart, whose x, v and u are in units of so many metres, metres per second and newtons."""
    mk.build(
        str(path / f"{name}.fmu"),
        name,
        [
            ("u", "input", 0, f'unit="{u}"' if u else ""),
            ("x", "output", None, f'unit="{x}"' if x else ""),
            ("v", "output", None, f'unit="{v}"' if v else ""),
        ],
        out=f"$x$=(S[0]-{bias!r})/{size!r};$v$=S[1]/{speed!r};",
        step=f"double a=2.0,e=exp(-a*h),v=S[1],F=$u$*{force!r}/2.0;"
        "S[0]+=F*h+(v-F)*(1-e)/a;S[1]=F+(v-F)*e;",
        deps=False,
        units=UNITS,
    )


def controller(
    mk, path, name, x="", v="", u="", x_d="", size=1.0, speed=1.0, force=1.0, goal=1.0, bias=0.0
):
    """The PD controller, with each signal in units of so many SI units."""
    mk.build(
        str(path / f"{name}.fmu"),
        name,
        [
            ("x", "input", 0, f'unit="{x}"' if x else ""),
            ("v", "input", 0, f'unit="{v}"' if v else ""),
            ("x_d", "input", 0, f'unit="{x_d}"' if x_d else ""),
            ("u", "output", None, f'unit="{u}"' if u else ""),
            ("Kp", "parameter", 25.0, ""),
        ],
        out=f"$u$=($Kp$*($x_d$*{goal!r}-$x$*{size!r})-8.0*$v$*{speed!r})/{force!r};",
        units=UNITS,
    )


def test_a_command_in_kilonewtons_to_a_plant_in_newtons(tmp_path):
    folder = case("units_command_kN_to_N", tmp_path)
    done = ballscrew(folder, f"run --controller pd_kN.fmu --plant cart_N.fmu {RUN}")
    assert done.returncode == 0, done.stdout + done.stderr
    end = last_row(folder / "out")
    assert end["x"] == pytest.approx(cart_position(0.5), rel=1e-3)
    assert end["u"] == pytest.approx(25 * (0.1 - end["x"]) - 8 * end["v"], rel=0.05)
    assert " N\n" in done.stdout
    assert "kN" not in done.stdout


def followed(path, controllers="pd", plants="cart", **options):
    """The run of both FMUs, in this process."""
    study = Loop(
        str(path / f"{controllers}.fmu"),
        str(path / f"{plants}.fmu"),
        Reference.constant(0.1),
        stop=0.5,
        step=1e-3,
        isolate=False,
        **options,
    )
    return run_closed_loop(study)


@pytest.mark.parametrize(
    ("plants", "controllers"),
    [
        # what the plant measures, what the controller measures, the set-point
        ({"x": "mm", "size": 1e-3}, {"x": "m", "x_d": "m"}),
        ({"x": "m"}, {"x": "mm", "size": 1e-3, "x_d": "m"}),
        ({"x": "m"}, {"x": "m", "x_d": "mm", "goal": 1e-3}),
        ({"x": "mm", "size": 1e-3}, {"x": "mm", "size": 1e-3, "x_d": "mm", "goal": 1e-3}),
        ({"x": "mm", "size": 1e-3}, {"x": "m"}),
        (
            {"x": "deg", "size": math.pi / 180, "v": "rpm", "speed": math.pi / 30},
            {"x": "rad", "v": "rad/s", "x_d": "deg", "goal": math.pi / 180},
        ),
        ({"u": "kN", "force": 1e3, "x": "m"}, {"u": "N", "x": "mm", "size": 1e-3}),
    ],
)
def test_what_both_declare_is_converted_wherever_it_is(mk, tmp_path, plants, controllers):
    plant(mk, tmp_path, "cart", **plants)
    controller(mk, tmp_path, "pd", **controllers)
    result = followed(tmp_path)
    run, size = result.run, plants.get("size", 1.0)
    assert result.trusted
    assert run.outputs["x"][-1] * size == pytest.approx(cart_position(0.5), rel=1e-3)
    assert run.reference[-1] * size == pytest.approx(0.1)  # to be compared with x
    force = run.commands["u"][-1] * plants.get("force", 1.0)
    state = run.outputs["x"][-1] * size, run.outputs["v"][-1] * plants.get("speed", 1.0)
    assert force == pytest.approx(25 * (0.1 - state[0]) - 8 * state[1], abs=1e-9)
    assert run.units == {name: plants.get(name, "") for name in ("x", "v", "u")}


def test_a_command_that_the_plant_does_not_declare_has_the_controllers_unit(mk, tmp_path):
    plant(mk, tmp_path, "cart")
    controller(mk, tmp_path, "pd", u="kN")
    assert followed(tmp_path).run.units["u"] == "kN"


def test_offsets_of_units_are_converted(mk, tmp_path):
    """A position in degrees Celsius, as odd as it is, tells what becomes of offsets."""
    plant(mk, tmp_path, "cart", x="degC", bias=273.15)
    controller(mk, tmp_path, "pd", x="K", x_d="K")
    run = followed(tmp_path).run
    assert run.outputs["x"][-1] + 273.15 == pytest.approx(cart_position(0.5), rel=1e-3)
    assert run.reference[-1] == pytest.approx(0.1 - 273.15)


@pytest.mark.parametrize(
    ("plants", "controllers", "said"),
    [
        ({"x": "m"}, {"x": "rad"}, ("plant.x to controller.x", "'m'", "'rad'")),
        ({"u": "N"}, {"u": "m/s"}, ("controller.u to plant.u", "'m/s'", "'N'")),
        ({"x": "m", "v": "m/s"}, {"x_d": "deg"}, ("controller.x_d", "'deg'", "set-point")),
        ({"x": "furlong"}, {"x": "m"}, ("furlong", "not defined")),
    ],
)
def test_what_contradicts_is_refused_in_one_line(mk, tmp_path, capsys, plants, controllers, said):
    plant(mk, tmp_path, "cart", **plants)
    controller(mk, tmp_path, "pd", **controllers)
    parts = ["--controller", str(tmp_path / "pd.fmu"), "--plant", str(tmp_path / "cart.fmu")]
    assert main(["run", *parts, "--stop", "0.5", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert all(word in line for word in said)
    assert not (tmp_path / "out" / "trajectory.csv").exists()


def test_where_one_side_declares_nothing_it_goes_on_with_one_note(mk, tmp_path):
    plant(mk, tmp_path, "cart", x="m", v="m/s", u="N")
    controller(mk, tmp_path, "pd")
    result = followed(tmp_path)
    assert result.run.outputs["x"][-1] == pytest.approx(cart_position(0.5), rel=1e-3)
    (note,) = (note for note in result.notes if "unit of" in note)
    assert all(port in note for port in ("x [m]", "v [m/s]", "u [N]"))


def test_units_that_nobody_defines_are_known_by_their_usual_names(mk, tmp_path):
    plant(mk, tmp_path, "cart", v="m.s-1")
    controller(mk, tmp_path, "pd", v="m/s")
    assert followed(tmp_path).trusted


@pytest.mark.parametrize("coupling", list(Coupling)[:2])
def test_every_coupling_gives_what_it_gives_in_one_unit(mk, tmp_path, coupling):
    plant(mk, tmp_path, "cart", x="mm", size=1e-3, u="N")
    plant(mk, tmp_path, "plain")
    controller(mk, tmp_path, "pd", x="m", x_d="m", u="kN", force=1e3)
    controller(mk, tmp_path, "pd_plain")
    for corrections in (0, 1):
        options = {"coupling": coupling, "corrections": corrections}
        found = followed(tmp_path, **options).run
        expected = followed(tmp_path, "pd_plain", "plain", **options).run
        np.testing.assert_allclose(found.outputs["x"], 1e3 * expected.outputs["x"], rtol=1e-9)
        np.testing.assert_allclose(found.commands["u"], expected.commands["u"], atol=1e-9)


@pytest.mark.parametrize("reports", [True, False])
def test_the_law_and_probed_derivatives_pass_through_the_conversions(mk, tmp_path, reports):
    """u = 300 (x_d - x) - 5 v [V] on our plant, which takes derivatives: reported, or probed."""

    def built(name, length, size, voltage, volts):
        law = [("u_gain_x", "output", None, ""), ("u_gain_v", "output", None, "")]
        law += [("u_rate", "output", None, "")]
        gains = f"$u_gain_x$=-300.0*{size!r}/{volts!r};$u_gain_v$=-5.0/{volts!r};$u_rate$=0;"
        mk.build(
            str(tmp_path / f"{name}.fmu"),
            name,
            [
                ("x", "input", 0, f'unit="{length}"'),
                ("v", "input", 0, 'unit="m/s"'),
                ("x_d", "input", 0, f'unit="{length}"'),
                ("u", "output", None, f'unit="{voltage}"'),
                *(law if reports else []),
            ],
            out=f"$u$=(300.0*($x_d$-$x$)*{size!r}-5.0*$v$)/{volts!r};" + gains * reports,
            units=UNITS,
        )
        study = Loop(
            str(tmp_path / f"{name}.fmu"), stop=0.3, step=1e-3, isolate=False, coupling=TANGENT
        )
        return run_closed_loop(study).run

    expected, found = built("si", "m", 1.0, "V", 1.0), built("small", "mm", 1e-3, "mV", 1e-3)
    assert expected.verdict.trusted
    assert found.verdict.trusted
    for name in ("x", "v", "i"):
        size = np.ptp(expected.outputs[name])
        np.testing.assert_allclose(
            found.outputs[name], expected.outputs[name], rtol=0, atol=1e-6 * size
        )


def test_maps_over_fmus_are_in_metres(mk, tmp_path):
    plant(mk, tmp_path, "cart", x="mm", size=1e-3, u="N")
    controller(mk, tmp_path, "pd", x="m", x_d="m", u="kN", force=1e3)
    names = str(tmp_path / "pd.fmu"), str(tmp_path / "cart.fmu")
    axes = (
        Axis("setpoint", "setpoint", "", 0.1, 0.2, 2),
        Axis("controller.Kp", "controller", "Kp", 25.0, 30.0, 2),
    )
    plan = MapPlan(Loop(*names, stop=0.5, step=1e-3), *axes)
    with opened_parts(plan.loop, 0) as parts:
        fmus = OverFmus(0, {})
        cell = run_fmu_cell(plan, fmus, parts, 0.1, 25.0, 1.0)
    assert cell.final_error == pytest.approx(cart_position(0.5) - 0.1, abs=1e-4)


SYSTEM = """<ssd:SystemStructureDescription version="1.0" name="s"
xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"><ssd:System name="s">
<ssd:Elements><ssd:Component name="pd" source="pd.fmu"/>
<ssd:Component name="plant" source="cart.fmu"/></ssd:Elements><ssd:Connections>
<ssd:Connection startElement="plant" startConnector="x" endElement="pd" endConnector="x"/>
<ssd:Connection startElement="plant" startConnector="v" endElement="pd" endConnector="v"/>
<ssd:Connection startElement="pd" startConnector="u" endElement="plant" endConnector="u"/>
</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"""


def test_a_system_takes_the_set_point_in_metres_and_labels_what_it_records(mk, tmp_path):
    plant(mk, tmp_path, "cart", x="mm", size=1e-3, u="N")
    controller(mk, tmp_path, "pd", x="m", x_d="mm", goal=1e-3, u="kN", force=1e3)
    with zipfile.ZipFile(tmp_path / "s.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SYSTEM)
        for name in ("pd", "cart"):
            archive.write(tmp_path / f"{name}.fmu", f"{name}.fmu")
    study = SystemLoop(
        tmp_path / "s.ssp", Reference.constant(0.1), stop=0.5, step=1e-3, isolate=False
    )
    run, pair = run_closed_loop(study).run, followed(tmp_path).run
    assert run.units == {"x": "mm", "v": "", "u": "N"}
    np.testing.assert_allclose(run.outputs["x"], pair.outputs["x"], rtol=1e-9)
    np.testing.assert_allclose(run.commands["u"], pair.commands["u"], atol=1e-9)
    np.testing.assert_allclose(run.reference, 100.0)

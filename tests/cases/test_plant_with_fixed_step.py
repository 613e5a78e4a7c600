"""FMUs that take steps of one length get them, whichever side they are on."""

from __future__ import annotations

import zipfile

import pytest
from cases import ballscrew, cart_position, case, last_row, maker

from ballscrew.orchestration.loop import Loop, SystemLoop
from ballscrew.orchestration.loop_run import CouplingError
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop
from tests.cases.test_units_command_kN_to_N import SYSTEM

FIXED = "if(fabs(h-0.01)>1e-12)return 3;"
STEP = '<DefaultExperiment stepSize="{}"/>'


def test_the_plants_own_step_is_taken(tmp_path):
    folder = case("plant_with_fixed_step", tmp_path)
    done = ballscrew(
        folder,
        "run --controller pd.fmu --plant cart_fx.fmu --setpoint 0.1 --stop 0.5 --out out",
    )
    assert done.returncode in (0, 1), done.stderr
    rows = (folder / "out" / "trajectory.csv").read_text().splitlines()
    assert len(rows) == 1 + 51
    assert last_row(folder / "out")["x"] == pytest.approx(cart_position(0.5), rel=2e-2)
    assert "FMI status" not in done.stdout + done.stderr
    assert "use a smaller --step" not in done.stderr  # it takes none
    assert "its FMUs take steps of 0.01 s only" in done.stderr


def parts(folder, size=0.01):
    mk = maker()
    mk.plant(
        str(folder / "cart.fmu"),
        step=FIXED + mk.PLANT_STEP,
        varstep=False,
        exp=STEP.format(0.01),
    )
    mk.pd(str(folder / "pd.fmu"), varstep=False, exp=STEP.format(size))
    return str(folder / "pd.fmu"), str(folder / "cart.fmu")


def test_both_sides_of_one_step_and_a_system(tmp_path):
    names = parts(tmp_path)
    pair = run_closed_loop(Loop(*names, Reference.constant(0.1), stop=0.5)).run
    assert pair.step_range == pytest.approx((0.01, 0.01))
    assert not pair.stopped
    with zipfile.ZipFile(tmp_path / "s.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SYSTEM)
        for name in ("pd", "cart"):
            archive.write(tmp_path / f"{name}.fmu", f"{name}.fmu")
    system = run_closed_loop(SystemLoop(tmp_path / "s.ssp", Reference.constant(0.1), stop=0.5)).run
    assert system.step_range == pytest.approx((0.01, 0.01))
    assert not system.stopped


def test_two_steps_that_differ_are_refused_in_one_line(tmp_path):
    names = parts(tmp_path, size=0.02)
    with pytest.raises(CouplingError, match=r"cart\.fmu of 0\.01 s and pd\.fmu of 0\.02 s"):
        run_closed_loop(Loop(*names, Reference.constant(0.1), stop=0.5))

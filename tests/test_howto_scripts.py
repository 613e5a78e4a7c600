"""Scripts for tools that nobody here has: their ports, and what they compare with."""

from __future__ import annotations

import re
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballscrew.cli import main
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

DOCS = Path(__file__).resolve().parents[1] / "docs"
pytestmark = pytest.mark.ci
FOLDER = DOCS / "howto" / "scripts"


@pytest.fixture(scope="module")
def ports(tmp_path_factory):
    """Names of inputs and outputs of both FMUs, in their order."""
    folder = tmp_path_factory.mktemp("howto")
    assert main(["export", "--native", "--only", "plant", "iol", "--out", str(folder)]) == 0
    found = {}
    for part in ("plant", "iol"):
        variables = fmpy.read_model_description(str(folder / f"{part}.fmu")).modelVariables
        for causality in ("input", "output"):
            names = [v.name for v in variables if v.causality == causality]
            found[f"{part}_{causality.removesuffix('put')}"] = names
    return found


def table():
    return np.genfromtxt(FOLDER / "iol_step.csv", delimiter=",", names=True)


def test_the_table_is_the_whole_loop_in_radau():
    kernel = fmu_kernel("iol", "plant")
    model = Model(kernel)
    known = table()
    course = solve_ivp(
        model.derivatives,
        (0.0, 2.0),
        model.x,
        method="Radau",
        jac=model.jacobian,
        rtol=1e-10,
        atol=1e-10 * kernel.nominal,
        t_eval=known["time"],
    )
    names = [s.name for s in kernel.states]
    np.testing.assert_allclose(course.y[names.index("plant_x")], known["x"], atol=1e-8)
    power = table()["u"]
    assert power.max() < 36.0
    current = course.y[names.index("plant_i")]
    speed = course.y[names.index("plant_v")]
    rate = np.gradient(current, known["time"], edge_order=2)
    # u = R i + L di/dt + ke w, of the motor's nominal values
    voltage = 21.4 * current + 0.000953 * rate + 0.03744822190397537 * 2 * np.pi * 1000.0 * speed
    np.testing.assert_allclose(voltage[2:-2], power[2:-2], atol=2e-3)


def test_the_matlab_script_knows_the_ports_in_their_order(ports):
    text = (FOLDER / "build_iol.m").read_text("utf-8").replace("...\n", "")
    for name in ("plant_in", "plant_out", "iol_in"):
        listed = re.findall(r"'(\w+)'", re.search(rf"^{name} = \{{(.*?)\}}", text, re.M)[1])
        assert listed == ports[name]
    assert ports["iol_out"] == ports["plant_in"]  # as the script says


def test_the_models_wire_every_input_once(ports):
    texts = {n: (FOLDER / f"axis_{n}.mo").read_text("utf-8") for n in ("openmodelica", "dymola")}
    same = texts["openmodelica"].replace("_me_FMU", "_fmu").replace("OpenModelica", "Dymola")
    assert same == texts["dymola"]
    wired = re.findall(r"^  (plant|iol)\.(\w+) = ", texts["dymola"], re.M)
    inputs = [(part, n) for part in ("plant", "iol") for n in ports[f"{part}_in"]]
    assert sorted(wired) == sorted(inputs)

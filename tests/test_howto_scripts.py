"""Scripts for tools that nobody here has: their syntax, their ports, and what they compare with."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from pymoca import parser
from scipy.integrate import solve_ivp

from ballscrew.cli import main
from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

DOCS = Path(__file__).resolve().parents[1] / "docs"
FOLDER = DOCS / "howto" / "scripts"
SCRIPTS = sorted(p for p in FOLDER.iterdir() if p.suffix != ".csv")
LEFT_OVER = "`u_gain_x`, `u_gain_v`, `u_gain_z`, `u_gain_i`, `u_ref_x`, `u_ref_v`, `u_ref_z`, "
LEFT_OVER += "`u_ref_i`, `u_rate`"


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


def test_the_files_are_what_their_writer_writes(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import write_howto_table

    monkeypatch.setattr(write_howto_table, "FOLDER", tmp_path)
    write_howto_table.main()
    again = np.genfromtxt(tmp_path / "iol_step.csv", delimiter=",", names=True)
    for name in ("time", "x", "u"):
        np.testing.assert_allclose(again[name], table()[name], rtol=1e-6, atol=1e-8)
    numbers = re.compile(r"\d+\.\d+(?:e-\d+)?")
    for text in ((tmp_path / "dymola.mos").read_text(), (FOLDER / "dymola.mos").read_text()):
        said = [float(n) for n in numbers.findall(text.partition("known = ")[2].split(";")[0])]
        np.testing.assert_allclose(said, table()["x"][40::40], rtol=1e-6)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_a_script_says_first_that_its_authors_have_not_run_it(path):
    assert re.match(r"(%|//) Not run by its authors\b", path.read_text("utf-8"))


def linted(path):
    command = [Path(sys.executable).with_name("mh_lint"), "--input-encoding", "utf-8", path]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_matlab_script_is_matlab(tmp_path):
    assert linted(FOLDER / "build_iol.m").returncode == 0
    broken = tmp_path / "broken.m"
    broken.write_text((FOLDER / "build_iol.m").read_text("utf-8").replace("end\n", "\n", 1))
    assert linted(broken).returncode != 0


def as_function(text):
    """A script's statements as those of a function; Dymola assigns by =."""
    text = re.sub(r"^(\w+) = ", r"\1 := ", text, flags=re.M)
    return f"function script\nalgorithm\n{text}end script;\n"


@pytest.mark.parametrize("path", [p for p in SCRIPTS if p.suffix != ".m"], ids=lambda p: p.name)
def test_models_and_scripts_of_modelica_have_its_syntax(path):
    text = path.read_text("utf-8")
    text = as_function(text) if path.suffix == ".mos" else text
    assert parser.parse(text).classes
    start, end, _ = text.rsplit(";\n", 2)
    with pytest.raises(SyntaxError):
        parser.parse(f"{start}\n{end};\n")


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


@pytest.mark.parametrize("page", ["simulink", "openmodelica", "dymola"])
def test_the_pages_list_the_ports_that_are_left_over(page, ports):
    text = " ".join((DOCS / "howto" / f"{page}.md").read_text("utf-8").split())
    assert LEFT_OVER in text
    assert re.findall(r"`(\w+)`", LEFT_OVER) == [n for n in ports["plant_in"] if n != "u"]
    for name in re.findall(r"scripts/([\w.]+)\)", text):
        assert (FOLDER / name).is_file()
    known = table()
    for t, x, u in re.findall(r"^\| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", _page(page), re.M):
        (row,) = np.flatnonzero(np.isclose(known["time"], float(t)))
        assert f"{known['x'][row]:.6f}" == x
        assert f"{known['u'][row]:.3f}" == u


def _page(page):
    return (DOCS / "howto" / f"{page}.md").read_text("utf-8")

"""One law, one instrument, one controller and one coupling are added: a file and a line each.

They go into a copy of the installed package, in a folder of its own, whose commands then take them
through run, export and identify, and whose conformance suites hold them to what they claim.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ballscrew

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.ci

LAW = """
from ..solver.component import ForceTerm, Output, Parameter, State, symbol
from .law import Claims
import sympy as sp

_K, _FC, _C = map(symbol, ("k", "Fc", "c"))
CLAIMS = Claims(
    steady_state=_FC * sp.sign(symbol("v")) + _C * symbol("v"),
    stiffness=_K,
)


def cubic_slip(velocity):
    force = _K * symbol("z")
    rate = velocity - sp.Abs(velocity) * (force / _FC) ** 3
    total = force + _C * velocity
    return ForceTerm(
        name="friction",
        force=-total,
        meaning="a spring that slips with the cube of its force, opposing motion",
        states=(State("z", "m", "deflection", rate, nominal=1e-5),),
        parameters=(
            Parameter("k", 5e4, "N/m", "stiffness", "a test", minimum=1.0),
            Parameter("Fc", 1.5, "N", "friction of slow sliding", "a test", minimum=1e-6),
            Parameter("c", 150.0, "N*s/m", "viscous friction", "a test", minimum=0.0),
        ),
        outputs=(Output("friction", "N", "friction, opposing motion", total, nominal=1.0),),
    )
"""

INSTRUMENT = """
from ...solver.component import Component, Input, Output, Parameter, symbol
import sympy as sp


def glass_scale():
    return Component(
        name="glass_scale",
        description="Position in whole steps",
        parameters=(Parameter("pitch", 1e-6, "m", "step", "a test", minimum=1e-12),),
        inputs=(Input("x", "m", "position", nominal=1e-2),),
        outputs=(
            Output(
                "x_measured",
                "m",
                "position by the scale",
                sp.floor(symbol("x") / symbol("pitch")) * symbol("pitch"),
                nominal=1e-2,
            ),
        ),
    )
"""

CONTROLLER = """
from ..solver.component import Parameter, symbol
from .limited import U_MAX, voltage_law

TUNABLE = {"Kp": (50.0, 5e4), "Kd": (0.0, 500.0)}


def soft_pd():
    command = symbol("Kp") * (symbol("x_d") - symbol("x")) - symbol("Kd") * symbol("v")
    parameters = (
        Parameter("Kp", 400.0, "V/m", "proportional gain", "a test"),
        Parameter("Kd", 20.0, "V*s/m", "gain on the velocity", "a test"),
        U_MAX,
    )
    return voltage_law("soft_pd", "Proportional, with velocity feedback", parameters, command)
"""

COUPLING = '''
def weaken(law, h):
    """Only half of the feedback law within the step."""
    law.gain[:] *= 0.5
'''

ADDED = (  # file, its text, the list, the line before the new one, the new one
    ("plant/cubic_slip.py", LAW, "plant/__init__.py", "LAWS = {",
     '    "cubic_slip": "ballscrew.plant.cubic_slip:cubic_slip",'),
    ("plant/instruments/glass_scale.py", INSTRUMENT, "plant/instruments/__init__.py",
     '    "current_sensor": "ballscrew.plant.instruments.current_sensor:current_sensor",',
     '    "glass_scale": "ballscrew.plant.instruments.glass_scale:glass_scale",'),
    ("controllers/soft_pd.py", CONTROLLER, "controllers/__init__.py", "CONTROLLERS = {",
     '    "soft_pd": "ballscrew.controllers.soft_pd:soft_pd",'),
    ("orchestration/master/half_law.py", COUPLING, "orchestration/master/couplings.py",
     '    GAUSS_SEIDEL = "gauss-seidel"',
     '    HALF_LAW = "half-law", False, True, "ballscrew.orchestration.master.half_law:weaken"'),
)  # fmt: skip
TRUTH = {"k": 7e4, "Fc": 2.1, "c": 220.0}


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """Function that runs a module in the package with the four additions."""
    folder = tmp_path_factory.mktemp("extended")
    package = folder / "ballscrew"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(ballscrew.__file__).parent, package, ignore=ignored)
    for file, text, where, before, line in ADDED:
        (package / file).write_text(text)
        listed = (package / where).read_text()
        assert listed.count(f"{before}\n") == 1
        (package / where).write_text(listed.replace(f"{before}\n", f"{before}\n{line}\n"))
    support = Path(__file__).with_name("support")
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{support}"}

    def run(*words, cwd=folder, codes=(0,)):
        done = subprocess.run(
            [sys.executable, "-P", "-m", *map(str, words)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in codes, done.stdout + done.stderr
        return done

    run.folder = folder
    return run


def figures(extended, out):
    return json.loads((extended.folder / out / "metrics.json").read_text())


def test_they_run_as_one_loop_and_are_exported(extended):
    loop = ("ballscrew", "run", "--controller", "soft_pd+glass_scale")
    plant = ("--plant", "plant_cubic_slip", "--stop", "0.2", "--step", "1e-3")
    extended(*loop, *plant, "--out", "run", codes=(0, 1))
    end = figures(extended, "run")
    assert end["controller"] == "soft_pd+glass_scale"
    assert end["steady_state_error"] < 0.08
    names = ("plant_cubic_slip", "soft_pd", "glass_scale")
    extended("ballscrew", "export", "--only", *names, "--out", "fmus")
    assert {f"{n}.fmu" for n in names} <= {p.name for p in (extended.folder / "fmus").iterdir()}
    extended("ballscrew", "rig", "2.4/7", "--law", "cubic_slip", "--out", "rig")


def test_noise_measures_each_signal_by_the_first_instrument_of_the_list(extended):
    words = "swap --controllers pid --noise --stop 0.01 --json --out noise".split()
    (row,) = json.loads(extended("ballscrew", *words, codes=(0, 1)).stdout)
    assert row["controller"] == "pid+position_encoder+velocity_estimate"


def test_the_coupling_runs_and_says_how_far_it_is_right(extended):
    ends = {}
    for name in ("half-law", "interface-jacobian", "monolithic"):
        loop = ("ballscrew", "run", "--controller", "soft_pd", "--coupling", name)
        extended(*loop, "--stop", "0.2", *(() if name == "monolithic" else ("--step", "1e-3")),
                 "--out", name, codes=(0, 1))  # fmt: skip
        ends[name] = figures(extended, name)
        assert ends[name]["coupling"] == name
    exact = ends["monolithic"]["steady_state_error"]
    off = {name: abs(e["steady_state_error"] - exact) for name, e in ends.items()}
    assert off["interface-jacobian"] < off["half-law"] < 1e-4


RECORDS = """
import numpy as np
from prescribed_motion import prescribed_friction

t = np.arange(0, 8, 0.01)
random = np.random.default_rng(1)
for k, (top, w) in enumerate([(1e-3, 2.0), (4e-3, 0.9), (-2e-3, 1.3)]):
    v, x = top * np.sin(w * t), top / w * (1 - np.cos(w * t))
    force = prescribed_friction("cubic_slip", t, v, {"k": 7e4, "Fc": 2.1, "c": 220.0})
    force = force.outputs["friction"] + top * w * np.cos(w * t) + random.normal(0, 0.02, len(t))
    np.savetxt(f"{k}.csv", np.column_stack([t, x, force]), delimiter=",",
               header="time,x,force", comments="")
"""


def test_the_law_is_identified(extended):
    """It has no fast form in C: its equations are solved, and the command says so."""
    (extended.folder / "records.py").write_text(RECORDS)
    extended("records")
    records = [extended.folder / f"{k}.csv" for k in range(3)]
    words = ("--law", "cubic_slip", "--mass", "1", "--out", "identified")
    said = extended("ballscrew", "identify", *records, *words, codes=(0, 1)).stderr
    assert "cubic_slip has no fast form in c/laws.c" in said
    found = json.loads((extended.folder / "identified" / "identified.json").read_text())
    for name, value in TRUTH.items():
        interval = found["parameters"][name]
        assert interval["low"] <= value <= interval["high"]
        assert interval["value"] == pytest.approx(value, rel=0.02)
    loop = ("ballscrew", "run", "--controller", "soft_pd", "--stop", "0.05", "--step", "1e-3")
    extended(*loop, "--params", "identified/parameters.toml", "--out", "again", codes=(0, 1))


def test_the_conformance_suites_take_them(extended):
    suites = ["tests/test_conformance.py", "tests/plant/test_laws.py"]
    suites += ["tests/controllers/test_every_controller.py"]
    which = ("-k", "cubic_slip or glass_scale or soft_pd or tunable")
    said = extended("pytest", *suites, "-q", "-x", "-p", "no:cacheprovider", *which, cwd=ROOT)
    passed = int(said.stdout.rsplit(" passed", 1)[0].rsplit(maxsplit=1)[-1])
    assert passed > 15  # five of the first suite for each, and more

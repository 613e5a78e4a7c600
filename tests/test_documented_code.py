"""Code on the pages: Python runs, commands are taken, scripts fit, and what is named is there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from wired_loop import missing_for_ecos

import ballscrew
from ballscrew import cli, symbol
from ballscrew.fmus.export import export
from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.plant.modified_lugre import modified_lugre
from ballscrew.solver.codegen import generate
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

ROOT = Path(__file__).resolve().parents[1]
HOW_TO = sorted((ROOT / "docs" / "howto").glob("*.md"))
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)


def blocks(page: Path, language: str) -> list[str]:
    return [code for kind, code in FENCE.findall(page.read_text("utf-8")) if kind == language]


def commands() -> list[str]:
    """Every command of ours on the pages, continued lines joined."""
    found = []
    for page in PAGES:
        for block in blocks(page, "console"):
            for line in block.replace("\\\n", " ").splitlines():
                called = re.match(r"\$ (?:\.venv/bin/)?ballscrew (.+)", line)
                if called:
                    found.append(called.group(1))
    return found


def test_every_command_on_a_page_is_one_that_the_program_takes():
    parser = cli.command_parser()
    taken = [parser.parse_args(shlex.split(c, comments=True)).action for c in commands()]
    assert len(taken) > 80


def run_block(code: str, folder: Path) -> str:
    """Run it as a user would, from a file of its own."""
    (folder / "block.py").write_text(code, encoding="utf-8")
    told = subprocess.run(
        [sys.executable, "block.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert told.returncode == 0, told.stderr
    return told.stdout


def test_the_python_on_the_first_page_runs_and_prints(tmp_path):
    (code,) = blocks(ROOT / "README.md", "python")
    (printed,) = blocks(ROOT / "README.md", "text")
    assert run_block(code, tmp_path) == printed
    assert (tmp_path / "out" / "wrong_friction" / "trajectory.csv").is_file()


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    """A folder with the files that the tools' pages speak of."""
    folder = tmp_path_factory.mktemp("tools")
    native = ["export", "--native", "--out", str(folder / "native"), "--only", "plant", "iol"]
    assert cli.main(native) == 0
    assert cli.main(["export", "--native", "--loop", "iol", "--out", str(folder / "loops")]) == 0
    return folder


@pytest.mark.ci
@pytest.mark.parametrize(
    "code", [pytest.param(b, id=p.stem) for p in HOW_TO for b in blocks(p, "python")]
)
def test_the_python_on_a_tool_s_page_runs(exported, code):
    if "ecospy" in code and missing_for_ecos():
        pytest.skip(missing_for_ecos())
    run_block(code, exported)


# -- the page about the contract of components ------------------------------------------------

EXAMPLES = (
    "modified LuGre plant",
    "sampled PI controller",
    "relay with hysteresis",
    "bouncing mass",
    "pure delay",
    "one more force term",
)


@cache
def example(title: str) -> ballscrew.Component:
    code = blocks(ROOT / "docs" / "contract.md", "python")[EXAMPLES.index(title)]
    namespace: dict[str, object] = {"__name__": "contract_page"}
    exec(compile(code, f"contract.md: {title}", "exec"), namespace)
    component = namespace["component"]
    assert isinstance(component, ballscrew.Component)
    return component


@pytest.mark.parametrize(
    "title", [EXAMPLES[0], *(pytest.param(t, marks=pytest.mark.ci) for t in EXAMPLES[1:])]
)
def test_an_example_of_a_component_is_exported_and_simulates_to_states_that_move(title, tmp_path):
    model = Model(generate(example(title)))
    for k, i in enumerate(model.kernel.inputs):
        model.set_input(i.name, i.nominal / (k + 1))
    before = np.concatenate([model.x, model.u])
    step = model.sample_time or 1e-3
    for k in range(20):
        if model.sample_time:
            model.sample(k * step)
        trajectory = model.simulate([k * step, (k + 1) * step])
        for values in (*trajectory.states.values(), *trajectory.outputs.values()):
            assert np.isfinite(values).all()
    after = np.concatenate([model.x, model.u])
    first = len(model.x) + len(model.kernel.inputs)
    for part in (slice(0, len(model.x)), slice(first, first + len(model.kernel.discrete))):
        assert (after[part] != before[part]).all()
    assert export(example(title), tmp_path / "x.fmu").stat().st_size > 1000


def test_the_modified_lugre_example_is_the_friction_of_this_project():
    ours, page = modified_lugre(symbol("v")), Model(generate(example("modified LuGre plant")))
    values = {symbol(p.name): p.default for p in ours.parameters}
    assert {p.name: page.p[k] for k, p in enumerate(page.kernel.parameters)} == {
        "m": 1.0,
        **{s.name: default for s, default in values.items()},
    }
    page.set_input("u", 3.0)
    order = [s.name for s in page.kernel.states]
    for v, z in ((0.0, 2e-5), (4e-4, 1e-5), (-0.05, -1.9e-5), (0.2, 0.0)):
        at = {**values, symbol("v"): v, symbol("z"): z}
        state = {"x": 0.01, "v": v, "z": z}
        rates = page.derivatives(0.0, np.array([state[s] for s in order]))
        rate = dict(zip(order, rates, strict=True))
        assert rate["x"] == v
        assert rate["v"] == pytest.approx(3.0 + float(ours.force.xreplace(at)), rel=1e-12)
        deflection = float(ours.states[0].derivative.xreplace(at))
        assert rate["z"] == pytest.approx(deflection, rel=1e-12, abs=1e-18)


def test_what_breaks_the_contract_is_refused_with_its_name():
    def make(default=1.0, other="k", uses="gain"):
        limited = [(n, default, "1", n, "a test", 0.0, 2.0) for n in ("gain", other)]
        return ballscrew.Component(
            "broken",
            "Something",
            inputs=(),
            parameters=tuple(ballscrew.Parameter(*p) for p in limited),
            states=(ballscrew.State("q", "1", "state", -symbol("q")),),
            outputs=(ballscrew.Output("y", "1", "output", symbol(uses) * symbol("q")),),
        )

    assert make().name == "broken"
    for changes, said in (
        ({"uses": "ghost"}, "output y uses 'ghost', which is not declared"),
        ({"other": "q"}, "'q' is declared as parameter and as state"),
        ({"default": -1.0}, "default -1.0 of 'gain' is not within [0.0, 2.0]"),
        ({"default": 3.0}, "default 3.0 of 'gain' is not within [0.0, 2.0]"),
    ):
        with pytest.raises(ContractError, match=re.escape(f"broken: {said}")):
            make(**changes)


# -- what the pages name ----------------------------------------------------------------------

NAMING = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md"]


@pytest.mark.ci
def test_every_source_that_a_page_names_is_there():
    named = re.compile(r"`((?:[\w-]+/)+[\w-]+\.(?:py|c|h))`")
    pages = NAMING[:-1]  # not the changelog, which names what is gone
    found = {(page.name, n) for page in pages for n in named.findall(page.read_text("utf-8"))}
    assert [(page, n) for page, n in found if not (ROOT / n).exists()] == []
    glossary = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    files = re.findall(r"^\| [^|]+ \| [^|]+ \| `([^`]+)` \|$", glossary, re.M)
    assert len(files) > 20
    assert [f for f in files if not (ROOT / f).is_file()] == []


@pytest.mark.ci
def test_the_table_of_the_python_page_has_every_function():
    page = (ROOT / "docs" / "reference" / "api.md").read_text("utf-8")
    functions = {n for n in ballscrew.__all__ if getattr(ballscrew, n).__module__.endswith("api")}
    assert functions == set(re.findall(r"<ballscrew\.(?:\w+_)?api\.(\w+)>", page))


# -- scripts for tools that nobody here has ---------------------------------------------------

FOLDER = ROOT / "docs" / "howto" / "scripts"


@pytest.fixture(scope="module")
def ports(exported):
    """Names of inputs and outputs of both FMUs, in their order."""
    found = {}
    for part in ("plant", "iol"):
        path = exported / "native" / f"{part}.fmu"
        variables = fmpy.read_model_description(str(path)).modelVariables
        for causality in ("input", "output"):
            names = [v.name for v in variables if v.causality == causality]
            found[f"{part}_{causality.removesuffix('put')}"] = names
    return found


@pytest.mark.ci
def test_the_table_is_the_whole_loop_in_radau():
    kernel = fmu_kernel("iol", "plant")
    model = Model(kernel)
    known = np.genfromtxt(FOLDER / "iol_step.csv", delimiter=",", names=True)
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
    power = known["u"]
    assert power.max() < 36.0
    current = course.y[names.index("plant_i")]
    speed = course.y[names.index("plant_v")]
    rate = np.gradient(current, known["time"], edge_order=2)
    # u = R i + L di/dt + ke w, of the motor's nominal values
    voltage = 21.4 * current + 0.000953 * rate + 0.03744822190397537 * 2 * np.pi * 1000.0 * speed
    np.testing.assert_allclose(voltage[2:-2], power[2:-2], atol=2e-3)


@pytest.mark.ci
def test_the_matlab_script_knows_the_ports_in_their_order(ports):
    text = (FOLDER / "build_iol.m").read_text("utf-8").replace("...\n", "")
    for name in ("plant_in", "plant_out", "iol_in"):
        listed = re.findall(r"'(\w+)'", re.search(rf"^{name} = \{{(.*?)\}}", text, re.M)[1])
        assert listed == ports[name]
    assert ports["iol_out"] == ports["plant_in"]  # as the script says


@pytest.mark.ci
def test_the_models_wire_every_input_once(ports):
    texts = {n: (FOLDER / f"axis_{n}.mo").read_text("utf-8") for n in ("openmodelica", "dymola")}
    same = texts["openmodelica"].replace("_me_FMU", "_fmu").replace("OpenModelica", "Dymola")
    assert same == texts["dymola"]
    wired = re.findall(r"^  (plant|iol)\.(\w+) = ", texts["dymola"], re.M)
    inputs = [(part, n) for part in ("plant", "iol") for n in ports[f"{part}_in"]]
    assert sorted(wired) == sorted(inputs)

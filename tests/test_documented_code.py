"""Code on the pages: Python runs, commands are taken, calls in the text fit their functions."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from wired_loop import missing_for_ecos

import ballscrew
from ballscrew import cli
from ballscrew.fmus.export import export
from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.run import run_closed_loop

ROOT = Path(__file__).resolve().parents[1]
HOW_TO = sorted((ROOT / "docs" / "howto").glob("*.md"))
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *HOW_TO)
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


@pytest.mark.parametrize("command", commands())
def test_a_command_on_a_page_is_one_that_the_program_takes(command):
    assert cli.command_parser().parse_args(shlex.split(command, comments=True)).action


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


@pytest.mark.parametrize(
    "code", [pytest.param(b, id=p.stem) for p in HOW_TO for b in blocks(p, "python")]
)
def test_the_python_on_a_tool_s_page_runs(exported, code):
    if "ecospy" in code and missing_for_ecos():
        pytest.skip(missing_for_ecos())
    run_block(code, exported)


def test_a_component_is_exported_as_the_contract_page_says(tmp_path, monkeypatch):
    *_, bouncing, _, _, exporting, _ = blocks(ROOT / "docs" / "contract.md", "python")
    monkeypatch.chdir(tmp_path)
    exec(compile(bouncing + exporting, "contract.md", "exec"), {"__name__": "page"})
    assert (tmp_path / "x.fmu").stat().st_size > 1000


def test_the_controller_that_the_contract_page_adds_closes_the_loop(tmp_path):
    page = ROOT / "docs" / "contract.md"
    added = re.search(r'^   `"(\w+)": "([\w.]+):(\w+)",`$', page.read_text("utf-8"), re.M)
    name, module, function = added.groups()
    assert module == f"ballscrew.controllers.{name}"
    namespace: dict[str, object] = {"__name__": module}
    exec(compile(blocks(page, "python")[-1], page.name, "exec"), namespace)
    file = export(namespace[function](), tmp_path / f"{name}.fmu")
    result = run_closed_loop(Loop(str(file), stop=3.0))
    assert result.trusted
    assert result.run.outputs["x"][-1] == pytest.approx(0.08, abs=0.01)


@cache
def public() -> dict[str, list[object]]:
    """Functions and classes of the package by their names."""
    found: dict[str, list[object]] = {}
    for module in pkgutil.walk_packages(ballscrew.__path__, "ballscrew."):
        if module.name.endswith("__main__"):
            continue
        for name, thing in vars(importlib.import_module(module.name)).items():
            if callable(thing) and getattr(thing, "__module__", "").startswith("ballscrew"):
                found.setdefault(name, []).append(thing)
    return found


def calls_in_the_text() -> list[tuple[str, ast.Call]]:
    found = []
    for page in PAGES:
        prose = FENCE.sub("", page.read_text("utf-8"))
        for span in re.findall(r"`([^`\n]+)`", prose):
            try:
                expression = ast.parse(span, mode="eval").body
            except SyntaxError:
                continue
            if isinstance(expression, ast.Call):
                found.append((f"{page.name}: {span}", expression))
    return found


def test_a_call_in_the_text_fits_the_function_that_it_names():
    fitted = 0
    for where, call in calls_in_the_text():
        package, _, name = ast.unparse(call.func).rpartition(".")
        of_the_api = [getattr(ballscrew, name)] if package == "ballscrew" else []
        for thing in of_the_api or public().get(name, []):
            open_end = any(isinstance(a, ast.Constant) and a.value is ... for a in call.args)
            signature = inspect.signature(thing)
            bind = signature.bind_partial if open_end else signature.bind
            try:
                bind(*call.args, **{k.arg: k.value for k in call.keywords if k.arg})
            except TypeError as error:
                pytest.fail(f"{where}: {error}")
            fitted += 1
    assert fitted >= 3


def test_no_import_stands_in_the_text_where_no_test_would_run_it():
    spans = [
        (page.name, span)
        for page in PAGES
        for span in re.findall(r"`([^`\n]+)`", FENCE.sub("", page.read_text("utf-8")))
    ]
    assert [s for s in spans if re.match(r"(from \S+ )?import ", s[1])] == []

"""The page of a result: small, without scripts and requests, and its numbers are the files'."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from pages import ALL, HOSTILE, Page, check_hostile

import ballscrew
from ballscrew.cli import main
from ballscrew.loop_results import RunResult
from ballscrew.orchestration.master.march import LoopRun

COMMANDS = {
    "run": ["--controller", "nctf", "--stop", "20", "--set", "plant.Fc=1.3"],
    "swap": ["--controllers", "iol", "pid", "--stop", "0.5"],
    "lyapunov": ["--controller", "iol", "--stop", "2"],
    "map": "--controller iol --stop 0.5 --workers 1 --exponents --x sigma0_hat=66966:66968:3 "
    "--y sigma1_hat=340:350:2".split(),
    "rig": ["2.4/7"],
}
pytestmark = [pytest.mark.ci, pytest.mark.usefixtures("drawn")]
FACTORS = {"n": 1e-9, "µ": 1e-6, "m": 1e-3}


@pytest.fixture(scope="module")
def folders(tmp_path_factory, drawing):
    """A folder of each command, by its name."""
    found = {}
    for name, words in COMMANDS.items():
        found[name] = tmp_path_factory.mktemp(name) / "out"
        with drawing():
            assert main([name, *words, "--out", str(found[name])]) == 0
    return found


def page_of(folder):
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def number(text):
    """A quantity in its SI unit."""
    value, _, unit = text.partition(" ")
    prefixed = re.match(r"(n|µ|m)(m|A|rad)(?=$|[/*])", unit)
    return float(value) * (FACTORS[prefixed[1]] if prefixed else 1.0)


def test_the_numbers_of_a_run_are_those_of_metrics_json(folders):
    told = json.loads((folders["run"] / "metrics.json").read_text())
    rows = dict(page_of(folders["run"]).tables["metrics.json"][1:])
    assert set(rows) == {name.replace("_", " ") for name in told} - {"controller", "notes"}
    plain = {n: v for n, v in told.items() if isinstance(v, float)}
    assert len(plain) >= 8
    for name, value in plain.items():
        assert number(rows[name.replace("_", " ")]) == pytest.approx(value, rel=1e-5), name
    assert rows["overshoot"].endswith(" µm") or told["overshoot"] == 0.0


def test_values_have_units_and_what_is_not_the_default_is_marked(folders):
    page = page_of(folders["run"])
    rows = {row[0]: row[1:] for row in page.tables["Plant plant"]}
    assert rows["Fc"][:3] == ["1.3", "N", "1.284"]
    assert page.changed == ["Fc"]
    assert ["set-point", "80 mm"] in page.tables["The loop"]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_the_verdict_the_pictures_and_the_command_that_made_it(folders, name):
    page = page_of(folders[name])
    assert page.said.split(" trusted ")[1].startswith(page.headline)
    assert page.pictures == len(list(folders[name].glob("*.png")))
    assert f"Made by ballscrew {name} {COMMANDS[name][0]} " in page.said
    assert f"--out {folders[name]} , ballscrew " in page.said


def test_a_long_and_noisy_run_has_a_small_page():
    made, count = ballscrew.run("pid", stop=0.1), 200_000
    t = np.linspace(0.0, 20.0, count + 1)
    x = 0.08 + 1e-3 * np.random.default_rng(0).standard_normal(count + 1)
    changes = {"time": t, "outputs": {"x": x}, "commands": {"u": 100 * x}, "reference": 0 * t}
    assert Page(RunResult(made.loop, LoopRun(**vars(made.run) | changes)).report()).pictures == 1


def test_what_weakens_a_result_stands_below_its_headline():
    result = ballscrew.run("iol", stop=0.3, step=1e-4, coupling=ballscrew.Coupling.GAUSS_SEIDEL)
    page = Page(replace(result, notes=("a note",)).report())
    assert page.headline == f"iol, not converged: {result.run.verdict.reason}"
    assert "What weakens this: " in page.said
    assert page.said.index("not trusted") < page.said.index("a note") < page.said.index("metrics")
    assert "Made by ballscrew.run , ballscrew" in page.said


def test_names_that_are_meant_badly_stay_text():
    made = ballscrew.run("pid", stop=0.1)
    names = dict(zip(HOSTILE, [made.run.time] * len(HOSTILE), strict=True))
    units = dict.fromkeys((*HOSTILE, "x", "u"), ALL)
    run = replace(made.run, outputs=names, units=units, stopped=ALL)
    badly = replace(made, run=run, notes=HOSTILE)
    check_hostile(badly.report(f"ballscrew {ALL}"))
    assert not re.search("<(?!/?(?:p|b|ul|li|table|tr|td)>)", badly._repr_html_())
    swap = ballscrew.swap(["pid"], stop=0.1)
    units = {"x": HOSTILE[0], "u": HOSTILE[1]}
    only_units = replace(made, run=replace(made.run, units=units), notes=HOSTILE)
    check_hostile(replace(swap, results=(only_units,), failures=((ALL, ALL),)).report())


def test_letters_that_no_text_has_do_not_cost_the_page(tmp_path):
    ballscrew.run("pid", stop=0.1).save(tmp_path, command="ballscrew \udcff")
    assert "ballscrew ?" in (tmp_path / "report.html").read_text(encoding="utf-8")

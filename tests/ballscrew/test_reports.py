"""Pages of run, swap, lyapunov and map: what they say, in a browser, made of what others say."""

from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import PROGRAM, opened
from hostile import ALL, HOSTILE, check_in_browser, check_text
from waiting import wait_for

import ballscrew
from ballscrew.cli import main
from ballscrew.orchestration.loop_run import LoopRun
from ballscrew.orchestration.page import MOST
from ballscrew.orchestration.pictures import until_rest
from ballscrew.results.run_result import RunResult

browser = pytest.mark.skipif(PROGRAM is None, reason="no chromium here: apt-get install chromium")
COMMANDS = {
    "run": ["--controller", "nctf", "--stop", "20", "--set", "plant.Fc=1.3"],
    "swap": ["--controllers", "iol", "pid", "--stop", "0.5"],
    "lyapunov": ["--controller", "iol", "--stop", "2"],
    "map": "--controller iol --stop 0.5 --workers 1 --exponents --x sigma0_hat=66966:66968:3 "
    "--y sigma1_hat=340:350:2".split(),
}
pytestmark = pytest.mark.ci
FACTORS = {"n": 1e-9, "µ": 1e-6, "m": 1e-3}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A folder of each command, by its name."""
    found = {}
    for name, words in COMMANDS.items():
        found[name] = tmp_path_factory.mktemp(name) / "out"
        assert main([name, *words, "--out", str(found[name])]) == 0
    return found


def page_of(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def figures_of(page):
    return json.loads(re.search(r"^  const FIGURES = (.*);$", page, re.M)[1])


def tables_of(page):
    """Rows of each table by its title."""
    found = {}
    for title, body in re.findall(
        r"<h3>([^<]*)</h3>\s*<div class=\"wide.*?<table>(.*?)</table>", page, re.S
    ):
        rows = re.findall(
            r"<tr( class=\"changed\")?><th scope=\"row\">(.*?)</th>(.*?)</tr>", body, re.S
        )
        cells = [[first, *re.findall(r"<td>(.*?)</td>", rest, re.S)] for _, first, rest in rows]
        found[html.unescape(title)] = [list(map(html.unescape, row)) for row in cells]
        found[title + " changed"] = [first for mark, first, _ in rows if mark]
    return found


def number(text):
    """A quantity in its SI unit."""
    value, _, unit = text.partition(" ")
    prefixed = re.match(r"(n|µ|m)(m|A|rad)(?=$|[/*])", unit)
    return float(value) * (FACTORS[prefixed[1]] if prefixed else 1.0)


def numbers(values):
    """A curve as the page has it."""
    return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"])


def test_the_numbers_of_a_run_are_those_of_metrics_json(folders):
    told = json.loads((folders["run"] / "metrics.json").read_text())
    rows = dict(tables_of(page_of(folders["run"]))["metrics.json"])
    assert set(rows) == {name.replace("_", " ") for name in told} - {"controller", "notes"}
    plain = {n: v for n, v in told.items() if isinstance(v, float)}
    assert len(plain) >= 8
    for name, value in plain.items():
        assert number(rows[name.replace("_", " ")]) == pytest.approx(value, rel=1e-5), name
    assert rows["overshoot"].endswith(" µm") or told["overshoot"] == 0.0


def test_values_have_units_and_what_is_not_the_default_is_marked(folders):
    page = page_of(folders["run"])
    tables = tables_of(page)
    rows = {row[0]: row[1:] for row in tables["Plant plant"]}
    assert rows["Fc"][:3] == ["1.3", "N", "1.284"]
    assert tables["Plant plant changed"] == ["Fc"]
    assert tables["Controller nctf changed"] == []
    assert ["set-point", "80 mm"] in tables["The loop"]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_the_verdict_and_the_command_that_made_it(folders, name):
    page = page_of(folders[name])
    assert '<p class="verdict">trusted</p>' in page
    made = html.unescape(re.search(r"<code>(.*?)</code>", page)[1])
    assert made.startswith(f"ballscrew {name} {COMMANDS[name][0]} ")
    assert made.endswith(f"--out {folders[name]}")
    assert len(page) < 5.4e6  # plotly's script is 4.8


def long_run(count=200_000):
    t = np.linspace(0.0, 20.0, count + 1)
    x = 0.08 + 1e-3 * np.random.default_rng(0).standard_normal(count + 1)
    x[[77_777, 123_456]] = 0.2, -0.1
    run = ballscrew.run("pid", stop=0.1).run
    return LoopRun(
        **vars(run)
        | {"time": t, "outputs": {"x": x}, "commands": {"u": 100 * x}, "reference": 0 * t}
    )


def test_long_courses_are_thinned_say_so_and_keep_their_peaks():
    made = ballscrew.run("pid", stop=0.1)
    run = long_run()
    assert until_rest(run) == 20.0
    page = RunResult(made.loop, run).report()
    assert len(page) < 5.2e6
    first = figures_of(page)[0]
    values = numbers(first["data"][0]["y"])
    assert len(values) <= MOST
    assert f"{len(values)} of 200001 points" in first["says"]
    assert first["layout"]["yaxis"]["title"]["text"] == "position x [mm]"
    assert (values.max(), values.min()) == pytest.approx((200.0, -100.0))


def test_what_weakens_a_result_stands_below_its_headline():
    result = ballscrew.run("iol", stop=0.3, step=1e-4, coupling=ballscrew.Coupling.GAUSS_SEIDEL)
    page = replace(result, notes=("a note",)).report()
    assert '<p class="verdict doubt">not trusted</p>' in page
    assert "<h1>iol: not converged</h1>" in page
    assert html.escape(result.run.verdict.reason, quote=True) in page
    assert '<li class="weak">a note</li>' in page
    assert "From Python, by <code>ballscrew.run</code>" in page


# -- names that are meant badly --------------------------------------------------------------


def hostile(name):
    """A result of a command whose names, units and notes are meant badly."""
    if name == "run":
        made = ballscrew.run("pid", stop=0.1)
        names = dict(zip(HOSTILE, [made.run.time] * len(HOSTILE), strict=True))
        units = dict.fromkeys((*HOSTILE, "x", "u"), ALL)
        return replace(
            made, run=replace(made.run, outputs=names, units=units, stopped=ALL), notes=HOSTILE
        )
    made = ballscrew.swap(["pid", "iol"], stop=0.1)
    units = {"x": ALL, "u": ALL}
    runs = [replace(r, run=replace(r.run, units=units), notes=HOSTILE) for r in made.results]
    return replace(made, results=tuple(runs), failures=((ALL, ALL),))


@pytest.mark.parametrize("name", ["run", "swap"])
def test_what_is_meant_badly_stays_text_and_does_nothing_in_a_browser(name, tmp_path):
    hostile(name).save_report(tmp_path, f"ballscrew {ALL}")
    check_text(page_of(tmp_path))
    if PROGRAM:
        check_in_browser(tmp_path / "report.html")


def test_letters_that_no_text_has_do_not_cost_the_page(tmp_path):
    ballscrew.run("pid", stop=0.1).save_report(tmp_path, "ballscrew \udcff")
    assert "ballscrew ?" in page_of(tmp_path)


# -- in a browser ----------------------------------------------------------------------------


@browser
def test_a_telephone_shows_all_of_a_report_without_a_request_or_an_error(folders):
    path = folders["run"] / "report.html"
    with opened(path, width=390) as page:
        drawn = "document.documentElement.dataset.pictures"
        wait_for(lambda: page.evaluate(drawn), 60.0)
        assert page.evaluate(drawn) == str(len(figures_of(page_of(folders["run"]))))
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.errors == []
        asked = [r for r in page.requests if not r.startswith("data:")]
        assert asked == [path.resolve().as_uri()]

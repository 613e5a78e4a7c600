"""Pages of run, swap, lyapunov and map: what they say, in a browser, made of what others say."""

from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
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
PICTURES = {"run": 7, "swap": 3, "lyapunov": 5, "map": 4}
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


def test_the_numbers_of_a_swap_are_those_of_comparison_json(folders):
    told = json.loads((folders["swap"] / "comparison.json").read_text())
    rows = tables_of(page_of(folders["swap"]))["comparison.json"]
    assert [row[0] for row in rows] == ["iol", "pid"]
    for figures, row in zip(told, rows, strict=True):
        assert number(row[1]) == pytest.approx(figures["peak_voltage"], rel=1e-5)
        assert number(row[6]) == pytest.approx(figures["iae"], rel=1e-5)


def test_the_exponents_are_those_of_lyapunov_json_with_their_errors_over_time(folders):
    told = json.loads((folders["lyapunov"] / "lyapunov.json").read_text())
    page = page_of(folders["lyapunov"])
    rows = tables_of(page)["Exponents"]
    for key, column in (
        ("exponents_bits_per_s", 1),
        ("exponents_error_bits_per_s", 2),
        ("asymptotic_bits_per_s", 3),
        ("asymptotic_error_bits_per_s", 4),
    ):
        assert [float(r[column]) for r in rows] == pytest.approx(told[key], rel=6e-3), key
    estimates = np.genfromtxt(folders["lyapunov"] / "lyapunov.csv", delimiter=",", names=True)
    ends = sorted((estimates[f"lambda{k + 1}_bits_per_s"][-1] for k in range(4)), reverse=True)
    for k, figure in enumerate(figures_of(page)[:4]):
        curve, band, limit, _ = figure["data"]
        y = numbers(curve["y"])
        assert y[-1] == pytest.approx(ends[k], rel=1e-6)
        around = numbers(band["y"])
        width = (
            around[len(around) // 2 - 1] - around[len(around) // 2]
        )  # at the end, there and back
        error = told["exponents_error_bits_per_s"][k]
        assert width == pytest.approx(2 * error, abs=1e-6 * abs(y[-1]) + 1e-9)
        assert numbers(limit["y"])[0] == pytest.approx(
            told["asymptotic_bits_per_s"][k], abs=1e-9, rel=1e-6
        )


def test_a_map_has_all_panels_with_titles_and_the_counts_of_map_json(folders):
    told = json.loads((folders["map"] / "map.json").read_text())
    page = page_of(folders["map"])
    assert {n: int(c) for n, c in tables_of(page)["Verdicts"]} == told["verdicts"]
    assert re.findall(r"<figure id=\"\w+\">\s*<h3>(.*?)</h3>", page) == [
        "iol: how the motion ends",
        "Distance to the set-point at the end",
        "Amplitude at the end",
        "Largest Lyapunov exponent",
    ]
    verdict = figures_of(page)[0]["data"][0]
    words = [word for row in verdict["text"] for word in row]
    assert {w: words.count(w) for w in words} == told["verdicts"]
    axes = figures_of(page)[0]["layout"]
    assert axes["xaxis"]["title"]["text"] == "sigma0_hat [N/m]"
    assert verdict["x"] == pytest.approx([66966.0, 66967.0, 66968.0])


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


@pytest.mark.parametrize("name", COMMANDS)
def test_plotly_knows_every_property_and_axes_have_units(folders, name):
    for figure in figures_of(page_of(folders[name])):
        drawn = go.Figure({"data": figure["data"], "layout": figure["layout"]})
        for axis in ("xaxis", "yaxis"):
            assert re.search(r"\[.+\]$", drawn.layout[axis].title.text)


def test_a_controller_has_one_style_in_all_pictures_of_a_swap(folders):
    styles = [
        {t["name"]: (t["meta"], t["line"]["dash"]) for t in figure["data"]}
        for figure in figures_of(page_of(folders["swap"]))
    ]
    for found in styles:
        assert (found["iol"], found["pid"]) == (("c0", "solid"), ("c1", "dash"))


def test_pictures_end_when_all_rests_and_say_how_long_the_run_is(folders):
    figures = figures_of(page_of(folders["run"]))
    times = numbers(figures[0]["data"][0]["x"])
    assert times[0] == 0.0
    assert 2.0 < times[-1] < 19.0
    assert "the run goes on to 20 s" in figures[0]["says"]


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


def hostile(name, folder):
    """A result of a command whose names, units and notes are meant badly."""
    if name == "run":
        made = ballscrew.run("pid", stop=0.1)
        names = dict(zip(HOSTILE, [made.run.time] * len(HOSTILE), strict=True))
        units = dict.fromkeys((*HOSTILE, "x", "u"), ALL)
        run = replace(made.run, outputs=made.run.outputs | names, units=units, stopped=ALL)
        run = replace(run, outputs=dict(reversed(run.outputs.items())))
        run = replace(run, outputs={n: v for n, v in run.outputs.items() if n in HOSTILE})
        return replace(made, run=run, notes=HOSTILE)
    if name == "swap":
        made = ballscrew.swap(["pid", "iol"], stop=0.1)
        runs = [
            replace(r, run=replace(r.run, units={"x": ALL, "u": ALL}), notes=HOSTILE)
            for r in made.results
        ]
        return replace(made, results=tuple(runs), failures=((ALL, ALL),))
    if name == "lyapunov":
        made = ballscrew.lyapunov("iol", stop=0.5)
        names = [*HOSTILE[:4]]
        evil = replace(made.motion, evidence=ALL, amplitude=dict.fromkeys(names, 1.0))
        return replace(made, label=ALL, names=names, motion=evil)
    axes = {"x": "sigma0_hat=66966:66968:2", "y": "sigma1_hat=340:350:2"}
    made = ballscrew.stability_map("iol", **axes, folder=folder, stop=0.2)
    plan = made.summary.plan
    plan = replace(plan, x=replace(plan.x, name=ALL))
    return replace(
        made, summary=replace(made.summary, plan=plan, notes=HOSTILE, undecided={ALL: 1})
    )


@pytest.fixture(scope="module", params=COMMANDS)
def evil(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("evil")
    hostile(request.param, folder / "map").save_report(folder, f"ballscrew {ALL}")
    return request.param, folder


def test_what_is_meant_badly_stays_text(evil):
    check_text(page_of(evil[1]))


@browser
def test_what_is_meant_badly_does_nothing_in_a_browser(evil):
    name, folder = evil
    check_in_browser(folder / "report.html", in_pictures=name != "lyapunov")


def test_cells_that_are_undecided_are_in_the_badge_and_the_headline(tmp_path):
    axes = {"x": "sigma0_hat=66966:66968:2", "y": "sigma1_hat=340:350:2"}
    made = ballscrew.stability_map("iol", **axes, folder=tmp_path, stop=0.2)
    verdicts = {"limit cycle": 1, "undecided": 3}
    summary = replace(made.summary, verdicts=verdicts, undecided={"a reason": 3})
    page = replace(made, summary=summary).report()
    assert '<p class="verdict doubt">3 of 4 undecided</p>' in page
    assert "<h1>4 loops of iol: 3 undecided, 1 limit cycle</h1>" in page
    assert '<li class="weak">3 cells are undecided: a reason</li>' in page


def test_letters_that_no_text_has_do_not_cost_the_page(tmp_path):
    ballscrew.run("pid", stop=0.1).save_report(tmp_path, "ballscrew \udcff")
    assert "ballscrew ?" in page_of(tmp_path)


# -- in a browser ----------------------------------------------------------------------------


@browser
@pytest.mark.parametrize("name", COMMANDS)
def test_a_telephone_shows_all_of_it_and_a_drag_zooms(folders, name):
    path = folders[name] / "report.html"
    with opened(path, width=390) as page:
        wait_for(lambda: page.evaluate("document.documentElement.dataset.pictures"), 60.0)
        assert page.evaluate("document.documentElement.dataset.pictures") == str(PICTURES[name])
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        sizes = page.evaluate(
            "[...document.querySelectorAll('main h1, main p, main td, main figcaption, svg text')]"
            ".map(e => parseFloat(getComputedStyle(e).fontSize))"
        )
        assert min(sizes) >= 12
        over = page.evaluate(
            "[...document.querySelectorAll('figure')].filter(f => {"
            "const axes = f.querySelector('.ytitle').getBoundingClientRect();"
            "return [...f.querySelectorAll('.ytick text')].some("
            "t => t.getBoundingClientRect().left < axes.right - 1);}).length"
        )
        assert over == 0  # titles of axes stand beside their numbers
        first = page.evaluate("document.querySelector('figure').id")
        page.evaluate(f"document.getElementById('{first}').scrollIntoView({{block: 'center'}})")
        shown = f"document.querySelector('#{first} .plot').layout.xaxis.range"
        area = f"document.querySelector('#{first} .nsewdrag').getBoundingClientRect()"
        x, y, width, height = page.evaluate(f"(r => [r.x, r.y, r.width, r.height])({area})")
        before = page.evaluate(shown)
        held = {"button": "left", "clickCount": 1}
        page.mouse("mousePressed", x + 0.3 * width, y + 0.3 * height, **held)
        page.mouse("mouseMoved", x + 0.7 * width, y + 0.7 * height, button="left", buttons=1)
        page.mouse("mouseReleased", x + 0.7 * width, y + 0.7 * height, **held)
        wait_for(lambda: page.evaluate(shown) != before, 60.0)
        low, high = page.evaluate(shown)
        assert high - low == pytest.approx(0.4 * (before[1] - before[0]), rel=0.05)
        assert page.errors == []
        asked = [r for r in page.requests if not r.startswith("data:")]
        assert asked == [path.resolve().as_uri()]

"""The page: opened in a real browser, read by an engineer, made of what others' files say."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from browser import PROGRAM, opened
from hostile import ALL, HOSTILE, check_in_browser, check_text
from waiting import wait_for

from ballscrew.diagnosis.causes import CAUSES
from ballscrew.diagnosis.closed_loop_effect import (
    NoClosedLoop,
    closed_loop_effect,
)
from ballscrew.diagnosis.diagnosis import (
    Curves,
    Diagnosis,
    FoundCause,
    Level,
    NextExperiment,
    SuspectFound,
)
from ballscrew.diagnosis.diagnosis_pictures import binned, end_to_end, pictures_of, smoothed
from ballscrew.diagnosis.diagnosis_report import ClosedLoopSection, report
from ballscrew.diagnosis.drive import Drive
from ballscrew.diagnosis.experiment_motions import Motion
from ballscrew.diagnosis.load_cell import ValidationSignal
from ballscrew.diagnosis.next_experiment import trial_for
from ballscrew.diagnosis.report_words import rig_command, suspect_lines
from ballscrew.orchestration.page import MOST, plotly_figure, thinned

pytestmark = pytest.mark.xdist_group("diagnosis")
browser = pytest.mark.skipif(PROGRAM is None, reason="no chromium here: apt-get install chromium")

PICTURES = [
    "force",
    "residual_time",
    "residual_position",
    "residual_velocity",
    "position_residual",
    "causes",
    "loop",
    "loop_difference",
]


# -- in a browser ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(diagnosed):
    with opened(diagnosed.folder / "report.html") as made:
        wait_for(lambda: drawn(made))
        yield made


def drawn(page):
    """How many pictures the page's script has drawn, once they all are there."""
    return page.evaluate("document.documentElement.dataset.pictures")


def box(page, name):
    """Middle and size of a plot's area within its axes, brought into the window."""
    page.evaluate(f"document.getElementById('{name}').scrollIntoView({{block: 'center'}})")
    return page.evaluate(
        f"(() => {{const r = document.querySelector('#{name} .nsewdrag').getBoundingClientRect();"
        "return [r.x + r.width / 2, r.y + r.height / 2, r.width, r.height];})()"
    )


def ranges(page, name):
    """Ends of the axes shown, of x and y."""
    plot = f"document.querySelector('#{name} .plot')"
    return page.evaluate(f"['xaxis', 'yaxis'].map(axis => {plot}.layout[axis].range)")


def numbers(page, name):
    found = page.evaluate(
        f"[...document.querySelectorAll('#{name} .xtick text')].map(t => t.textContent)"
    )
    return sorted(float(text.replace("\u2212", "-")) for text in found)


def drag(page, start, end):
    held = {"button": "left", "clickCount": 1}
    page.mouse("mousePressed", *start, **held)
    page.mouse("mouseMoved", *end, button="left", buttons=1)
    page.mouse("mouseReleased", *end, **held)


def click(page, x, y, times):
    page.mouse("mouseMoved", x, y)
    for count in range(1, times + 1):
        page.mouse("mousePressed", x, y, button="left", clickCount=count)
        page.mouse("mouseReleased", x, y, button="left", clickCount=count)


@browser
def test_the_script_runs_and_every_picture_is_there(page):
    assert drawn(page) == str(len(PICTURES))
    ids = page.evaluate("[...document.querySelectorAll('figure')].map(f => f.id)")
    assert ids == PICTURES
    for name in PICTURES:
        _, _, width, height = box(page, name)
        assert width > 500
        assert height > 150
        lengths = page.evaluate(
            f"[...document.querySelectorAll('#{name} .scatterlayer .trace')].map(trace =>"
            "[...trace.querySelectorAll('path')].reduce((sum, p) => sum + p.getTotalLength(), 0))"
        )
        assert lengths
        assert min(lengths) > 100
        assert len(numbers(page, name)) >= 3


@browser
@pytest.mark.parametrize("name", ["force", "residual_time", "loop"])
def test_a_drag_zooms_and_a_double_click_goes_back(page, name):
    home, ticks = ranges(page, name), numbers(page, name)
    x, y, width, height = box(page, name)
    drag(page, (x - 0.2 * width, y - 0.3 * height), (x + 0.2 * width, y + 0.3 * height))
    wait_for(lambda: ranges(page, name) != home)
    for (low, high), (first, last), share in zip(ranges(page, name), home, (0.4, 0.6), strict=True):
        assert high - low == pytest.approx(share * (last - first), rel=0.02)
        assert first < low < high < last
    closer = numbers(page, name)
    assert max(closer) - min(closer) < max(ticks) - min(ticks)
    click(page, x, y, times=2)
    wait_for(lambda: ranges(page, name) == home)
    wait_for(lambda: numbers(page, name) == ticks)


@browser
def test_the_buttons_zoom_and_go_back(page):
    home = ranges(page, "force")
    box(page, "force")
    for title, narrower in (("Zoom in", True), ("Reset axes", False)):
        x, y = page.evaluate(
            f"(() => {{const r = document.querySelector('#force [data-title=\"{title}\"]')"
            ".getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2];})()"
        )
        click(page, x, y, times=1)
        wait_for(lambda narrower=narrower: (ranges(page, "force") != home) == narrower)
    assert ranges(page, "force") == home


@browser
def test_no_button_sends_what_was_measured_to_others(page):
    buttons = page.evaluate(
        "[...document.querySelectorAll('#force .modebar-btn')].map(b => b.dataset.title || '')"
    )
    assert "Zoom in" in buttons
    assert [b for b in buttons if "hare" in b or "loud" in b or "lotly" in b] == []
    assert page.evaluate("document.querySelectorAll('a[href^=http]').length") == 0


@browser
def test_the_wheel_over_a_plot_scrolls_the_page(page):
    x, y, *_ = box(page, "force")
    home = ranges(page, "force")
    before = page.evaluate("scrollY")
    page.mouse("mouseWheel", x, y, deltaX=0, deltaY=200)
    wait_for(lambda: page.evaluate("scrollY") > before)
    assert ranges(page, "force") == home


@browser
def test_a_picture_is_told_to_those_who_do_not_see_it(page):
    for name in PICTURES:
        told = page.evaluate(
            f"[...document.querySelectorAll('#{name} .main-svg')]"
            ".map(s => [s.getAttribute('role'), s.getAttribute('aria-label') || ''])"
        )
        title = page.evaluate(f"document.querySelector('#{name} h3').textContent")
        assert [label for role, label in told if role == "img"] == [title]
        assert {role for role, _ in told} <= {"img", "presentation"}


@browser
def test_a_printed_page_has_the_plots_in_the_width_of_paper_and_in_black_on_white(page):
    box(page, "force")
    before = ranges(page, "force")
    page.call("Emulation.setEmulatedMedia", media="print")
    width = "+document.querySelector('#force .main-svg').getAttribute('width')"
    wait_for(lambda: page.evaluate(width) < 700)
    assert contrast(rgb(page, "#force .xtick text", "fill"), [1.0, 1.0, 1.0]) >= 4.5
    assert ranges(page, "force") == before
    page.call("Emulation.setEmulatedMedia", media="")
    wait_for(lambda: page.evaluate(width) > 700)


@browser
def test_nothing_is_asked_of_a_network_and_nothing_is_complained_of(page, diagnosed):
    assert page.requests == [(diagnosed.folder / "report.html").resolve().as_uri()]
    assert page.errors == []


@browser
def test_the_browser_refuses_what_a_script_of_the_page_would_ask_of_a_network(diagnosed):
    with opened(diagnosed.folder / "report.html") as other:
        other.evaluate(
            "addEventListener('securitypolicyviolation', e => {refused = e.effectiveDirective});"
            "var refused = ''; fetch('http://127.0.0.1:9/').catch(() => 0); 0"
        )
        wait_for(lambda: other.evaluate("refused") == "connect-src")


@browser
def test_a_model_has_one_colour_in_all_pictures(page):
    colours = {"before": set(), "after": set()}
    for name in ("force", "residual_time", "position_residual", "residual_position"):
        traces = page.evaluate(
            f"JSON.stringify(document.querySelector('#{name} .plot')._fullData"
            ".map(t => [t.meta, t.line.color]))"
        )
        for what, colour in json.loads(traces):
            colours.setdefault(what, set()).add(colour)
    assert all(len(found) == 1 for found in colours.values()), colours
    assert colours["before"] != colours["after"]


@browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_what_is_written_can_be_read_in_light_and_in_dark(page, scheme):
    """WCAG's contrast of 4.5 for text, 3 for lines, against the page's own background."""
    page.call(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}]
    )
    paper = rgb(page, "body", "backgroundColor")
    for selector in ("h1", "figcaption", "td", "dd", "footer"):
        assert contrast(rgb(page, selector, "color"), paper) >= 4.5, selector
    wait_for(lambda: contrast(rgb(page, ".xtick text", "fill"), paper) >= 4.5)
    for name, curves in (("force", ("measured", "before", "after")), ("causes", ("cause",))):
        for k, colour in enumerate(curves, 1):
            line = f"#{name} .trace:nth-child({k}) path.js-line"
            assert contrast(rgb(page, line, "stroke"), paper) >= 3.0, colour
    page.call("Emulation.setEmulatedMedia", features=[])
    assert (sum(paper) > 1.5) == (scheme == "light")


@browser
@pytest.mark.parametrize("width", [360, 1100])
def test_the_page_is_no_wider_than_its_window(diagnosed, width):
    with opened(diagnosed.folder / "report.html", width=width) as narrow:
        assert narrow.evaluate("document.documentElement.scrollWidth") <= width


@browser
def test_a_finger_on_a_plot_is_left_to_scroll_the_page(diagnosed):
    with opened(diagnosed.folder / "report.html", width=360, touch=True) as phone:
        wait_for(lambda: drawn(phone))
        x, y, *_ = box(phone, "force")
        home = ranges(phone, "force")
        phone.evaluate(
            "window.kept = []; for (const kind of ['touchstart', 'touchmove'])"
            "addEventListener(kind, event => kept.push([kind, event.defaultPrevented]))"
        )
        for kind, up in (("Start", 0), ("Move", 40), ("Move", 80)):
            points = [{"x": x, "y": y - up}]
            phone.call("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
        phone.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        kept = phone.evaluate("kept")
        assert ["touchstart", False] in kept  # left to the browser, which scrolls
        assert not any(prevented for _, prevented in kept)
        assert ranges(phone, "force") == home
        assert phone.errors == []


def rgb(page, selector, name):
    text = page.evaluate(f"getComputedStyle(document.querySelector('{selector}')).{name}")
    return [int(part) / 255 for part in re.findall(r"\d+", text)[:3]]


def contrast(first, second):
    def light(colour):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
        return float(np.dot([0.2126, 0.7152, 0.0722], linear))

    low, high = sorted((light(first), light(second)))
    return (high + 0.05) / (low + 0.05)


# -- what it says ----------------------------------------------------------------------------


def found(**changes) -> Diagnosis:
    """A diagnosis made by hand, of two short records."""
    n = 3000
    random = np.random.default_rng(0)
    zero, noise = np.zeros(n), random.standard_normal(n)
    record = np.repeat([0, 1], n // 2)
    x = np.tile(np.sin(np.linspace(0, 12, n // 2)), 2) * 1e-2
    curves = Curves(
        time=np.tile(np.arange(n // 2) * 1e-3, 2),
        record=record,
        x=x,
        v=np.gradient(x, 1e-3),
        force=noise,
        predicted=zero,
        before=noise,
        after=0.1 * noise,
        position_before=1e-6 * noise,
        position_after=1e-7 * noise,
        cause=zero,
        shape=changes.pop("shape", zero),
        telling=np.ones(n, dtype=bool),
    )
    cause = FoundCause(
        name="backlash",
        says="a gap between screw and block",
        parameters={"gap": 1.234e-5},
        intervals={"gap": (1.1e-5, 1.4e-5)},
        units={"gap": "m"},
        probability=0.97,
        force=0.66,
        of_friction=0.5,
        certain=changes.pop("certain", True),
        gain_heldout=0.4321,
        gain_interval=(0.4, 0.46),
        gain_alone=0.4321,
        before=Level(1.0, 2e-6),
        after=Level(0.75, 1e-6),
        confirm="slow reversals",
    )
    model = Drive("ball_screw", "modified_lugre", {"Fc": 1.25, "Jm": 4e-7}, {"Fc": 0.03})
    given = {
        "verdict": "explained",
        "where": "It lives at reversals.",
        "floor": Level(0.1, 1e-7),
        "baseline_residual": Level(1.0, 2e-6),
        "adjusted_residual": Level(1.0, 2e-6),
        "final_residual": Level(0.75, 1e-6),
        "left_of_friction": 0.6,
        "gain_interval": (0.4, 0.46),
        "held_out": "5 parts",
        "causes": (cause,),
        "suspects": (),
        "unnamed": (),
        "out_of_reach": (),
        "next_experiment": NextExperiment(
            "slow reversals tell it from compliance", MOTION, "2.4/1"
        ),
        "prior": model,
        "adjusted": model.changed({"Fc": 1.26}),
        "corrected": model.changed({"Fc": 1.275}),
        "command": "voltage",
        "command_shift": 0.0,
        "adjustments": {"Fc": 0.02},
        "noise": {"force_N": 0.1, "voltage_N": 0.02},
        "load_cell": None,
        "records": ("run.csv",),
        "curves": curves,
        "seconds": 1.0,
        "notes": (),
        **changes,
    }
    return Diagnosis(**given)


MOTION = Motion(
    kind="slow reversals",
    says="strokes of 1 mm to and fro",
    reference="x_d",
    time=np.array([0.0, 1.0, 2.0]),
    values=np.array([0.0, 1e-3, 0.0]),
    amplitude=5e-4,
    speeds=(1e-3,),
    record=("time", "u", "x"),
    sampling=1e-3,
)


def text_of(page):
    """What a reader sees, as one line."""
    return " ".join(re.sub(r"<(style|script).*?</\1>|<[^>]+>", " ", page, flags=re.S).split())


def test_what_the_load_cell_says_is_told_where_there_was_one():
    assert "load cell" not in text_of(report(found(), NO_LOOP))
    said = text_of(report(found(load_cell=ValidationSignal(0.41, 0.12)), NO_LOOP))
    assert "model by 0.41 N rms, and off that of the corrected one by 0.12 N" in said


NO_LOOP = ClosedLoopSection(None, "The solver cannot continue.")


def test_a_cause_is_told_with_size_gain_doubt_and_what_would_confirm_it():
    said = text_of(report(found(), NO_LOOP))
    for words in (
        "backlash explains the error of the model",
        "a gap between screw and block",
        "1.234e-05 1.1e-05 to 1.4e-05 m",
        "43.2 % of the mean square in force (40 % to 46 %)",
        "75 % in position",
        "probability 0.97; for records like those of the calibration, at most 2 of 100",
        "0.66 N rms, 50 % of the friction",
        "would confirm it slow reversals",
        "For this machine: strokes of 1 mm to and fro. Command file: next_experiment.csv",
        "ballscrew rig 2.4/1 --params parameters.toml --out",
        "Fc 1.25 1.275 +2 % 3 % N",
        "The solver cannot continue.",
    ):
        assert words in said, words


def test_the_next_experiments_command_file_stands_beside_the_diagnosis(tmp_path):
    found().save(tmp_path)
    told = json.loads((tmp_path / "diagnosis.json").read_text())["next_experiment"]
    assert told["trial"] == "2.4/1"
    assert told["motion"]["file"] == "next_experiment.csv"
    assert told["motion"]["duration_s"] == 2.0
    lines = (tmp_path / told["motion"]["file"]).read_text().splitlines()
    assert lines == ["time,x_d", "0,0", "1,0.001", "2,0"]
    found(next_experiment=None).save(tmp_path / "other")
    assert [p.name for p in (tmp_path / "other").iterdir()] == ["diagnosis.json"]


def test_noise_is_told_in_words_with_its_units():
    said = text_of(report(found(), NO_LOOP))
    assert "balance of force, rms 0.1 N" in said
    assert "balance of voltage, converted to a force, rms 0.02 N" in said


def test_before_and_after_stand_against_the_floor():
    said = text_of(report(found(), NO_LOOP))
    assert "prior model 1 N 10 2 µm 20" in said
    assert "with all causes found * 0.75 N 7.5 1 µm 10" in said
    assert "noise alone (floor) 0.1 N 1 0.1 µm 1" in said


def test_what_does_worse_on_data_held_out_is_said_not_to_be_relied_on():
    for worse in ({"final_residual": Level(0.75, 1e-2)}, {"gain_interval": (-0.1, 0.3)}):
        said = text_of(report(found(verdict="partly", **worse), NO_LOOP))
        assert "Do not rely on it" in said
        assert "backlash explains the data best, but this is not confirmed" in said
    assert "Do not rely on it" not in text_of(report(found(), NO_LOOP))


def test_a_gain_that_ends_above_the_floor_is_said_with_what_is_left():
    said = text_of(report(found(verdict="partly"), NO_LOOP))
    assert "backlash explains part of the error of the model" in said
    assert "0.75 N of" in said
    assert "more than twice the 0.1 N of noise" in said
    assert "may be worse" not in said


@pytest.mark.parametrize(
    ("verdict", "changes", "words"),
    [
        ("none", {"causes": ()}, "These records show no error of the model"),
        ("partly", {"unnamed": ("with time",)}, "backlash explains part of the error"),
        ("unexplained", {"causes": (), "unnamed": ("with time",)}, "no cause is certain"),
    ],
)
def test_each_verdict_is_a_sentence(verdict, changes, words):
    said = text_of(report(found(verdict=verdict, **changes), NO_LOOP))
    assert words in said
    assert ("it varies with time" in said.lower()) == ("unnamed" in changes)


def test_suspects_are_told_with_size_force_and_what_would_confirm_them():
    scale = SuspectFound(
        name="scale_of_u",
        says="the recorded command has a wrong scale",
        probability=0.75,
        parameters={"scale_of_u": 0.577},
        intervals={"scale_of_u": (0.57, 0.59)},
        units={"scale_of_u": "1"},
        force=39.0,
        of_friction=7.5,
        confirm="measure the voltage at the motor with a meter",
    )
    other = replace(scale, name="outside the catalogue", parameters={}, intervals={}, units={})
    changes = {"causes": (), "suspects": (scale, other)}
    said = text_of(report(found(verdict="unexplained", **changes), NO_LOOP))
    assert "It is one of scale of u or outside the catalogue." in said
    assert "The command fits with a factor of 0.577: check its unit." in said
    for words in (
        "scale_of_u = 0.577",
        "0.57 to 0.59",
        "39 N",
        "7.5 times",
        "0.75",
        "with a meter",
    ):
        assert words in said
    lines = "\n".join(suspect_lines((scale, other)))
    assert "scale_of_u = 0.577  0.57 .. 0.59" in lines
    assert "39 N rms, 7.5 times the friction" in lines


def test_what_is_built_in_and_not_certain_is_no_name():
    said = text_of(report(found(verdict="unexplained", certain=False), NO_LOOP))
    assert "no cause is certain" in said
    assert "The most probable one, backlash, is built in" in said
    assert "backlash explains" not in said


def test_structure_without_a_name_has_its_shape_shown():
    page = report(found(verdict="partly", unnamed=("at reversals",), shape=np.ones(3000)), NO_LOOP)
    assert "no known cause" in page
    assert '"meta": "shape"' in page
    assert '"meta": "shape"' not in report(found(), NO_LOOP)


def test_what_a_stranger_s_file_says_does_not_become_part_of_the_page():
    name = "<script>alert(1)</script>&amp;.csv"
    page = report(found(records=(name,), notes=(f"{name}: clipped?",)), NO_LOOP)
    assert "<script>alert" not in page
    assert page.count("&lt;script&gt;alert(1)&lt;/script&gt;&amp;amp;.csv") == 2


@pytest.fixture(scope="module")
def evil(tmp_path_factory):
    """A page whose names, units and sentences are all meant badly."""
    cause = replace(
        found().causes[0],
        name=ALL,
        says=ALL,
        confirm=ALL,
        parameters={ALL: 1.0},
        intervals={ALL: (0.9, 1.1)},
        units={ALL: ALL},
    )
    changes = {"causes": (cause,), "records": HOSTILE, "notes": HOSTILE, "where": ALL}
    path = tmp_path_factory.mktemp("evil") / "report.html"
    path.write_text(report(found(**changes), ClosedLoopSection(None, ALL)), encoding="utf-8")
    return path


def test_names_that_are_meant_badly_stay_text(evil):
    check_text(evil.read_text(encoding="utf-8"))


@browser
def test_names_that_are_meant_badly_do_nothing_in_a_browser(evil):
    check_in_browser(evil, in_pictures=False)  # whose texts are all our own


@pytest.mark.parametrize("trial", sorted({trial_for(name) for name in CAUSES}))
def test_the_rig_knows_every_trial_that_is_asked_for(trial):
    from ballscrew.cli import command_parser

    options = command_parser().parse_args(rig_command(trial).split()[1:])
    from ballscrew.rig.rig_trials import trials_named

    assert trials_named(options.trials[0])


# -- pictures --------------------------------------------------------------------------------


def test_thinning_keeps_every_peak():
    values = np.zeros(100_000)
    values[[17, 50_003, 99_998]] = (5.0, -7.0, 3.0)
    x, y = thinned(np.arange(100_000.0), values)
    assert len(x) <= MOST
    assert {17.0: 5.0, 50_003.0: -7.0, 99_998.0: 3.0}.items() <= dict(
        zip(x.tolist(), y.tolist(), strict=True)
    ).items()
    assert np.all(np.diff(x) >= 0)


def test_thinning_does_not_join_what_is_interrupted():
    x = np.arange(100_000.0)
    x[33_333] = np.nan
    assert np.count_nonzero(np.isnan(thinned(x, np.ones(len(x)))[0])) == 1


def test_a_force_that_nothing_was_found_to_have_is_not_drawn_as_a_flat_line():
    nothing = np.zeros(3000)
    curves = replace(found().curves, cause=nothing, shape=nothing)
    assert "causes" not in [p.name for p in pictures_of(found(curves=curves))]


def test_records_follow_each_other_and_are_not_joined():
    curves = found().curves
    time = end_to_end(curves)
    assert np.isnan(time[1499])
    assert time[1500] == pytest.approx(1.5)
    assert np.all(np.diff(time[np.isfinite(time)]) > 0)
    _, prior, _ = plotly_figure(pictures_of(found())[0])["data"]
    x = np.frombuffer(base64.b64decode(prior["x"]["bdata"]), prior["x"]["dtype"])
    assert np.flatnonzero(np.isnan(x)).tolist() == [1499]


def test_smoothing_does_not_mix_records():
    record = np.repeat([0, 1], 500)
    assert np.array_equal(smoothed(record.astype(float), record, 1e-3), record)


def test_means_by_position_leave_out_what_hardly_was_there():
    x = np.concatenate([np.linspace(0, 1, 6000), [2.0]])
    place, mean = binned(x, 3.0 * np.ones(6001), np.ones(6001, dtype=bool))
    assert np.all(mean[place < 0.9] == 3.0)
    assert np.all(np.isnan(mean[place > 1.1]))


def test_pictures_of_signals_without_any_size_are_drawn():
    zero = np.zeros(3000)
    curves = replace(found().curves, force=zero, before=zero, after=zero, x=zero, v=zero)
    for picture in pictures_of(found(curves=curves)):
        valid(plotly_figure(picture))


@pytest.mark.parametrize("shape", [np.zeros(3000), np.ones(3000)])
def test_plotly_knows_every_property_of_the_figures(shape):
    pictures = pictures_of(found(shape=shape))
    for picture in pictures:
        figure = valid(plotly_figure(picture))
        assert [trace.name for trace in figure.data] == [line.label for line in picture.lines]
        for axis, label in (("xaxis", picture.x_label), ("yaxis", picture.y_label)):
            assert figure.layout[axis].title.text == label
            assert re.search(r"\[.+\]$", label), "a unit"
        low, high = figure.layout.yaxis.range or (-1, 1)
        assert low < high


def valid(figure):
    """The figure as plotly's own object, which refuses what it does not know."""
    return go.Figure(json.loads(json.dumps(figure, allow_nan=False)))


# -- the closed loop -------------------------------------------------------------------------


def test_a_closed_loop_with_the_prior_plant_on_both_sides_differs_in_nothing(diagnosed):
    from ballscrew.diagnosis.drive import read_drive
    from ballscrew.diagnosis.with_causes import with_causes

    plant = with_causes(read_drive(diagnosed.parameters), [])
    effect = closed_loop_effect(plant, plant)
    assert effect.farthest == 0.0
    assert effect.prior.becomes == "stuck on a line of equilibria"
    assert effect.prior.slowest is not None
    assert effect.prior.slowest < 0
    assert effect.prior.settling is not None


def test_a_late_command_in_the_plant_is_told_from_states_at_its_nodes(diagnosed):
    """The slowest pair of eigenvalues is near that of the loop without a delay."""
    from ballscrew.diagnosis.drive import read_drive
    from ballscrew.diagnosis.with_causes import with_causes

    model = read_drive(diagnosed.parameters)
    late = [("input_delay", {"delay": 1e-3})]
    effect = closed_loop_effect(with_causes(model, []), with_causes(model, late))
    assert effect.extended.becomes == effect.prior.becomes
    assert effect.farthest > 1e-7
    assert effect.extended.slowest == pytest.approx(effect.prior.slowest, rel=0.05)
    assert effect.extended.slowest != effect.prior.slowest
    assert "u_late_1 = " in effect.extended.evidence
    assert " more" in effect.extended.evidence


def test_a_plant_that_the_controller_does_not_fit_is_said():
    from ballscrew.fmus.catalogue import component

    with pytest.raises(NoClosedLoop, match="does not fit the controller nctf"):
        closed_loop_effect(component("nctf"), component("nctf"))

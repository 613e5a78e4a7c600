"""Study files: what is read, what is drawn, and what is refused in one line."""

import math
from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.study.plan import Entrant, Plan, Variation, read_plan
from ballscrew.orchestration.study.tuning import Contender
from ballscrew.solver.errors import UserError

DOCS = Path(__file__).resolve().parents[3] / "docs"
GOOD = """version = 1
plants = 5
[controllers.pid]
tune = {Kp = [10.0, 3000.0]}
[[vary]]
parameters = ["Fc", "Fs"]
uniform = [0.7, 1.3]
[[duty]]
name = "a"
reference = "move:distance=0.01"
stop = 1.5
tune = true
[[duty]]
name = "b"
reference = "step:size=-1e-3"
stop = 1.0
[tuning]
budget = 7
[tuning.limits]
overshoot = 1e-3
"""


def plan_of(tmp_path, text):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return read_plan(path)


def test_plants_to_judge_on_are_none_of_those_to_tune_on(tmp_path):
    plan = plan_of(tmp_path, GOOD)
    tuned, judged = plan.draws("tune"), plan.draws("judge")
    assert tuned[0] == [1.0]
    assert judged.shape == (5, 1)
    assert not set(tuned.ravel()) & set(judged.ravel())
    assert np.all((judged >= 0.7) & (judged <= 1.3))
    np.testing.assert_array_equal(judged, plan_of(tmp_path, GOOD).draws("judge"))


@pytest.mark.ci
@pytest.mark.parametrize(
    ("variation", "share_below"),
    [
        (Variation(("m",), (0.5, 2.5)), lambda f: (f - 0.5) / 2),
        (
            Variation(("m",), (1.1, 0.2), "normal"),
            lambda f: (1 + math.erf((f - 1.1) / 0.2 / math.sqrt(2))) / 2,
        ),
        (
            Variation(("m",), (1.1, 0.2), "lognormal"),
            lambda f: (1 + math.erf(math.log(f / 1.1) / 0.2 / math.sqrt(2))) / 2,
        ),
        (Variation(("Fc",), (-10.0, 30.0), "temperature", {"Fc": 0.1}), lambda f: (f + 10) / 40),
    ],
    ids=lambda v: getattr(v, "distribution", ""),
)
def test_as_many_draws_lie_below_each_as_the_distribution_says(variation, share_below):
    """Against the closed form of each; and of 4000 draws, no share is off by more than 2.6 %:
    that of Kolmogorov's test at a hundredth."""
    plan = Plan("plant", (Entrant("pid", "pid"),), (), (variation,), plants=4000)
    below = np.array([share_below(f) for f in np.sort(plan.draws("judge")[:, 0])])
    assert np.abs(below - (np.arange(4000) + 0.5) / 4000).max() < 0.026


VARY = 'parameters = ["Fc", "Fs"]\nuniform = [0.7, 1.3]'


@pytest.mark.ci
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version = 1", "version = 2", "version is 2, expected 1"),
        ("[controllers.pid]", "[controler.pid]", "no 'controler', did you mean controllers"),
        ("stop = 1.0", "stop = 1.0 s", "is not a TOML"),
        ("[10.0, 3000.0]", "[3000.0, 10.0]", "the lower one first"),
        ("[10.0, 3000.0]", "[10.0, nan]", "expected two finite numbers"),
        ("pid]\ntune = {Kp = [1", "nctf]\ntune = {c = [-1", "c = -10 1/m is out of its range"),
        ("budget = 7", "budgt = 7", "[tuning] there is no 'budgt', did you mean budget"),
        ("plants = 5", "plants = 5\nperiod = -1.0", "period is -1.0, expected 0 or more"),
        ("plants = 5", "plants = 1000000", "whole number, 2 to 100000"),
        ("plants = 5", "plants = 1" + "0" * 400, "expected a finite number"),
        ("budget = 7", "budget = 90000\nseeds = 90000", "runs, expected at most 1e+07"),
        ("plants = 5", "plants = 5\nperiod = 1e-300", "samples, expected at most 1e+07"),
        ("[controllers.pid]", "[controllers.pidd]", "pidd"),
        ("Kp =", "Kpp =", "no parameter 'Kpp'; nearest: Kp"),
        ("move:distance=0.01", "mov:distance=0.01", "'mov:distance=0.01': there is no such file"),
        ("move:distance=0.01", "step:size=0", "has no motion and cannot be used for tuning"),
        ("tune = true", "tune = false", "has 1 controllers, 0 duties to tune on and 2 to judge by"),
        ("step:size=-1e-3", "move:distance=0.01", "has the motion of a tuning duty"),
        ('name = "b"', 'name = "a"', "two [[duty]] have the same name"),
        ("stop = 1.0", "stop = 1.0\nplant = {load_force = 5}", "no parameter 'load_force'"),
        ("uniform = [0.7, 1.3]", "", "has no distribution, expected one of uniform, normal"),
        (
            "uniform = [0.7, 1.3]",
            "normal = [1.0, 0.0]",
            "expected [mean, standard deviation above 0]",
        ),
        ("uniform = [0.7, 1.3]", "uniform = [-1.0, 1.0]", "parameter Fc = -"),
        (VARY, "temperature = [40, 0]\ncoefficients = {Fc = -0.01}", "expected [least, largest]"),
        (VARY, "temperature = [0, 40]", "expected coefficients with it"),
        ("[[duty]]", f"[[vary]]\n{VARY}\n[[duty]]", "two [[vary]] have the same name"),
        ('"Fc", "Fs"', '"Fc", "Fz"', "plant has no parameter 'Fz'; nearest: F"),
    ],
)
def test_bad_studies_are_refused_in_one_line(tmp_path, capsys, old, new, message):
    assert old in GOOD
    path = tmp_path / "study.toml"
    path.write_text(GOOD.replace(old, new, 1))
    assert main(["study", str(path), "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert message in heard
    assert heard.count("\n") == 1


@pytest.mark.ci
def test_the_studies_of_the_manual_are_read(tmp_path):
    page = (DOCS / "study.md").read_text("utf-8")
    plan = plan_of(tmp_path, page.split("```toml\n")[1].partition("```")[0])
    assert [[d.tune for d in plan.duties], plan.tuning.limits] == [[1, 0, 0], {"overshoot": 1e-4}]
    assert plan.duties[-1].plant == {"load_force": -5.0, "load_time": 0.3}
    assert [v.distribution for v in plan.variations] == ["uniform", "uniform", "temperature"]
    Contender.of(plan, plan.entrants[0]).check_plants()
    assert read_plan(DOCS / "examples" / "swap_study.toml").entrants


FORWARD = '[controllers.pid]\ncomponent = "pid+feed_forward"'
PID = "[controllers.pid]\ntune = {Kp = [10.0, 3000.0]}"


def test_what_is_given_a_value_is_not_tuned_unless_the_plan_says_so(tmp_path):
    given = GOOD.replace(PID, f"{FORWARD}\nvalues = {{Kfff = 0.0}}")
    assert set(plan_of(tmp_path, given).entrants[0].tune) == {"Kp", "Ki", "Kd", "Kvff", "Kaff"}
    said = GOOD.replace(PID, f"{FORWARD}\nvalues = {{Kfff = 0.0}}\ntune = {{Kfff = [0.0, 1.0]}}")
    assert plan_of(tmp_path, said).entrants[0].tune == {"Kfff": (0.0, 1.0)}


def of_machine(tmp_path, factor, text, limit="command_limit = {}\n"):
    """The plan of a study of a drive, `factor` times a small one."""
    (tmp_path / "machine.toml").write_text(
        'kind = "drive"\ncommand = "force"\nlaw = "lugre"\n[plant]\n'
        f"m = {10 * factor}\nFc = {20 * factor}\nsigma2 = {100 * factor}\n"
        "sigma0 = 66967.231\nsigma1 = 344.56\n"
    )
    return plan_of(tmp_path, 'params = "machine.toml"\n' + limit.format(100 * factor) + text)


def test_a_study_of_a_machine_has_the_plant_and_the_values_of_its_file(tmp_path):
    """A duty's own value wins; the file is looked for beside the study."""
    own = GOOD.replace("stop = 1.0\n", "stop = 1.0\nplant = {m = 50}\n")
    plan = of_machine(tmp_path, 4.0, own)
    assert plan.plant == "drive_lugre+force"
    assert [d.plant["m"] for d in plan.duties] == [40.0, 50.0]
    assert all(d.plant["Fs"] == 80.0 for d in plan.duties)  # as the file has no break-away force
    with pytest.raises(UserError, match=r"study.toml: .*none.toml"):
        plan_of(tmp_path, 'params = "none.toml"\n' + GOOD)


def test_controllers_of_a_machine_begin_with_what_it_is_and_are_tuned_where_it_needs(tmp_path):
    """The gains are in N for each metre, 4 times as large for 4 times the mass and friction."""
    forward = GOOD.replace(PID, FORWARD)
    one, four = (of_machine(tmp_path, factor, forward).entrants[0] for factor in (1.0, 4.0))
    assert one.values["Kaff"] == pytest.approx(10.0, rel=0.05)
    assert one.values["Kvff"] == pytest.approx(100.0, rel=0.05)
    for name in ("Kvff", "Kaff", "Kfff", "Kp"):
        assert four.values[name] == pytest.approx(4 * one.values[name], rel=0.02)
    low, high = one.tune["Kp"]
    assert four.tune["Kp"] == pytest.approx((4 * low, 4 * high), rel=0.02)
    assert low < one.values["Kp"] < high
    with pytest.raises(UserError, match="has no limit of its command; give one"):
        of_machine(tmp_path, 1.0, forward, limit="")
    with pytest.raises(UserError, match="lqi is made for the voltage of a motor"):
        of_machine(tmp_path, 5.0, forward.replace("[c", "[controllers.lqi]\n[c", 1))

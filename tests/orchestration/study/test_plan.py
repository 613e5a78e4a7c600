"""Study files: what is read, and what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.orchestration.study.loop import StudyLoop
from ballscrew.orchestration.study.plan import read_plan
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


def test_a_study_is_read(tmp_path):
    plan = plan_of(tmp_path, GOOD)
    assert [d.name for d in plan.tuning_duties] == ["a"]
    assert [d.name for d in plan.judged_duties] == ["b"]
    assert plan.entrants[0].tune == {"Kp": (10.0, 3000.0)}
    assert plan.tuning.limits == {"overshoot": 1e-3}


def test_plants_to_judge_on_are_none_of_those_to_tune_on(tmp_path):
    plan = plan_of(tmp_path, GOOD)
    tuned, judged = plan.draws("tune"), plan.draws("judge")
    assert tuned[0] == [1.0]
    assert judged.shape == (5, 1)
    assert not set(tuned.ravel()) & set(judged.ravel())
    assert np.all((judged >= 0.7) & (judged <= 1.3))
    np.testing.assert_array_equal(judged, plan_of(tmp_path, GOOD).draws("judge"))


VARY = 'parameters = ["Fc", "Fs"]\nuniform = [0.7, 1.3]'


@pytest.mark.ci
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version = 1", "version = 2", "version is 2, expected 1"),
        ("[controllers.pid]", "[controler.pid]", "has no [controllers.NAME]"),
        ("stop = 1.0", "stop = 1.0 s", "is not a TOML"),
        ("[10.0, 3000.0]", "[3000.0, 10.0]", "an empty range"),
        ("[10.0, 3000.0]", "[10.0, nan]", "expected two finite numbers"),
        ("pid]\ntune = {Kp = [1", "nctf]\ntune = {c = [-1", "c would be -10, expected within [0"),
        ("budget = 7", "budgt = 7", "[tuning] there is no 'budgt', did you mean budget"),
        ("plants = 5", "plants = 5\nperiod = -1.0", "period is -1, expected 0 or more"),
        ("plants = 5", "plants = 1000000", "whole number, 2 to 100000"),
        ("plants = 5", "plants = 1" + "0" * 400, "expected a finite number"),
        ("plants = 5", "plants = 1" + "0" * 5000, "is not a TOML file"),
        ("plants = 5", f"plants = {'[' * 9999}{']' * 9999}", "is not a TOML file"),
        ("budget = 7", "budget = 90000\nseeds = 90000", "runs, expected at most 1e+07"),
        ("plants = 5", "plants = 5\nperiod = 1e-300", "samples, expected at most 1e+07"),
        ("tune = true", 'tune = "false"', "tune is 'false', expected true or false"),
        ("[controllers.pid]", "[controllers.pidd]", "pidd"),
        ("Kp =", "Kpp =", "no parameter 'Kpp'; there are Kd, Ki, Kp"),
        ("move:distance=0.01", "mov:distance=0.01", "mov:distance=0.01: there is no such file"),
        ("move:distance=0.01", "step:size=0", "has no motion and cannot be used for tuning"),
        ("tune = true", "tune = false", "no duty to tune on"),
        ("step:size=-1e-3", "move:distance=0.01", "has the motion of a tuning duty"),
        ('name = "b"', 'name = "a"', "two duties have the same name"),
        ("stop = 1.0", "stop = 1.0\nplant = {load_force = 5}", "duty b: no parameter 'load_force'"),
        ("uniform = [0.7, 1.3]", "", "has no distribution, expected one of uniform, normal"),
        ("uniform = [0.7, 1.3]", "normal = [1.0, 0.0]", "standard deviation], finite"),
        ("uniform = [0.7, 1.3]", "uniform = [-1.0, 1.0]", "Fc would be -1"),
        (VARY, "temperature = [40, 0]\ncoefficients = {Fc = -0.01}", "an empty range"),
        (VARY, "temperature = [0, 40]", "no coeff"),
        ("[[duty]]", f"[[vary]]\n{VARY}\n[[duty]]", "vary the same parameters; remove"),
        ('"Fc", "Fs"', '"Fc", "Fz"', "vary: no parameter 'Fz'; there are Fc, Fs"),
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
    assert plan.duties[-1].plant == {"load_force": -5.0, "load_time": 0.3}
    assert [v.distribution for v in plan.variations] == ["uniform", "uniform", "temperature"]
    loop = StudyLoop(loop_kernel(plan.plant, "pid"))
    Contender(plan, plan.entrants[0], loop).check_plants()
    assert read_plan(DOCS / "examples" / "swap_study.toml").entrants


FORWARD = '[controllers.pid]\ncomponent = "pid+feed_forward"'


def test_what_is_given_a_value_is_not_tuned_unless_the_plan_says_so(tmp_path):
    forward = '[controllers.pid]\ncomponent = "pid+feed_forward"\nvalues = {Kfff = 0.0}'
    given = GOOD.replace("[controllers.pid]\ntune = {Kp = [10.0, 3000.0]}", forward)
    assert set(plan_of(tmp_path, given).entrants[0].tune) == {"Kp", "Ki", "Kd", "Kvff", "Kaff"}
    said = given.replace(forward, f"{forward}\ntune = {{Kfff = [0.0, 1.0]}}")
    assert plan_of(tmp_path, said).entrants[0].tune == {"Kfff": (0.0, 1.0)}


def test_a_study_of_a_machine_has_the_plant_and_the_values_of_its_file(tmp_path):
    """A duty's own value wins; the file is looked for beside the study."""
    (tmp_path / "machine.toml").write_text(
        'kind = "drive"\ncommand = "force"\nlaw = "lugre"\n[plant]\nm = 40.0\nFc = 80.0\n'
        "sigma0 = 1e7\nsigma1 = 2e4\nsigma2 = 200.0\n"
    )
    text = 'params = "machine.toml"\ncommand_limit = 500.0\n' + GOOD.replace(
        "stop = 1.0\n", "stop = 1.0\nplant = {m = 50}\n"
    )
    plan = plan_of(tmp_path, text)
    assert plan.plant == "drive_lugre+force"
    assert [d.plant["m"] for d in plan.duties] == [40.0, 50.0]
    assert all(d.plant["Fs"] == 80.0 for d in plan.duties)  # as the file has no break-away force
    with pytest.raises(UserError, match=r"study.toml: params: .*none.toml"):
        plan_of(tmp_path, 'params = "none.toml"\n' + GOOD)


def test_controllers_of_a_machine_begin_with_what_it_is_and_are_tuned_where_it_needs(tmp_path):
    """The gains are in N for each metre, 4 times as large for 4 times the mass and friction."""

    def entrant(factor):
        (tmp_path / "machine.toml").write_text(
            'kind = "drive"\ncommand = "force"\nlaw = "lugre"\n[plant]\n'
            f"m = {10 * factor}\nFc = {20 * factor}\nsigma2 = {100 * factor}\n"
            "sigma0 = 66967.231\nsigma1 = 344.56\n"
        )
        text = GOOD.replace("[controllers.pid]\ntune = {Kp = [10.0, 3000.0]}", FORWARD)
        head = f'params = "machine.toml"\ncommand_limit = {100.0 * factor}\n'
        return plan_of(tmp_path, head + text).entrants[0]

    one, four = entrant(1.0), entrant(4.0)
    assert one.values["Kaff"] == pytest.approx(10.0, rel=0.05)
    assert one.values["Kvff"] == pytest.approx(100.0, rel=0.05)
    for name in ("Kvff", "Kaff", "Kfff", "Kp"):
        assert four.values[name] == pytest.approx(4 * one.values[name], rel=0.02)
    low, high = one.tune["Kp"]
    assert four.tune["Kp"] == pytest.approx((4 * low, 4 * high), rel=0.02)
    assert low < one.values["Kp"] < high
    without = 'params = "machine.toml"\n' + GOOD.replace("tune = {Kp = [10.0, 3000.0]}", "")
    with pytest.raises(UserError, match="has no limit of its command; give command_limit"):
        plan_of(tmp_path, without)
    volts = GOOD.replace("[controllers.pid]", "[controllers.lqi]\n[controllers.pid]")
    with pytest.raises(UserError, match="lqi is made for the voltage of a motor"):
        plan_of(tmp_path, 'params = "machine.toml"\ncommand_limit = 500.0\n' + volts)

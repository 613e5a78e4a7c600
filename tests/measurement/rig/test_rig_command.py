"""``ballscrew rig``: what it writes, what it says, and how it ends."""

import json

import pytest

from ballscrew.cli import main
from ballscrew.measurement.rig.trials import TRIALS


def rig(*arguments):
    return main(["rig", *map(str, arguments)])


def test_one_trial_goes_into_the_folder_itself(tmp_path, capsys):
    assert rig("2.4/1", "--law", "lugre", "--seed", 2, "--out", tmp_path / "new") == 0
    files = sorted(p.name for p in (tmp_path / "new").glob("[!.]*"))
    names = ("parameters.toml", "record.csv", "record.png", "report.html", "trial.json")
    assert files == [*names, "truth.csv"]
    about = json.loads((tmp_path / "new" / "trial.json").read_text())
    assert (about["law"], about["seed"], about["name"]) == ("lugre", 2, "2.4/1")
    assert "2.4/1" in capsys.readouterr().out


@pytest.mark.ci
def test_several_trials_get_a_folder_each(tmp_path):
    assert rig("2.11", "loading-rate/20", "2.11-1", "--out", tmp_path) == 0
    assert sorted(p.name for p in tmp_path.glob("[!.]*")) == ["2.11-01", "loading-rate-20"]


@pytest.mark.ci
def test_a_record_past_an_instruments_range_ends_with_one_and_says_why(tmp_path, capsys):
    assert rig("2.8/5", "--set", "plant.Fs=1.3", "--out", tmp_path) == 1
    assert "capacitance sensor is out of its calibrated 70 um" in capsys.readouterr().err
    assert json.loads((tmp_path / "trial.json").read_text())["not_trusted"]


def test_the_list_has_one_line_for_every_trial(capsys):
    assert rig("--list") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(TRIALS)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "a TRIAL is missing"),
        (("2.4/1",), "--out DIR is missing"),
        (("2.4/17", "--out", "o"), "2.4 has trials 1 to 16"),
        (("2.4/1", "--law", "lugr", "--out", "o"), "no friction law 'lugr'"),
        (("2.4/1", "--seed", "-1", "--out", "o"), "seed is '-1', expected a whole number"),
        (("2.4/1", "--set", "plant.sigma0=-1", "--out", "o"), "expected a value within"),
        (("2.4/1", "--set", "plant.sigma9=1", "--out", "o"), "did you mean plant.sigma"),
        (("2.4/1", "--set", "plant.sigma0=1e300", "--out", "o"), "a parameter is invalid"),
        (("2.8/1", "--set", "capacitance_sensor.area=1e-2", "--out", "o"), "cannot resolve"),
    ],
)
def test_a_request_that_makes_no_sense_is_refused(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert rig(*arguments) == 2
    assert said in capsys.readouterr().err

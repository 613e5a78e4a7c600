"""The command that tunes one controller for one machine, and what the next command makes of it."""

import json
import tomllib

import numpy as np
import pytest
from diagnosed import run
from heavy_drive import HEAVY

from ballscrew.cli import main

AXIS = "kind = 'drive'\nlaw = 'lugre'\n[plant]\n" + "".join(
    f"{n} = {v!r}\n" for n, v in HEAVY.items()
)
WORDS = "tune --controller p_pi --params axis.toml --limit 500 --budget 12"


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A folder where an axis was tuned, and what was printed."""
    place = tmp_path_factory.mktemp("tuned")
    (place / "axis.toml").write_text(AXIS)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        code, printed, _ = run(*WORDS.split(), "--json", "--out", "out")
    assert code == 0
    return place, json.loads(printed)


@pytest.fixture
def here(tuned, monkeypatch):
    monkeypatch.chdir(tuned[0])
    return tuned[0]


def told(folder, name="out"):
    return json.loads((folder / name / "tuning.json").read_text())


@pytest.mark.ci
def test_files_are_written_with_the_gains_that_are_printed(here, tuned):
    names = {p.name for p in (here / "out").iterdir() if p.is_file()}
    pictures = {"motions.png", "bode.png"}
    assert names == {"report.html", "tuning.json", "parameters.toml", *pictures}
    table = tomllib.loads((here / "out" / "parameters.toml").read_text())
    written = {n: v["value"] for n, v in table["controller"]["p_pi"].items()}
    assert told(here) == tuned[1]
    for gain in tuned[1]["gains"]:
        assert written[gain["name"]] == gain["value"]
        assert f"controller.{gain['name']}={gain['value']!r}" in tuned[1]["set"]
    assert table["plant"]["voltage_limit"]["value"] == 500.0


@pytest.mark.ci
def test_run_over_fmus_with_the_file_makes_the_errors_that_were_told(here):
    judge = told(here)["motions"][-1]
    stop = 2.1795
    words = "run --controller p_pi --params out/parameters.toml --step 1e-3"
    assert main([*words.split(), "--reference", judge["reference"], "--out", "run"]) in (0, 1)
    table = np.genfromtxt(here / "run" / "trajectory.csv", delimiter=",", names=True)
    rows = table["time"] <= stop
    error = (table["x_d"] - table["x"])[rows]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(judge["rms_error"], rel=0.01)
    assert np.abs(error).max() == pytest.approx(judge["peak_error"], rel=0.01)


@pytest.mark.ci
def test_a_second_controller_is_tuned_from_the_file_with_its_limit_and_beside_the_first(here):
    words = "tune --controller pid --params out/parameters.toml --budget 2 --out both"
    assert main(words.split()) == 0
    both = tomllib.loads((here / "both" / "parameters.toml").read_text())["controller"]
    first = tomllib.loads((here / "out" / "parameters.toml").read_text())["controller"]
    assert both["p_pi"] == first["p_pi"]
    assert both["pid"].keys() >= {"Kp", "Ki", "Kd"}
    assert told(here, "both")["limit"] == 500.0

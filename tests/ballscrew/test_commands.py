"""Commands with files of their own: compare, tune, new, swap in practice; missing libraries."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from diagnosed import NOMINAL, run
from heavy_drive import HEAVY

from ballscrew import compare
from ballscrew.cli import command_parser, main
from ballscrew.orchestration.loop.machine import own_ranges
from ballscrew.orchestration.loop.parameter_file import Diagnosed, ParameterFile, Value
from ballscrew.solver import files

LOAD = 0.5


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """A record with a load, and what a diagnosis of another one left that found the load."""
    from axis_records import friction_noise, moved, signals_of

    folder = tmp_path_factory.mktemp("compared")
    time = np.arange(10_000) * 1e-3
    u = 3.0 * np.sin(4.0 * time) + 1.5 * np.sin(11.0 * time)
    signals = signals_of(moved({"load": LOAD}, u, friction_noise(1, len(u))), u)
    table = np.column_stack([signals[n] for n in ("time", "u", "x")])
    np.savetxt(folder / "other.csv", table, delimiter=",", header="time,u,x", comments="")
    truth = dict(NOMINAL)
    told = Diagnosed(
        ("one.csv",), "voltage", 0.0, "modified_lugre", truth, truth, {"load_bias": {"load": LOAD}}
    )
    ParameterFile(plant={n: Value(v) for n, v in truth.items()}, diagnosis=told).save(folder)
    return folder


@pytest.mark.ci
def test_a_file_without_a_diagnosis_has_one_model(compared, tmp_path):
    plain = tmp_path / "plain.toml"
    plain.write_text("[plant]\n" + "".join(f"{n} = {v!r}\n" for n, v in NOMINAL.items()))
    code, printed, _ = run("compare", compared / "other.csv", "--params", plain)
    assert code == 0
    assert printed.startswith("The model leaves 0.5 N rms of a friction of ")
    one = compare(compared / "other.csv", plain)
    three = compare(compared / "other.csv", compared / "parameters.toml")
    assert one.models["model"] == three.models["prior"]
    table = three.to_pandas()
    prior = table[(table.model == "prior") & (table.part == "all")]
    assert prior.force_N.item() == pytest.approx(LOAD, rel=0.1)


@pytest.mark.ci
def test_json_and_the_picture_are_saved(compared, tmp_path):
    given = ("compare", compared / "other.csv", "--params", compared / "parameters.toml")
    code, printed, _ = run(*given, "--out", tmp_path, "--json")
    assert code == 0
    told = json.loads(printed)
    assert told == json.loads((tmp_path / "compare.json").read_text())
    assert told["models"]["prior"]["all"]["force"]["value_N"] == pytest.approx(LOAD, rel=0.1)
    (gain,) = (g for g in told["gains"] if (g["model"], g["over"]) == ("corrected", "adjusted"))
    assert gain["force"]["interval"][0] > 0.9
    files = {p.name for p in tmp_path.glob("[!.]*")}
    assert files == {"report.html", "compare.json", "compare.png"}


# -- tune ----------------------------------------------------------------------------------------


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


# -- new -----------------------------------------------------------------------------------------


def test_the_template_s_own_test_passes_and_the_commands_that_are_told_work(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "controller", "mine", "--out", "my own"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "my own/mine.py and my own/test_mine.py are written. Next:"
    first, test, last = (shlex.split(line) for line in told[1:])
    assert main([*first[1:], "--stop", "0.1", "--step", "1e-3"]) == 0
    assert main(last[1:]) == 0
    assert Path("fmus/mine.fmu").is_file()
    assert {*own_ranges("my own/mine.py:mine")} == {"Kp", "Ki", "Kd", "b"}  # what `tune` finds
    assert command_parser().parse_args(first[1:]).out == Path("out/mine")
    assert test == ["pytest", "my own/test_mine.py"]
    ran = subprocess.run(
        [sys.executable, "-m", *test, "-q", "-p", "no:cacheprovider"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout
    assert "1 passed" in ran.stdout


@pytest.mark.ci
@pytest.mark.parametrize("there", ["mine.py", "test_mine.py"])
def test_nothing_is_overwritten(tmp_path, monkeypatch, capsys, there):
    monkeypatch.chdir(tmp_path)
    Path(there).write_text("mine\n", encoding="utf-8")
    assert main(["new", "controller", "mine"]) == 2
    heard = capsys.readouterr().err
    assert heard == f"ballscrew: {there} exists already; choose another NAME or --out\n"
    assert [p.name for p in tmp_path.iterdir()] == [there]
    assert Path(there).read_text(encoding="utf-8") == "mine\n"


# -- swap --sampled PERIOD --noise: on a computer, behind the instruments that fit ---------------


GAIN, RESOLUTION = 300.0, 1e-5
MINE = f"""
from ballscrew import Component, Input, Output, symbol

def p():
    law = {GAIN} * (symbol("x_d") - symbol("x"))
    inputs = (
        Input("x", "m", "position", role="measurement"),
        Input("x_d", "m", "set-point", role="reference"),
    )
    return Component("p", "P", inputs=inputs, outputs=(Output("u", "V", "command", law),))

"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    return "mine.py:p"


def course(file):
    return np.genfromtxt(file, delimiter=",", names=True)


def test_commands_are_the_law_of_what_the_encoder_shows_at_samples_and_held_between(mine, capsys):
    asked = ["--sampled", "2e-3", "--noise", "--stop", "0.06", "--step", "5e-4", "--json"]
    given = ["--set", f"p.position_encoder_resolution={RESOLUTION}"]
    assert main(["swap", "--controllers", mine, *given, *asked, "--out", "out"]) == 0
    found = course("out/trajectory_p+sampled+position_encoder.csv")
    told = json.loads(capsys.readouterr().out)[0]
    assert told["controller"] == "p+sampled+position_encoder"
    assert told["sampling_period"] == 2e-3
    found = found[:-1]  # at the end of the run no step follows, and no sample is taken
    samples = np.round(found["time"] / 2e-3, 6) % 1 == 0
    assert np.ptp(found["x"]) > 100 * RESOLUTION
    # the law by hand: a whole count, next to the true position and its error between two lines
    seen = 0.08 - found["u"][samples] / GAIN
    counts = seen / RESOLUTION
    np.testing.assert_allclose(counts, np.round(counts), rtol=0, atol=1e-6)
    assert np.abs(seen - found["x"][samples]).max() < RESOLUTION + 0.2e-6
    held = np.repeat(found["u"][samples], 4)[: len(found)]
    np.testing.assert_array_equal(found["u"], held)


@pytest.mark.ci
def test_values_of_the_bare_controller_are_taken_and_those_that_were_used_come_back(mine, capsys):
    def iae(*given):
        assert main(["swap", "--stop", "0.02", "--noise", "--json", *given]) == 0
        heard = capsys.readouterr()
        return json.loads(heard.out)[0]["iae"], heard.err

    plain = ["--controllers", "pid", "--stop", "0.02", "--set", "pid.Kp=100", "--out", "plain"]
    assert main(["swap", *plain]) == 0
    capsys.readouterr()
    pid = "--controllers", "pid", "--sampled", "2e-3"
    given, _ = iae(*pid, "--set", "pid.Kp=100", "--out", "given")
    told, said = iae(*pid, "--params", "plain/parameters.toml", "--out", "told")
    assert told == given != iae(*pid, "--out", "nominal")[0]
    assert said == ""
    again, said = iae(*pid, "--params", "told/parameters.toml", "--out", "again")
    assert (again, said) == (given, "")


# -- without pyarrow tables are CSV; what needs a library that is not there says so --------------


BLOCKED = "import sys; sys.modules['pyarrow'] = None; "
MAP = (
    "map --controller pid --x plant.Fc=1:2:3 --y plant.Fs=2.2:3:2 --stop 0.5 --workers 1 --out"
).split()


def without_pyarrow(*words):
    command = f"{BLOCKED}from ballscrew.cli import main; sys.exit(main(sys.argv[1:]))"
    told = [sys.executable, "-P", "-c", command, *map(str, words)]
    return subprocess.run(told, capture_output=True, text=True)


@pytest.mark.ci
def test_a_map_is_a_csv_file_with_the_same_numbers(tmp_path):
    done = without_pyarrow(*MAP, tmp_path / "without")
    assert (done.returncode, done.stderr) == (0, "")
    assert "map.csv, map.json" in done.stdout
    assert main([*MAP, str(tmp_path / "with")]) == 0
    assert not (tmp_path / "with" / "map.csv").exists()
    text = files.read_table(tmp_path / "without" / "map.csv")
    assert text == files.read_table(tmp_path / "with" / "map.parquet")
    assert text["lambda1_bits_per_s"] == [None] * 6  # not asked for
    done = without_pyarrow(*MAP, tmp_path / "with", "--resume")
    assert f"{tmp_path / 'with' / 'map.parquet'} {files.PYARROW}\n" in done.stderr


@pytest.mark.parametrize(
    ("first", "library", "said"),
    [
        (b"TDSm" + bytes(100), "nptdms", "is a TDMS file and needs nptdms: pip install 'ballscrew"),
        (b"PAR1\0", "pyarrow", "is a Parquet file and needs pyarrow: pip install 'ballscrew[par"),
    ],
)
def test_a_library_that_is_not_there_is_named_with_its_extra(
    tmp_path, monkeypatch, capsys, first, library, said
):
    (tmp_path / "run").write_bytes(first)
    monkeypatch.setitem(sys.modules, library, None)
    assert main(["diagnose", str(tmp_path / "run"), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line

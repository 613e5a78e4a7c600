"""``ballscrew compare`` with a file of a diagnosis: figures printed, as JSON, saved."""

import json

import numpy as np
import pytest
from diagnosed import NOMINAL, run

from ballscrew import compare
from ballscrew.orchestration.loop.parameter_file import Diagnosed, ParameterFile, Value

LOAD = 0.5
pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def files(tmp_path_factory):
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
        ("one.csv",),
        "voltage",
        0.0,
        "modified_lugre",
        truth,
        truth,
        {"load_bias": {"load": LOAD}},
    )
    ParameterFile(plant={n: Value(v) for n, v in truth.items()}, diagnosis=told).save(folder)
    return folder


def test_a_file_without_a_diagnosis_has_one_model(files, tmp_path):
    plain = tmp_path / "plain.toml"
    plain.write_text("[plant]\n" + "".join(f"{n} = {v!r}\n" for n, v in NOMINAL.items()))
    code, printed, _ = run("compare", files / "other.csv", "--params", plain)
    assert code == 0
    assert printed.startswith("The model leaves 0.5 N rms of a friction of ")
    one = compare(files / "other.csv", plain)
    three = compare(files / "other.csv", files / "parameters.toml")
    assert one.models["model"] == three.models["prior"]
    table = three.to_pandas()
    prior = table[(table.model == "prior") & (table.part == "all")]
    assert prior.force_N.item() == pytest.approx(LOAD, rel=0.1)


def test_json_and_the_picture_are_saved(files, tmp_path):
    given = ("compare", files / "other.csv", "--params", files / "parameters.toml")
    code, printed, _ = run(*given, "--out", tmp_path, "--json")
    assert code == 0
    told = json.loads(printed)
    assert told == json.loads((tmp_path / "compare.json").read_text())
    assert told["models"]["prior"]["all"]["force"]["value_N"] == pytest.approx(LOAD, rel=0.1)
    (gain,) = (g for g in told["gains"] if (g["model"], g["over"]) == ("corrected", "adjusted"))
    assert gain["force"]["interval"][0] > 0.9
    files = {p.name for p in tmp_path.glob("[!.]*")}
    assert files == {"report.html", "compare.json", "compare.png"}

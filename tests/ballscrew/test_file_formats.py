"""Each file that a command writes is as its schema in `docs/reference/schemas` says."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from diagnosed import run

from ballscrew.orchestration.loop.catalogue import fmu

pytestmark = [pytest.mark.ci, pytest.mark.xdist_group("file_formats")]
ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = {p.stem: json.loads(p.read_text("utf-8")) for p in ROOT.glob("docs/reference/schemas/*")}
LOOP = "--controller pid --stop 0.5"
AXES = "--x plant.Fc=1:2:2 --y plant.Fs=2.2:3:2 --workers 1"
COMMANDS = {
    "run": f"run {LOOP}",
    "swap": "swap --controllers pid pid_sampled --stop 0.5",
    "lyapunov": f"lyapunov {LOOP}",
    "limit cycle": "lyapunov --controller iol --set controller.sigma1_hat=342.5",
    "exponents over FMUs": "lyapunov --controller {pid} --stop 0.1 --via fmu",
    "map": f"map {LOOP} {AXES}",
    "tune": "tune --controller pid --budget 2",
    "tune a relay": "tune --controller relay --budget 2",
    "study": "study {study} --workers 1",
    "rig": "rig 2.8",
    "gallery": "gallery bouncing_ball",
    "identify LuGre": "identify {rig}/2.8-01 {rig}/2.8-02 --law lugre",
    "identify Dahl": "identify {rig}/2.8-01 --law dahl",
    "identify Bliman and Sorine": "identify {rig}/2.8-01 --law bliman_sorine",
    "diagnose": "diagnose {data}/record.csv --params {data}/believed.toml",
    "unexplained": "diagnose {data}/with_current.csv --params {data}/believed.toml",
    "compare": "compare {data}/record.csv --params {diagnose}/parameters.toml",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with what each command wrote, in a folder of its own."""
    from axis_records import NOTCH, strong_record, write_strong

    out = tmp_path_factory.mktemp("out")
    write_strong({"load": 0.4}, out / "data")
    signals = strong_record(NOTCH, with_current=True, samples=8000).signals
    with_current, table = out / "data" / "with_current.csv", np.stack(list(signals.values()), 1)
    np.savetxt(with_current, table, delimiter=",", header=",".join(signals), comments="")
    there = {name: out / name for name in ("rig", "data", "diagnose")}
    there |= {"study": ROOT / "tests" / "data" / "small_study.toml", "pid": fmu("pid")}
    for name, words in COMMANDS.items():
        code, _, said = run(*words.format(**there).split(), "--out", out / name)
        assert code in (0, 1), said
    return out


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_file_is_as_its_schema_says(written, name):
    from jsonschema import Draft202012Validator

    check = Draft202012Validator(SCHEMAS[name])
    kind = "toml" if name == "parameters" else "json"
    files = [p for p in written.rglob(f"{name}.{kind}") if ".ballscrew" not in p.parts]
    assert files
    for path in files:
        text = path.read_text("utf-8")
        data = tomllib.loads(text) if name == "parameters" else json.loads(text)
        assert [(e.json_path, e.message[:200]) for e in check.iter_errors(data)] == [], path
    if name == "metrics":  # a comparison is a list of them
        rows = json.loads((written / "swap" / "comparison.json").read_text("utf-8"))
        assert [len(rows), *(check.is_valid(row) for row in rows)] == [2, True, True]


def test_the_diagnoses_have_what_is_not_always_there(written):
    told = json.loads((written / "unexplained" / "diagnosis.json").read_text("utf-8"))
    assert told["next_experiment"]["motion"]["speeds_m_per_s"]
    assert told["suspects"]
    assert set(told["noise"]) == {"force_N", "voltage_N"}
    assert json.loads((written / "diagnose" / "diagnosis.json").read_text("utf-8"))["causes"]


def test_the_parameter_files_of_the_manual_are_as_the_schema_says():
    from jsonschema import Draft202012Validator

    text = (ROOT / "docs" / "parameters.md").read_text("utf-8")
    examples = [block.partition("```")[0] for block in text.split("```toml\n")[1:]]
    for example in examples:
        Draft202012Validator(SCHEMAS["parameters"]).validate(tomllib.loads(example))
    assert len(examples) == 2

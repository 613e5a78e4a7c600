"""Each file that a command writes is as its schema in `docs/reference/schemas` says."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from axis_records import NOTCH, strong_record, write_strong
from diagnosed import run
from jsonschema import Draft202012Validator
from worlds import layout as at

from ballscrew.fmus.catalogue import fmu

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = {p.stem: json.loads(p.read_text("utf-8")) for p in ROOT.glob("docs/reference/schemas/*")}
pytestmark = pytest.mark.xdist_group("file_formats")  # whose commands run once
DATA = ROOT / "tests" / "data"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with what each command wrote, in a folder of its own."""
    out = tmp_path_factory.mktemp("out")
    record, prior = write_strong({at.LOAD: 0.4}, out / "data")
    signals = strong_record(NOTCH, with_current=True, samples=8000).signals
    with_current = out / "with_current.csv"
    table = np.stack(list(signals.values()), 1)
    np.savetxt(with_current, table, delimiter=",", header=",".join(signals), comments="")
    loop = ("--controller", "pid", "--stop", "0.5")
    commands = {
        "run": ("run", *loop),
        "swap": ("swap", "--controllers", "pid", "pid_sampled", "--stop", "0.5"),
        "lyapunov": ("lyapunov", *loop),
        "cycle": ("lyapunov", "--controller", "iol", "--set", "controller.sigma1_hat=342.5"),
        "map": (
            "map",
            *loop,
            "--x",
            "plant.Fc=1:2:2",
            "--y",
            "plant.Fs=2.2:3:2",
            "--refine",
            "--workers",
            "1",
        ),
        "tune": ("tune", "--controller", "pid", "--budget", "2"),
        "tune_a_relay": ("tune", "--controller", "relay", "--budget", "2"),
        "study": ("study", DATA / "small_study.toml", "--workers", "1"),
        "exponents_of_a_file": (
            "lyapunov",
            "--controller",
            fmu("pid"),
            "--stop",
            "0.1",
            "--via",
            "fmu",
        ),
        "map_over_fmus": (
            "map",
            *loop,
            "--x",
            "plant.Fc=1:2:2",
            "--y",
            "plant.Fs=2.2:3:2",
            "--via",
            "fmu",
            "--workers",
            "1",
        ),
        "rig": ("rig", "2.8"),
        "rig_parts": ("rig", "2.8/1", "--export"),
        "gallery": ("gallery", "bouncing_ball"),
        "lugre": ("identify", *(out / "rig" / f"2.8-0{k}" for k in (1, 2)), "--law", "lugre"),
        "dahl": ("identify", out / "rig" / "2.8-01", "--law", "dahl"),
        "bliman": ("identify", out / "rig" / "2.8-01", "--law", "bliman_sorine"),
        "diagnose": ("diagnose", record, "--params", prior),
        "unexplained": ("diagnose", with_current, "--params", prior),
        "compare": ("compare", record, "--params", out / "diagnose" / "parameters.toml"),
        "one_model": ("compare", record, "--params", prior),
    }
    for name, words in commands.items():
        code, _, said = run(*words, "--out", out / name)
        assert code in (0, 1), said
    return out


def files_of(folder, name):
    kind = "toml" if name == "parameters" else "json"
    return [p for p in sorted(folder.rglob(f"{name}.{kind}")) if ".ballscrew" not in p.parts]


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_file_is_as_its_schema_says(written, name):
    check = Draft202012Validator(SCHEMAS[name])
    files = files_of(written, name)
    assert files
    for path in files:
        text = path.read_text("utf-8")
        data = tomllib.loads(text) if name == "parameters" else json.loads(text)
        assert [(e.json_path, e.message[:200]) for e in check.iter_errors(data)] == [], path


def test_the_diagnoses_have_what_is_not_always_there(written):
    told = json.loads((written / "unexplained" / "diagnosis.json").read_text("utf-8"))
    assert told["next_experiment"]["motion"]["speeds_m_per_s"]
    assert told["suspects"]
    assert set(told["noise"]) == {"force_N", "voltage_N"}
    assert json.loads((written / "diagnose" / "diagnosis.json").read_text("utf-8"))["causes"]


def test_a_comparison_is_a_list_of_metrics(written):
    rows = json.loads((written / "swap" / "comparison.json").read_text("utf-8"))
    assert len(rows) == 2
    for row in rows:
        Draft202012Validator(SCHEMAS["metrics"]).validate(row)


def test_the_parameter_file_of_the_manual_is_as_the_schema_says():
    text = (ROOT / "docs" / "parameters.md").read_text("utf-8")
    examples = [block.partition("```")[0] for block in text.split("```toml\n")[1:]]
    for example in examples:
        Draft202012Validator(SCHEMAS["parameters"]).validate(tomllib.loads(example))
    assert len(examples) == 2


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_field_is_described_and_every_number_has_a_unit(name):
    Draft202012Validator.check_schema(SCHEMAS[name])
    parts = list(_parts(SCHEMAS[name]))
    fields = [item for part in parts for item in part.get("properties", {}).items()]
    silent = [field for field, said in fields if not {"description", "$ref"} & set(said)]
    numbers = [p for p in parts if "number" in (p.get("type"), *p.get("type", ()))]
    arrays = [p["items"] for p in parts if "unit" in p and "items" in p]
    inner = [a.get("items", a) for a in arrays]
    assert silent == []
    assert [p for p in numbers if "unit" not in p and p not in inner] == []
    assert all(p.get("additionalProperties") is not None for p in parts if "properties" in p)


def _parts(schema):
    """A schema and all schemas in it."""
    yield schema
    inside = [schema[k] for k in ("items", "additionalProperties") if k in schema]
    for key in ("properties", "$defs"):
        inside += schema.get(key, {}).values()
    for part in (*inside, *schema.get("oneOf", ())):
        if isinstance(part, dict):
            yield from _parts(part)


def test_the_page_of_formats_links_to_every_schema():
    page = (ROOT / "docs" / "reference" / "formats.md").read_text("utf-8")
    assert [name for name in SCHEMAS if f"(schemas/{name}.json)" not in page] == []

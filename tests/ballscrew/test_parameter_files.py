"""One parameter file from command to command: what one writes, the next one reads."""

from __future__ import annotations

import itertools
import os
from types import SimpleNamespace

import pytest
from case_inputs import swing, write
from diagnosed import NOMINAL, run, whole
from fmpy import read_model_description
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballscrew.fmus.system_reading import read_system
from ballscrew.orchestration.loop.parameter_file import ParameterFile, Value, read_parameters

TRIAL = "2.4/1"


def done(*arguments, codes=(0,)):
    code, printed, said = run(*arguments)
    assert code in codes, said
    return printed, said


def written(folder):
    return read_parameters(folder / "parameters.toml")


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """Rig, identify, diagnose, compare, run, lyapunov: each takes a file that one before wrote."""
    top = tmp_path_factory.mktemp("chain")
    folders = [top / name for name in ("rig", "identify", "diagnose", "run", "lyapunov")]
    trial, identified, diagnosed, ran, exponents = folders
    done("rig", TRIAL, "--set", "plant.Fc=1.3", "--set", "plant.R=22", "--out", trial)
    law = ("--law", "modified_lugre")
    given = ("--params", trial / "parameters.toml", "--out", identified)
    done("identify", trial, *law, *given, codes=(0, 1))
    given = ("--params", identified / "parameters.toml", "--out", diagnosed)
    done("diagnose", trial / "record.csv", *given, codes=(0, 1))
    for folder in (identified, diagnosed):
        done("compare", trial / "record.csv", "--params", folder / "parameters.toml")
    loop = ("--controller", "nctf", "--stop", "0.05")
    done("run", *loop, "--params", diagnosed / "parameters.toml", "--out", ran)
    given = ("--params", ran / "parameters.toml", "--out", exponents)
    done("lyapunov", *loop, *given, codes=(0, 1))
    return SimpleNamespace(trial=trial, files=[written(folder) for folder in folders])


@pytest.mark.ci
def test_the_chain_goes_by_files_alone(chain):
    rig, identified, diagnosed, ran, exponents = chain.files
    assert (rig.plant["Fc"].value, rig.plant["R"].value) == (1.3, 22.0)
    low, high = identified.plant["Fs"].interval
    assert low < rig.plant["Fs"].value < high
    assert "identified from" in identified.plant["Fs"].source
    assert identified.not_identified
    for before, after in itertools.pairwise(chain.files):
        assert [n for n in before.plant if n not in after.plant] == []
        assert {n: v.unit for n, v in before.plant.items()}.items() <= {
            n: v.unit for n, v in after.plant.items()
        }.items()
        for name, value in after.plant.items():  # a value that stays keeps interval and source
            if name in before.plant and before.plant[name].value == value.value:
                assert value == before.plant[name]
    assert ran.plant == exponents.plant
    assert ran.controllers["nctf"] == exponents.controllers["nctf"]
    assert ran.plant["voltage_limit"].value == 36.0
    changed = [n for n, v in diagnosed.plant.items() if v.value != identified.plant[n].value]
    assert all("corrected by ballscrew diagnose" in diagnosed.plant[n].source for n in changed)


@pytest.mark.ci
def test_the_rig_repeats_a_trial_from_its_own_file(chain, tmp_path):
    """Its rotor is none of the others', and the file says so."""
    assert chain.files[0].plant["Jm"].value == 4.2e-7
    assert "it is 0 unless" in chain.files[0].plant["Jm"].source
    done("rig", TRIAL, "--params", chain.trial / "parameters.toml", "--out", tmp_path)
    for name in ("record.csv", "truth.csv", "parameters.toml"):
        assert (tmp_path / name).read_bytes() == (chain.trial / name).read_bytes()
    asked = ("rig", TRIAL, "--params", tmp_path / "parameters.toml", "--out", tmp_path)
    code, _, said = run(*asked)
    assert code == 2
    assert "would be overwritten" in said


@pytest.fixture
def axis(tmp_path):
    def write(text, name="axis.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


SHORT = ("--stop", "0.02")
HAND = whole(sigma0=6e4).replace(
    "m = 1.0\n",
    'm = { value = 2.0, unit = "kg", interval = [1.9, 2.2], source = "a pair of scales" }\n',
)
HAND += "[controller.pid]\nKp = 300.0\n"


def test_set_wins_over_the_file_and_the_file_over_the_default(axis, tmp_path):
    given = ("--controller", "pid", *SHORT, "--params", axis(HAND), "--out", tmp_path / "out")
    done("run", *given, "--set", "plant.sigma0=5e4", "--set", "controller.Ki=1")
    file = written(tmp_path / "out")
    assert file.plant["sigma0"] == Value(5e4, "N/m", None, "given to this run")
    assert file.plant["m"] == Value(2.0, "kg", (1.9, 2.2), "a pair of scales")
    assert file.controllers["pid"]["Kd"].source
    assert (file.controllers["pid"]["Kp"].value, file.controllers["pid"]["Ki"].value) == (300, 1)


def test_the_file_s_values_act_as_set_does_and_the_file_that_a_run_writes_is_that_run(
    axis, tmp_path
):
    def course(out, *given):
        done("run", "--controller", "pid", *SHORT, *given, "--out", tmp_path / out)
        return (tmp_path / out / "trajectory.csv").read_bytes()

    told = course("told", "--params", axis(HAND))
    assert told != course("nominal")
    sets = ("plant.sigma0=6e4", "plant.m=2", "controller.Kp=300")
    assert told == course("set", *itertools.chain(*(("--set", s) for s in sets)))
    assert told == course("again", "--params", tmp_path / "told" / "parameters.toml")
    files = [(tmp_path / out / "parameters.toml").read_bytes() for out in ("told", "again")]
    assert files[0] == files[1]


def test_the_file_s_law_chooses_the_plant(axis, tmp_path):
    path = axis('law = "dahl"\n' + whole("plant_dahl", sigma=8e4))
    given = ("--controller", "pid", *SHORT, "--params", path, "--out", tmp_path / "out")
    done("run", *given)
    assert written(tmp_path / "out").law == "dahl"
    law = [n for n in NOMINAL if n in ("sigma0", "sigma1", "sigma2", "Fs", "Vs")]
    sets = [word for n in law for word in ("--set", f"plant.{n}={NOMINAL[n]!r}")]
    _, said = done("run", *given, "--plant", "plant", *sets)
    assert "note: " in said
    assert "sigma, alpha: plant has no such parameter; left aside" in said
    assert written(tmp_path / "out").law == "modified_lugre"


@pytest.mark.parametrize(
    "words",
    [
        "run --controller pid --stop 0.02",
        "lyapunov --controller pid --stop 0.02",
        "tune --controller pid --limit 100",
        "export --only drive_lugre",
        "rig viscous --set trial.travel=0.1",
        "diagnose run.csv",
        "compare run.csv",
    ],
)
def test_a_value_that_a_machine_lacks_is_asked_for_and_none_of_another_taken(
    axis, tmp_path, monkeypatch, words
):
    """The gain, the offset and the limit have defaults that say nothing of a machine."""
    kind = 'kind = "drive"\ncommand = "force"\nlaw = "lugre"\n[plant]\n'
    values = "m = 60\nsigma0 = 5e6\nsigma2 = 260\nFc = 90\nFs = 115\nVs = 0.012\n"
    path = axis(kind + values)
    monkeypatch.chdir(tmp_path)
    t, x, u = swing()
    write(tmp_path / "run.csv", "time,x,u [N]", ".3f .9f .9f", t, x, u)
    code, _, said = run(*words.split(), "--params", path, "--out", tmp_path / "out")
    assert code == 2
    assert f"{path}: [plant] has no sigma1 (" in said
    axis(kind + values + "sigma1 = 2e4\n")
    if words.startswith(("run", "export")):
        done(*words.split(), "--params", path, "--out", tmp_path / "out", codes=(0, 1))


# -- export ---------------------------------------------------------------------------------


def starts(path):
    described = read_model_description(os.fspath(path), validate=False)
    return {v.name: (v.start, v.description) for v in described.modelVariables}


@pytest.mark.ci
@pytest.mark.parametrize("native", [(), ("--native",)], ids=["readable", "native"])
def test_what_is_exported_starts_with_the_file_s_values(axis, tmp_path, native):
    given = ("--params", axis(HAND), "--out", tmp_path / "out", *native)
    done("export", "--only", "plant", "pid", *given)
    plant, pid = (starts(tmp_path / "out" / f"{n}.fmu") for n in ("plant", "pid"))
    assert float(plant["sigma0"][0]) == 6e4
    assert float(plant["m"][0]) == 2.0
    assert "a pair of scales" in plant["m"][1]
    assert float(pid["Kp"][0]) == 300.0
    done("export", "--loop", "pid", *given)
    loop = starts(tmp_path / "out" / "pid_loop.fmu")
    assert (float(loop["plant_sigma0"][0]), float(loop["controller_Kp"][0])) == (6e4, 300.0)
    done("export", "--ssp", "--only", "pid", *given)
    system = read_system(tmp_path / "out" / "pid.ssp")
    try:
        values = {e.name: e.start_values for e in system.elements}
    finally:
        system.remove()
    assert (values["plant"]["sigma0"], values["controller"]["Kp"]) == (6e4, 300.0)


# -- the file itself ------------------------------------------------------------------------

numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.text(min_size=1, max_size=4)
values = st.builds(
    lambda v, unit, low, high, source: Value(v, unit, (v - low, v + high), source),
    st.floats(-1e100, 1e100),
    st.text(max_size=3),
    st.floats(0, 1e100) | st.just(float("inf")),
    st.floats(0, 1e100) | st.just(float("inf")),
    st.text(max_size=5),
) | st.builds(Value, numbers)


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],  # of a machine that has much to do
)
@given(
    st.dictionaries(names, values, max_size=4),
    st.dictionaries(names, st.dictionaries(names, values, min_size=1, max_size=2), max_size=3),
    st.dictionaries(names, st.text(max_size=5), max_size=2),
)
def test_whatever_is_written_is_read_back(tmp_path_factory, plant, controllers, reasons):
    file = ParameterFile(plant=plant, controllers=controllers, not_identified=reasons)
    path = file.save(tmp_path_factory.mktemp("written"))
    read = read_parameters(path)
    assert (read.plant, read.controllers, read.not_identified) == (plant, controllers, reasons)

"""The command: files in, parameters, intervals, verdicts and pictures out; faults in one line."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest
from synthetic.records import record_of, sine_velocity

from ballscrew.identify_command import add_parser
from ballscrew.options import BadRequest
from ballscrew.orchestration.parameter_reading import read_parameters

DAHL = {"sigma": 87750.0, "Fc": 2.0, "alpha": 1.0}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Records of a Dahl surface in either direction, as a third-party FMU would write them."""
    folder = tmp_path_factory.mktemp("data")
    random = np.random.default_rng(1)
    paths = []
    for k, sign in enumerate((1, -1, 1, -1)):
        record = record_of(sine_velocity(sign * 1e-3, 1.0, 3.15), "dahl", DAHL, random)
        path = folder / f"{k}.csv"
        table = np.column_stack([record.time, 1e3 * record.position, record.force])
        np.savetxt(path, table, delimiter=";", header="t;q;F", comments="", fmt="%.9g")
        paths.append(str(path))
    return paths


def run(*arguments):
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers(), argparse.ArgumentParser)
    options = parser.parse_args(["identify", *arguments])
    return options.action(options)


FOREIGN = ("--map", "t=time", "--map", "q=x", "--map", "F=force")
FOREIGN += ("--unit", "x=mm", "--unit", "time=s", "--unit", "force=N")


@pytest.mark.usefixtures("drawn")
def test_a_stranger_s_files_give_parameters_a_file_and_pictures(data, tmp_path, capsys):
    code = run(*data, "--law", "dahl", "--out", str(tmp_path), *FOREIGN)
    assert code == 0
    printed = capsys.readouterr().out
    assert "sigma" in printed
    assert "N/m" in printed
    told = json.loads((tmp_path / "identified.json").read_text())
    for name, truth in DAHL.items():
        entry = told["parameters"][name]
        assert entry["low"] <= truth <= entry["high"], name
        assert entry["identified"]
        assert {"value", "unit", "standard_error", "method"} <= set(entry)
    assert set(told["per_direction"]) == {"forwards", "backwards", "averaged"}
    assert len(told["thesis"]["eqs_2_5_to_2_7"]) == 4
    assert any("no filters stated" in line for line in told["friction_estimation"][data[0]])
    file = read_parameters(tmp_path / "parameters.toml")
    assert file.law == "dahl"
    for name in DAHL:
        entry, written = told["parameters"][name], file.plant[name]
        assert (written.value, written.unit) == (entry["value"], entry["unit"])
        assert written.interval == (entry["low"], entry["high"])
        assert data[0] in written.source
    for stem in ("friction_map", "residuals"):
        assert (tmp_path / f"{stem}.png").stat().st_size > 5000


def test_a_rotary_record_gives_the_same_parameters_by_the_lead(data, tmp_path):
    """The same motion and force as angle and torque of a screw, with names, units and commas."""
    lead, paths = 0.004, []
    for k, path in enumerate(data):
        t, q, force = np.loadtxt(path, delimiter=";", skiprows=1).T
        lines = ["Rig 3;today", "t [ms];angle [deg];torque [mN*m]"]
        rows = zip(1e3 * t, 360e-3 * q / lead, 1e3 * force * lead / (2 * np.pi), strict=True)
        lines += [f"{a:.9g};{b:.12g};{c:.12g}".replace(".", ",") for a, b, c in rows]
        paths.append(tmp_path / f"{k}.csv")
        paths[-1].write_text("\n".join(lines))
    names = ("--map", "t=time", "--map", "angle=x", "--map", "torque=force")
    given = (*map(str, paths), "--law", "dahl", *names, "--out", str(tmp_path / "out"))
    with pytest.raises(BadRequest, match="use --lead METRES"):
        run(*given)
    assert run(*given, "--lead", str(lead)) == 0
    told = json.loads((tmp_path / "out" / "identified.json").read_text())
    for name, truth in DAHL.items():
        entry = told["parameters"][name]
        assert entry["low"] <= truth <= entry["high"], name


def test_json_goes_to_standard_output_alone(data, tmp_path, capsys):
    run(*data[:2], "--law", "dahl", "--out", str(tmp_path), "--json", *FOREIGN)
    printed = capsys.readouterr()
    assert json.loads(printed.out)["law"] == "dahl"
    # a unit that was not said, or wrongly, shows in what the record is taken for
    assert "positions cover up to 0.002 m, forces reach" in printed.err


def test_a_law_that_is_not_in_the_records_gives_exit_code_one(data, tmp_path, capsys):
    """Dahl's friction cannot tell LuGre's sigma1; that is said, with its reason."""
    code = run(*data, "--law", "lugre", "--out", str(tmp_path), *FOREIGN)
    assert code == 1
    assert "sigma1 cannot be identified from these trials, because" in capsys.readouterr().err
    file = read_parameters(tmp_path / "parameters.toml")
    assert "sigma1" not in file.plant
    assert file.not_identified["sigma1"]


def test_bad_requests_are_one_line(data, tmp_path):
    for arguments, words in (
        ((data[0], "--law", "dahll"), "did you mean dahl?"),
        ((data[0], "--law", "dahl"), "--map"),
        ((data[0], "--law", "dahl", *FOREIGN[:6], *FOREIGN[8:]), "--unit x= with"),
        (("none.csv", "--law", "dahl"), "no such file"),
        ((data[0], "--law", "dahl", *FOREIGN, "--mass", "heavy"), "expected a number"),
        (
            (data[0], "--law", "dahl", *FOREIGN[:6], *FOREIGN[8:], "--unit", "x=inch"),
            "expected one of m, cm",
        ),
        ((data[0], "--law", "dahl", *FOREIGN, "--unit", "x=inch"), "given as mm and as inch"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "sigma"), "it has no value"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "sigma=stiff"), "expected a number"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "sigma=-1"), "expected a number above 0"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "F=1"), "no parameter 'F'"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "Fc", "--fix", "Fc=1"), "given twice"),
        (
            (data[0], "--law", "dahl", *FOREIGN, "--offset", "--fix", "offset=1"),
            "held at 1 N and fitted",
        ),
    ):
        with pytest.raises(BadRequest) as caught:
            run(*arguments, "--out", str(tmp_path))
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


def test_values_are_held_and_a_constant_force_is_fitted(data, tmp_path, capsys):
    prior_model = tmp_path / "prior.toml"
    prior_model.write_text(
        'format = "ballscrew-parameters 1"\nkind = "drive"\nlaw = "dahl"\n'
        "[plant]\nalpha = 1.0\nm = 1.0\n"
    )
    fix = ("--fix", "alpha", "--fix", "sigma=87750", "--offset")
    out = tmp_path / "out"
    given = (*data, "--law", "dahl", *FOREIGN, "--params", str(prior_model), *fix)
    assert run(*given, "--out", str(out)) == 0
    printed = capsys.readouterr()
    rows = {line.split()[0]: line for line in printed.out.splitlines() if line}
    assert rows["alpha"].endswith("held")
    assert rows["sigma"].endswith("held")
    assert "a constant force and a Coulomb friction" in printed.err
    told = json.loads((out / "identified.json").read_text())["parameters"]
    assert told["sigma"]["low"] == told["sigma"]["high"] == 87750.0
    assert told["offset"]["low"] <= 0.0 <= told["offset"]["high"]
    assert told["Fc"]["low"] <= DAHL["Fc"] <= told["Fc"]["high"]
    written = read_parameters(out / "parameters.toml").plant
    assert written["offset"].value == told["offset"]["value"]
    assert written["sigma"].source == "given, held"


def test_a_record_of_the_velocity_gives_the_parameters_and_says_so(data, tmp_path, capsys):
    paths = []
    for k, path in enumerate(data):
        t, q, force = np.loadtxt(path, delimiter=";", skiprows=1).T
        step = t[1] - t[0]
        speed = np.round(np.gradient(np.interp(t, t, q), step), 3)
        paths.append(tmp_path / f"{k}.csv")
        table = np.column_stack([t, speed, force])
        header = "time;v [mm/s];force"
        np.savetxt(paths[-1], table, delimiter=";", header=header, comments="", fmt="%.9g")
    run(*map(str, paths), "--law", "dahl", "--out", str(tmp_path / "out"))
    told = json.loads((tmp_path / "out" / "identified.json").read_text())["parameters"]
    assert told["Fc"]["low"] <= DAHL["Fc"] <= told["Fc"]["high"]
    assert "x is the integral of v" in capsys.readouterr().err


def test_a_record_of_friction_alone_is_identified_without_a_mass(tmp_path):
    time = np.arange(0.0, 4.0, 1e-3)
    x = 0.02 * (1.0 - np.cos(2 * np.pi * time))
    v = 0.02 * 2 * np.pi * np.sin(2 * np.pi * time)
    force = 5.0 * np.sign(v) + 20.0 * v + 0.05 * np.random.default_rng(0).standard_normal(len(time))
    table = np.column_stack([time, x, force])
    path = tmp_path / "friction.csv"
    np.savetxt(path, table, delimiter=",", header="time,x,force", comments="")
    out = tmp_path / "out"
    run(str(path), "--law", "classical", "--mass", "0", "--out", str(out))
    found = read_parameters(out / "parameters.toml").plant
    assert found["Fc"].value == pytest.approx(5.0, rel=0.02)
    assert found["sigma2"].value == pytest.approx(20.0, rel=0.02)

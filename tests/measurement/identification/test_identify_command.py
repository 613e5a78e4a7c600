"""The command: files in, parameters, intervals, verdicts and pictures out; faults in one line."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from identification.records import record_of, sine_velocity

from ballscrew.cli import main
from ballscrew.measurement.diagnosis.model import drive_of
from ballscrew.measurement.identification.identify import check_held
from ballscrew.orchestration.loop.parameter_file import read_parameters
from ballscrew.solver.errors import BadParameter

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
    return main(["identify", *arguments])


FOREIGN = ("--map", "t=time", "--map", "q=x", "--map", "F=force")
FOREIGN += ("--unit", "x=mm", "--unit", "time=s", "--unit", "force=N")


@pytest.mark.usefixtures("drawn")
def test_a_stranger_s_files_give_parameters_a_file_and_pictures(data, tmp_path, capsys):
    assert run(*data, "--law", "dahl", "--out", str(tmp_path), *FOREIGN) == 0
    printed = capsys.readouterr().out
    assert "sigma" in printed
    assert "N/m" in printed
    share = float(re.search(r"fit on data held out +([0-9.]+) %", printed)[1])
    assert 90 < share < 100
    told = json.loads((tmp_path / "identified.json").read_text())
    for name, truth in DAHL.items():
        entry = told["parameters"][name]
        assert entry["low"] <= truth <= entry["high"], name
        assert entry["identified"]
        assert {"value", "unit", "standard_error", "method"} <= set(entry)
    assert set(told["per_direction"]) == {"forwards", "backwards"}
    assert any("the same lag" in note for note in told["record_notes"][data[0]])
    file = read_parameters(tmp_path / "parameters.toml")
    assert file.law == "dahl"
    for name in DAHL:
        entry, written = told["parameters"][name], file.plant[name]
        assert (written.value, written.unit) == (entry["value"], entry["unit"])
        assert written.interval == (entry["low"], entry["high"])
        assert data[0] in written.source
    for stem in ("friction_map", "residuals"):
        assert (tmp_path / f"{stem}.png").stat().st_size > 5000


@pytest.mark.ci
def test_a_law_that_is_not_in_the_records_gives_exit_code_one(data, tmp_path, capsys):
    """Dahl's friction cannot tell LuGre's sigma1; that is said, with its reason."""
    assert run(*data, "--law", "lugre", "--out", str(tmp_path), *FOREIGN) == 1
    assert "sigma1 cannot be identified from these trials, because" in capsys.readouterr().err
    file = read_parameters(tmp_path / "parameters.toml")
    assert file.not_identified["sigma1"]
    kept = json.loads((tmp_path / "identified.json").read_text())["parameters"]["sigma1"]
    assert file.plant["sigma1"].value == kept["value"]
    assert file.plant["sigma1"].source.startswith("an estimate, not identified from ")
    assert {"sigma0", "sigma2", "Fc", "Fs", "Vs", "m"} <= set(file.plant)
    assert drive_of(file).tolerance["sigma1"] == 0.9


@pytest.mark.ci
def test_bad_requests_are_one_line(data, tmp_path, capsys):
    for arguments, words in (
        ((data[0], "--law", "dahll"), "did you mean dahl?"),
        ((data[0], "--law", "dahl"), "use map theirs=time"),
        ((data[0], "--law", "dahl", *FOREIGN[:6], *FOREIGN[8:]), "unit x= with"),
        (("none.csv", "--law", "dahl"), "no such file"),
        ((data[0], "--law", "dahl", *FOREIGN, "--mass", "heavy"), "expected a number"),
        ((data[0], "--law", "dahl", *FOREIGN, "--unit", "x=inch"), "given as mm and as inch"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "sigma"), "it has no value"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "sigma=-1"), "expected a number above 0"),
        ((data[0], "--law", "dahl", *FOREIGN, "--fix", "Fc", "--fix", "Fc=1"), "given twice"),
        (
            (data[0], "--law", "dahl", *FOREIGN, "--offset", "--fix", "offset=1"),
            "held at 1 N and fitted",
        ),
    ):
        assert run(*arguments, "--out", str(tmp_path)) == 2
        said = capsys.readouterr().err
        assert words in said
        assert said.count("\n") == 1


@pytest.mark.ci
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


@pytest.mark.ci
@pytest.mark.parametrize(
    ("law", "fixed", "offset", "words"),
    [
        ("dahl", {"offset": float("nan")}, False, "expected a finite number"),
        ("bliman_sorine", {"f1": 1.0}, False, "fitted together with f2, eta"),
        ("maxwell_slip", {"alpha1": 0.2}, False, "cannot be fixed alone"),
        ("directional_lugre", {"Fc": 1.0}, False, "no parameter 'Fc'"),
        ("directional_lugre", {}, True, "fix offset at a value"),
    ],
)
def test_what_cannot_be_held_or_told_is_refused_in_one_line(law, fixed, offset, words):
    with pytest.raises(BadParameter, match=words) as refused:
        check_held(law, fixed, offset)
    assert "\n" not in str(refused.value)

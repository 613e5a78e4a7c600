"""The parameter file: what is not said, what makes no sense, and an extended plant's own file."""

from types import SimpleNamespace

import pytest
from diagnosed import whole

from ballscrew.measurement.diagnosis.corrected import corrected, with_causes
from ballscrew.measurement.diagnosis.model import drive_of
from ballscrew.orchestration.loop.parameter_file import ParameterFile, read_parameters
from ballscrew.plant import plant_of
from ballscrew.solver.errors import BadParameters

EMPS = """
kind = "drive"
law = "classical"
[plant]
m = 95.11
gain = 35.15
offset = -3.16
sigma2 = 203.5
Fc = 20.39
[tolerance]
m = 0.1
"""


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "axis.toml"
        path.write_text(text)
        return read_parameters(path)

    return write


def test_an_empty_file_or_none_is_the_nominal_axis(written):
    model = drive_of(written(""))
    assert model == drive_of(ParameterFile())
    assert (model.kind, model.law) == ("ball_screw", "modified_lugre")
    assert model.values["R"] == 21.4
    assert model.values["sigma0"] == 66967.231
    assert set(model.tolerance.values()) == {0.03}
    assert not {"L", "p", "Kv", "offset"} & set(model.tolerance)


def test_a_drive_without_a_motor_and_without_a_break_away_force(written):
    model = drive_of(written(EMPS))
    assert model.kind == "drive"
    assert model.values["Fs"] == model.values["Fc"] == 20.39
    assert model.values["offset"] == -3.16
    assert model.tolerance["m"] == 0.1
    assert model.tolerance["gain"] == 0.03
    assert model.friction_scale == 20.39
    held = drive_of(written(EMPS.replace("m = 0.1", "m = 0")))
    assert set(model.adjustable) - set(held.adjustable) == {"m"}


def test_each_direction_has_its_own_break_away_force(written):
    text = whole("plant_directional_lugre", Fc_pos=1.5, Fs_neg=3.0, Fc_neg=1.2)
    without = "".join(line for line in text.splitlines(True) if not line.startswith("Fs_pos"))
    model = drive_of(written('law = "directional_lugre"\n' + without))
    assert (model.values["Fs_pos"], model.values["Fs_neg"]) == (1.5, 3.0)


def test_another_law_takes_what_it_knows_of_the_file(written):
    dahl = EMPS.replace("[plant]\n", "[plant]\nsigma = 1e6\nalpha = 1.0\n")
    model = drive_of(written(dahl.replace('"classical"', '"dahl"')), law="classical")
    assert model.law == "classical"
    assert (model.values["Fc"], model.values["sigma2"]) == (20.39, 203.5)
    assert "sigma" not in model.values


@pytest.mark.ci
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('plan = "drive"', "there is no 'plan', did you mean plant"),
        ('kind = "fmu"', "kind is 'fmu', expected one of ball_screw, drive: the equations"),
        ("[plant]\nFcc = 1.0", r"\[plant\] there is no 'Fcc', did you mean Fc"),
        ("[plant]\nFc = '1'", r"Fc is '1', expected a finite number in SI units"),
        ("[plant]\nm = -1", "m is -1 kg, expected 1e-06 to inf .mass of the block"),
        ("[tolerance]\nKv = 0.1", r"\[tolerance\] Kv = 0.1, expected a share of its value"),
        ("[tolerance]\nm = 3", r"\[tolerance\] m = 3, expected a share of its value"),
        ('kind = "drive"\n[plant]\nR = 2', r"\[plant\] there is no 'R'"),
    ],
)
def test_what_makes_no_sense_is_one_line(written, text, said):
    with pytest.raises(BadParameters, match=said) as caught:
        drive_of(written(text))
    assert "\n" not in str(caught.value)
    assert "axis.toml" in str(caught.value)


def written_by_a_diagnosis(model, name, values):
    """The text of its parameter file, with one cause found."""
    cause = SimpleNamespace(name=name, parameters=values, intervals={})
    result = SimpleNamespace(
        records=("one.csv",),
        command="voltage",
        command_shift=0.0,
        prior=model,
        adjusted=model,
        corrected=model,
        causes=[cause],
    )
    return corrected(result, with_causes(model, [(name, values)]), ParameterFile()).text()


@pytest.mark.parametrize(
    ("kind", "law"),
    [("ball_screw", "directional_lugre"), ("drive", "classical"), ("drive", "maxwell_slip")],
)
def test_an_extended_plants_file_is_read_back(written, kind, law):
    table = whole(plant_of(law, kind), m=0.1234567)
    model = drive_of(written(f'kind = "{kind}"\nlaw = "{law}"\n{table}'))
    again = drive_of(written(written_by_a_diagnosis(model, "load_bias", {"load": 0.3})))
    assert again == model
    heavier = written_by_a_diagnosis(model, "unmodelled_inertia", {"m": 1.0 / 3.0})
    again = drive_of(written(heavier))
    assert again == model.changed({"m": 1.0 / 3.0})


def test_bristles_found_under_the_classical_law_are_a_law_of_the_file(written):
    prior_model = drive_of(written(EMPS))
    found = ("presliding_hysteresis", {"sigma0": 1e6})
    again = drive_of(written(written_by_a_diagnosis(prior_model, *found)))
    assert again.law == "modified_lugre"
    assert again.values["sigma0"] == 1e6

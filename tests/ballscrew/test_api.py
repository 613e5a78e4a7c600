"""The public functions: documentation, types, examples that run, results that are alike."""

import doctest
import inspect
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import ballscrew
from ballscrew.result import Result

FUNCTIONS = [n for n in ballscrew.__all__ if inspect.isfunction(getattr(ballscrew, n))]
OWN = [n for n in FUNCTIONS if n != "symbol"]


@pytest.mark.ci
def test_the_examples_run_as_they_are_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    modules = {sys.modules[getattr(ballscrew, name).__module__] for name in OWN}
    results = [doctest.testmod(module) for module in modules]
    assert sum(tried for _, tried in results) > 20
    assert not any(failed for failed, _ in results)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """One result of each kind that is soon there."""
    folder = tmp_path_factory.mktemp("map")
    axes = {"x": "sigma0_hat=66966:66968:2", "y": "sigma1_hat=340:350:2"}
    record = ballscrew.run_trial("2.4/7", law="lugre")
    saved = tmp_path_factory.mktemp("record")
    record.save(saved, pictures=False)
    return {
        "run": ballscrew.run("iol", stop=0.3),
        "swap": ballscrew.swap(["iol", "pid"], stop=0.2),
        "lyapunov": ballscrew.lyapunov("iol", stop=1.0),
        "map": ballscrew.stability_map("iol", **axes, folder=folder, stop=0.5),
        "run_trial": record,
        "identify": ballscrew.identify(
            ballscrew.read_force_records([saved]), "classical", fixed={"Vs": 1e-3}
        ),
    }


@pytest.mark.parametrize("kind", ["run", "swap", "lyapunov", "map", "run_trial", "identify"])
def test_each_result_is_saved_drawn_tabled_and_shown(results, kind, tmp_path):
    result = results[kind]
    assert isinstance(result, Result)
    result.save(tmp_path)
    assert (tmp_path / "report.html").is_file()
    assert len(result.plot().axes) > 0
    assert result.plot()._repr_png_().startswith(b"\x89PNG")
    assert len(result.to_pandas()) > 0
    html = result._repr_html_()
    assert html.startswith("<p><b>")
    assert "<td>" in html
    assert isinstance(result.trusted, bool)
    assert len(repr(result)) < 500
    assert "\n" not in repr(result)


def test_a_table_holds_the_signals_of_the_run_which_is_saved_without_pictures_on_request(
    results, tmp_path
):
    run = results["run"].run
    table = results["run"].to_pandas()
    assert table.index.name == "time"
    assert np.array_equal(table["x"].to_numpy(), run.outputs["x"])
    assert np.array_equal(table["u"].to_numpy(), results["run"]["u"])
    assert np.array_equal(table.index, results["run"].time)
    results["run"].save(tmp_path, pictures=False)
    assert not list(tmp_path.glob("*.png"))
    assert (tmp_path / "metrics.json").is_file()


def proportional(gain):
    """A controller of a user's own, of three lines."""
    x, goal = ballscrew.symbol("x"), ballscrew.symbol("x_d")
    return ballscrew.Component(
        name="proportional",
        description="Proportional feedback of the position",
        inputs=(
            ballscrew.Input("x_d", "m", "set-point", role="reference"),
            ballscrew.Input("x", "m", "position"),
        ),
        parameters=(ballscrew.Parameter("Kp", gain, "V/m", "gain", "a user's"),),
        outputs=(ballscrew.Output("u", "V", "command", ballscrew.symbol("Kp") * (goal - x)),),
    )


def test_a_component_made_a_minute_ago_runs_and_has_exponents(tmp_path):
    own = proportional(300.0)
    result = ballscrew.run(own, stop=0.5)
    assert result.trusted, result.headline()
    changed = ballscrew.run(own, stop=0.5, controller_values={"Kp": 30.0})
    assert changed.run.commands["u"][0] == pytest.approx(0.1 * result.run.commands["u"][0])
    assert ballscrew.lyapunov(own, stop=1.0).label.startswith("proportional on plant")
    assert ballscrew.export(own, tmp_path / "own.fmu").is_file()


@pytest.mark.ci
def test_components_made_a_minute_ago_are_told_apart_sampled_and_mapped(tmp_path):
    stiff, soft = proportional(300.0), proportional(30.0)
    found = ballscrew.swap([stiff, soft], stop=0.1, sampled=2e-3)
    assert [r.loop.label for r in found.results] == ["proportional+sampled"] * 2
    first = [r.run.commands["u"][0] for r in found.results]
    assert first[0] == pytest.approx(10.0 * first[1])
    axes = {"x": "Kp=200:300:2", "y": "plant.Fs=2.2:2.4:2"}
    made = ballscrew.stability_map(stiff, **axes, folder=tmp_path, stop=0.2, workers=2)
    assert "proportional" in made.headline()


def test_a_coupling_is_given_by_its_name():
    named = ballscrew.run("pid", coupling="jacobi", stop=0.1, step=1e-3)
    assert named.run.coupling is ballscrew.Coupling.JACOBI
    tangent = ballscrew.run("pid", coupling="interface-jacobian", stop=0.1, step=1e-3)
    assert tangent.run.coupling is ballscrew.Coupling.INTERFACE_JACOBIAN
    for wrong in ("monolithic", 3):
        with pytest.raises(ValueError, match=f"coupling is {wrong!r}, .* fmus=False in Python"):
            ballscrew.Loop("pid", coupling=wrong)


def test_without_fmus_a_loop_is_one_system_of_equations():
    """The reference for the runs over FMUs: they end at the same place, and others are refused."""
    how = {"stop": 0.3, "step": 1e-4}
    whole, fmus = (ballscrew.run("iol", **how, fmus=choice) for choice in (False, True))
    assert whole.figures()["coupling"] == "monolithic"
    assert whole["x"][-1] == pytest.approx(fmus["x"][-1], rel=1e-4)
    again = ballscrew.swap(["iol", "pid"], **how, fmus=False).results
    assert again[0].run.outputs["x"][-1] == whole["x"][-1]
    assert [r.figures()["coupling"] for r in again] == ["monolithic"] * 2
    for wrong in ({"coupling": "jacobi"}, {"mapping": {"a": "b"}}):
        with pytest.raises(ValueError, match="a loop without FMUs has no coupling"):
            ballscrew.run("pid", fmus=False, **wrong)
    with pytest.raises(ValueError, match=r"an \.ssp does not give them"):
        ballscrew.SystemLoop("two.ssp", fmus=False)


def test_a_swap_names_what_failed_and_refuses_no_controllers(tmp_path):
    (tmp_path / "hand.fmu").write_bytes(b"no archive")
    found = ballscrew.swap(["pid", tmp_path / "hand.fmu"], stop=0.1)
    assert repr(found).endswith("failed: hand>")
    assert list(found.doubts())[-1].startswith("hand was left out: ")
    with pytest.raises(ValueError, match="controllers is empty"):
        ballscrew.swap([])


def test_each_controller_of_a_swap_takes_its_own_values():
    values = {"pid": {"Kp": 300.0}}
    found = ballscrew.swap(["iol", "pid"], stop=0.1, controller_values=values)
    alone = ballscrew.run("pid", stop=0.1, controller_values=values["pid"])
    assert found.results[1].run.outputs["x"].tolist() == alone.run.outputs["x"].tolist()
    for wrong in ({"controller_values": {"pidd": {}}}, {"mapping": {"hand": {}}}):
        with pytest.raises(ValueError, match="expected one of iol, pid"):
            ballscrew.swap(["iol", "pid"], stop=0.1, **wrong)


@pytest.mark.ci
def test_bad_requests_are_told_by_one_exception_with_one_line(tmp_path):
    with pytest.raises(ValueError, match="controller is 3, expected a name, a path or a"):
        ballscrew.run(3)
    with pytest.raises(ValueError, match=r"plant_values\['m'\] is nan, expected a finite"):
        ballscrew.run("pid", plant_values={"m": float("nan")})
    with pytest.raises(ValueError, match="a single part"):
        ballscrew.export("pid", "pid.ssp", tangents=2)
    with pytest.raises(ValueError, match=r"tolerance is 0\.1, expected 1e-13"):
        ballscrew.lyapunov("pid", stop=0.2, tolerance=0.1)
    with pytest.raises(ValueError, match=r"two: an \.ssp can only be run; give a Loop"):
        ballscrew.lyapunov(ballscrew.SystemLoop("two.ssp"), stop=0.2)
    with pytest.raises(AttributeError, match="no attribute 'rune'"):
        ballscrew.rune  # noqa: B018
    for ask in (ballscrew.diagnose, lambda file: ballscrew.identify(file, "lugre")):
        with pytest.raises(ValueError, match=r"nowhere\.csv"):  # one file in place of a list
            ask("nowhere.csv")


@pytest.mark.ci
def test_a_map_keeps_to_given_parameters_and_gives_its_cells_by_column(tmp_path):
    axes = {"x": "plant.Fs=1.5:2.5:3", "y": "setpoint=0.01:0.02:2"}
    given = {"plant_values": {"m": 2.0}, "controller_values": {"Kp": 900.0}}
    made = ballscrew.stability_map("pid", **axes, folder=tmp_path / "map", stop=0.2, **given)
    cells = made.columns()
    assert cells["plant.Fs"] == pytest.approx([1.5, 2.0, 2.5] * 2)
    assert cells["setpoint"] == pytest.approx([0.01] * 3 + [0.02] * 3)
    given = {"plant_values": {"m": 2.0, "Fs": 2.0}, "controller_values": {"Kp": 900.0}}
    alone = ballscrew.run("pid", reference=0.02, stop=0.2, fmus=False, **given)
    error = 0.02 - alone.run.outputs["x"][-1]
    assert cells["final_error"][4] == pytest.approx(error, rel=1e-4)


@pytest.mark.ci
def test_a_map_without_a_decided_cell_is_not_trusted_and_says_how_many_are_open(tmp_path):
    axes = {"x": "Kp=300:400:2", "y": "plant.Fs=2.2:2.4:2"}
    made = ballscrew.stability_map("pid", **axes, folder=tmp_path, stop=0.2)
    for counts, trusted in (({"settles": 4}, True), ({"undecided": 4}, False)):
        summary = replace(made.summary, verdicts=counts, random_disagreed=0)
        of_counts = replace(made, summary=summary)
        assert of_counts.trusted is trusted
        assert ("4 undecided" in of_counts.headline()) is not trusted
        assert ("4 of 4 undecided" in of_counts.badge) is not trusted


PROGRAM = """
import numpy as np
import numpy.typing as npt

import ballscrew
from ballscrew import Component, Input, Output, Parameter, symbol


def spring() -> Component:
    return Component(
        "spring",
        "u = K (x_d - x)",
        parameters=(Parameter("K", 500.0, "V/m", "gain", "chosen"),),
        inputs=(Input("x", "m", "position"), Input("x_d", "m", "set-point")),
        outputs=(Output("u", "V", "command", symbol("K") * (symbol("x_d") - symbol("x"))),),
    )


result = ballscrew.run(spring(), stop=1.0)
position: npt.NDArray[np.float64] = result.run.outputs["x"]
trusted: bool = result.run.verdict.trusted
word: str = result.run.verdict.word
result.save("out")
version: str = ballscrew.__version__
"""


@pytest.mark.ci
def test_a_users_program_passes_mypy_strict_and_its_mistakes_are_found(tmp_path):
    def checked(name, text):
        (tmp_path / name).write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", "cache", name]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)

    typed = [name for name in ballscrew.__all__ if name != "TIME"]  # SymPy's; it has no types
    every = "".join(f"reveal_type(ballscrew.{name})\n" for name in typed)
    right = checked("right.py", PROGRAM + every)
    assert right.returncode == 0, right.stdout  # a name that is missing is an error
    assert 'is "Any"' not in right.stdout, right.stdout
    wrong = checked("wrong.py", PROGRAM.replace("stop=1.0", 'stop="1"') + "ballscrew.runs()\n")
    assert 'has no attribute "runs"' in wrong.stdout
    assert 'incompatible type "str"' in wrong.stdout

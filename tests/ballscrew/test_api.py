"""The public functions: complete documentation, examples that run, results that are alike."""

import doctest
import inspect
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpydoc.docscrape import FunctionDoc

import ballscrew
from ballscrew.cli import main
from ballscrew.results.result import Result

FUNCTIONS = [n for n in ballscrew.__all__ if inspect.isfunction(getattr(ballscrew, n))]
OWN = [n for n in FUNCTIONS if n != "symbol"]


def test_the_package_offers_a_few_names_and_all_of_them_are_there():
    assert 20 <= len(ballscrew.__all__) <= 40
    assert set(ballscrew.__all__) <= set(dir(ballscrew))
    assert all(getattr(ballscrew, n) is not None for n in ballscrew.__all__)
    with pytest.raises(AttributeError, match="no attribute 'rune'"):
        ballscrew.rune  # noqa: B018


@pytest.mark.parametrize("name", OWN)
def test_each_function_says_what_it_takes_and_what_it_returns(name):
    function = getattr(ballscrew, name)
    signature = inspect.signature(function)
    kinds = {p.kind for p in signature.parameters.values()}
    assert inspect.Parameter.VAR_KEYWORD not in kinds  # a wrong keyword is never swallowed
    documented = FunctionDoc(function)
    told = [n for entry in documented["Parameters"] for n in entry.name.split(", ")]
    assert told == list(signature.parameters) or set(told) == set(signature.parameters)
    assert documented["Returns"]
    assert documented["Summary"]
    if signature.parameters:
        assert documented["Raises"]
    with pytest.raises(TypeError, match="unexpected keyword"):
        function(nobody_has_this=1)


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


@pytest.mark.parametrize(
    ("kind", "files"),
    [
        (
            "run",
            {"report.html", "trajectory.csv", "metrics.json", "parameters.toml", "position.png"},
        ),
        ("swap", {"report.html", "comparison.csv", "comparison.json", "comparison.png"}),
        ("lyapunov", {"report.html", "lyapunov.json", "lyapunov.csv", "lyapunov.png"}),
        ("map", {"report.html", "map.parquet", "map.json", "map.png"}),
        ("run_trial", {"record.csv", "truth.csv", "trial.json", "record.png"}),
        ("identify", {"identified.json", "parameters.toml", "friction_map.png"}),
    ],
)
def test_each_result_is_saved_drawn_tabled_and_shown(results, kind, files, tmp_path):
    result = results[kind]
    assert isinstance(result, Result)
    result.save(tmp_path)
    assert files <= {f.name for f in tmp_path.iterdir()}
    assert len(result.plot().axes) > 0
    assert result.plot()._repr_png_().startswith(b"\x89PNG")
    table = result.to_pandas()
    assert len(table) > 0
    html = result._repr_html_()
    assert html.startswith("<p><b>")
    assert "<td>" in html
    assert isinstance(result.trusted, bool)


def test_a_run_that_cannot_be_believed_says_so():
    result = ballscrew.run("iol", stop=0.3, step=1e-4, coupling=ballscrew.Coupling.GAUSS_SEIDEL)
    assert not result.trusted
    assert result.headline().startswith("iol, not converged")


def test_numbers_and_pictures_can_be_saved_apart(results, tmp_path):
    results["run"].save(tmp_path, pictures=False)
    assert not list(tmp_path.glob("*.png"))
    assert (tmp_path / "metrics.json").is_file()


def test_a_table_holds_the_signals_of_the_run(results):
    run = results["run"].run
    table = results["run"].to_pandas()
    assert table.index.name == "time"
    assert np.array_equal(table["x"].to_numpy(), run.outputs["x"])
    assert np.array_equal(table["u"].to_numpy(), run.commands["u"])


def test_what_a_result_says_is_text_in_a_notebook(results):
    result = results["run_trial"]
    told = type(result)(**{**vars(result), "notes": ["<b>past its range</b>"]})
    assert "<b>past" not in told._repr_html_()
    assert "&lt;b&gt;past its range" in told._repr_html_()
    assert not told.trusted


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
    found = ballscrew.lyapunov(own, stop=1.0)
    assert found.label.startswith("proportional on plant")
    assert ballscrew.export(own, tmp_path / "own.fmu").is_file()


@pytest.mark.parametrize(
    ("options", "file", "given"),
    [
        ("--only pid", "pid.fmu", {}),
        ("--loop pid --plant plant_dahl", "pid_loop.fmu", {"plant": "plant_dahl"}),
        ("--ssp --only pid", "pid.ssp", {}),
        ("--variational --tangents 2 --only pid", "pid_variational.fmu", {"tangents": 2}),
    ],
)
def test_export_writes_what_the_command_writes(tmp_path, options, file, given):
    values = tmp_path / "values.toml"
    values.write_text(
        'format = "ballscrew-parameters 1"\nkind = "ball_screw"\n[controller.pid]\nKp = 300.0\n'
    )
    told = ["--params", str(values), "--out", str(tmp_path / "theirs")]
    assert main(["export", *options.split(), *told]) == 0
    given["params"] = ballscrew.read_parameters(values)
    path = ballscrew.export("pid", tmp_path / file, **given)
    assert path.read_bytes() == (tmp_path / "theirs" / file).read_bytes()


def test_a_component_made_a_minute_ago_is_called_by_its_own_name(tmp_path):
    own = proportional(300.0)
    assert ballscrew.run(own, stop=0.1).loop.label == "proportional"
    found = ballscrew.swap([own, "pid"], stop=0.1, sampled=2e-3)
    labels = [r.loop.label for r in found.results]
    assert labels == ["proportional+sampled", "pid+sampled"]
    axes = {"x": "Kp=200:300:2", "y": "plant.Fs=2.2:2.4:2"}
    made = ballscrew.stability_map(own, **axes, folder=tmp_path, stop=0.2, workers=2)
    assert "proportional" in made.headline()


def test_two_components_of_one_name_are_two_controllers():
    stiff, soft = proportional(300.0), proportional(30.0)
    found = ballscrew.swap([stiff, soft], stop=0.1)
    first = [r.run.commands["u"][0] for r in found.results]
    assert first[0] == pytest.approx(10.0 * first[1])


def test_a_coupling_and_a_set_point_are_given_as_the_command_takes_them(tmp_path):
    named = ballscrew.run("pid", coupling="jacobi", stop=0.1, step=1e-3)
    assert named.run.coupling is ballscrew.Coupling.JACOBI
    tangent = ballscrew.run("pid", coupling="tangent", stop=0.1, step=1e-3)
    assert tangent.run.coupling is ballscrew.Coupling.INTERFACE_JACOBIAN
    move = "move:distance=0.02,speed=1,acceleration=50,jerk=1e4"
    moved = ballscrew.run("pid", reference=move, stop=0.2)
    assert moved.run.reference[[0, -1]] == pytest.approx([0.0, 0.02])
    table = tmp_path / "goal.csv"
    table.write_text("time,x_d\n0,0\n0.1,0.01\n")
    assert ballscrew.run("pid", reference=str(table), stop=0.2).run.reference[-1] == 0.01


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"loop": "pidd"}, "controller 'pidd' is neither .* did you mean pid"),
        ({"plant": "plnt"}, "plant 'plnt' is neither .* did you mean plant"),
        ({"coupling": "jakobi"}, "coupling is 'jakobi', expected one of jacobi"),
        ({"reference": "move:distanse=1"}, "distanse"),
        ({"stop": -1.0}, "stop is -1.0 s, expected more than 0"),
        ({"stop": float("nan")}, "stop is nan, expected a finite number"),
        ({"step": 0.0}, "step is 0.0 s, expected more than 0 and at most stop"),
        ({"step": 30.0}, "step is 30.0 s, expected more than 0 and at most stop"),
        ({"reference": float("inf")}, "reference is inf, expected a finite number"),
        ({"reference": "mvoe:distance=1"}, r"no motion 'mvoe'; .* did you mean move"),
        ({"plant_values": 1e-3}, "plant_values is 0.001, expected a mapping of names to numbers"),
        ({"loop": 3}, "controller is 3, expected a name, a path or a Component"),
        ({"coupling": 3}, "coupling is 3, expected one of jacobi"),
        (
            {"controller_values": {"Kp": "a"}},
            r"controller_values\['Kp'\] is 'a', expected a number",
        ),
        ({"plant_values": {"m": float("nan")}}, r"plant_values\['m'\] is nan, expected a finite"),
    ],
)
def test_a_run_refuses_what_the_command_refuses(given, said):
    with pytest.raises(ValueError, match=said):
        ballscrew.run(**{"loop": "pid", **given})


@pytest.mark.parametrize("loop", [ballscrew.Loop, ballscrew.SystemLoop])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"corrections": 2}, "corrections is 2, expected 0 or 1"),
        ({"time_limit": 0.0}, "time_limit is 0.0 s, expected more than 0"),
    ],
)
def test_a_loop_refuses_what_the_command_refuses(loop, given, said):
    with pytest.raises(ValueError, match=said):
        loop("pid", **given)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"controller_values": {"Kp": "a"}},
            r"controller_values\['Kp'\] is 'a', expected a number",
        ),
        ({"controller_values": {"Kp": float("nan")}}, "is nan, expected a finite number"),
        ({"controller_values": {"Kpp": 1.0}}, "controller has no parameter 'Kpp'; nearest: Kp"),
        ({"plant_values": {"m": "a"}}, r"plant_values\['m'\] is 'a', expected a number"),
        ({"reference": float("nan")}, "reference is nan, expected a finite number"),
    ],
)
def test_exponents_and_maps_refuse_what_the_commands_refuse(given, said, tmp_path):
    axes = {"x": "Ki=300:400:2", "y": "plant.Fs=2:3:2"}
    with pytest.raises(ValueError, match=said):
        ballscrew.lyapunov("pid", stop=0.2, **given)
    with pytest.raises(ValueError, match=said):
        ballscrew.stability_map("pid", **axes, folder=tmp_path / "no", stop=0.2, **given)
    with pytest.raises(ValueError, match="workers is 0, expected a whole number from 1"):
        ballscrew.stability_map("pid", **axes, folder=tmp_path / "no", stop=0.2, workers=0)
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("ask", [ballscrew.identify, ballscrew.diagnose])
def test_a_friction_law_that_is_misspelt_is_told(ask):
    with pytest.raises(ValueError, match=r"law 'lugree' is none of .* did you mean lugre"):
        ask("nowhere.csv", law="lugree")


def test_a_swap_names_what_failed_and_refuses_no_controllers(tmp_path):
    (tmp_path / "hand.fmu").write_bytes(b"no archive")
    found = ballscrew.swap(["pid", tmp_path / "hand.fmu"], stop=0.1)
    assert repr(found).endswith("failed: hand>")
    assert dict(found.facts())["hand"].startswith("failed: ")
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


def test_a_file_is_taken_in_place_of_a_list_of_files():
    for ask in (ballscrew.diagnose, lambda file: ballscrew.identify(file, "lugre")):
        with pytest.raises(ValueError, match=r"nowhere\.csv"):
            ask("nowhere.csv")


def test_a_result_and_a_component_are_one_short_line_in_a_console(results):
    for shown in (*results.values(), ballscrew.component("iol")):
        assert len(repr(shown)) < 500
        assert "\n" not in repr(shown)


def test_bad_requests_are_told_by_one_exception_with_one_line():
    with pytest.raises(KeyError, match="no component 'iel'"):
        ballscrew.component("iel")
    with pytest.raises(ValueError, match="native=True"):
        ballscrew.export("pid", "pid.fmu", fmi=3)
    with pytest.raises(ValueError, match="fmi is 5, expected 2 or 3"):
        ballscrew.export("pid", "pid.fmu", native=True, fmi=5)
    with pytest.raises(ValueError, match="a single part"):
        ballscrew.export("pid", "pid.ssp", tangents=2)
    with pytest.raises(KeyError, match="no component 'pidd'"):
        ballscrew.export("pidd", "pid.fmu")
    with pytest.raises(ValueError, match="NAME=LOW:HIGH:COUNT"):
        ballscrew.stability_map("iol", x="sigma0_hat", y="sigma1_hat=1:2:2", folder="nowhere")


def test_a_map_keeps_to_given_parameters_and_gives_its_cells_by_column(tmp_path):
    axes = {"x": "plant.Fs=1.5:2.5:3", "y": "setpoint=0.01:0.02:2"}
    given = {"plant_values": {"m": 2.0}, "controller_values": {"Kp": 900.0}}
    made = ballscrew.stability_map("pid", **axes, folder=tmp_path / "map", stop=0.2, **given)
    cells = made.columns()
    assert cells["plant.Fs"] == pytest.approx([1.5, 2.0, 2.5] * 2)
    assert cells["setpoint"] == pytest.approx([0.01] * 3 + [0.02] * 3)
    given = {"plant_values": {"m": 2.0, "Fs": 2.0}, "controller_values": {"Kp": 900.0}}
    whole = ballscrew.Coupling("monolithic")
    alone = ballscrew.run("pid", reference=0.02, stop=0.2, coupling=whole, **given)
    error = alone.run.outputs["x"][-1] - 0.02
    assert cells["final_error"][4] == pytest.approx(error, rel=1e-4)
    for wrong in ({"Fs": 2.0}, {"mass": 2.0}, {"m": -1.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            ballscrew.stability_map("pid", **axes, folder=tmp_path / "no", plant_values=wrong)
    assert not (tmp_path / "no").exists()


def test_over_fmus_exponents_and_maps_are_those_of_the_command_and_their_wrong_use_is_told(
    tmp_path,
):
    over = ballscrew.lyapunov("pid", stop=0.2, step=1e-3)
    assert "FMU" in over.method
    assert over.exponents == pytest.approx(ballscrew.lyapunov("pid", stop=0.2).exponents, rel=1e-3)
    axes = {"x": "Kp=300:400:2", "y": "plant.Fs=2.2:2.4:2"}
    made = ballscrew.stability_map("pid", **axes, folder=tmp_path, stop=0.2, step=1e-3)
    assert made.summary.plan.loop.step == 1e-3
    assert "at half the step" in made.headline()
    for wrong in ({"mapping": {"a": "b"}}, {"step": -1.0}, {"step": 1.0}):
        with pytest.raises(ValueError, match=r"step"):
            ballscrew.lyapunov("pid", stop=0.2, **wrong)
        with pytest.raises(ValueError, match=r"step"):
            ballscrew.stability_map("pid", **axes, folder=tmp_path, stop=0.2, **wrong)
    with pytest.raises(ValueError, match=r"two: an \.ssp can only be run; give a Loop"):
        ballscrew.lyapunov(ballscrew.SystemLoop("two.ssp"), stop=0.2)
    by_component = ballscrew.lyapunov(ballscrew.component("pid"), stop=0.2, step=1e-3)
    assert by_component.exponents == pytest.approx(over.exponents, rel=1e-12)


def test_a_map_without_a_decided_cell_is_not_trusted_and_says_how_many_are_open(tmp_path):
    axes = {"x": "Kp=300:400:2", "y": "plant.Fs=2.2:2.4:2"}
    made = ballscrew.stability_map("pid", **axes, folder=tmp_path, stop=0.2)
    for counts, trusted in (({"settles": 4}, True), ({"undecided": 4}, False)):
        summary = replace(made.summary, verdicts=counts, random_disagreed=0)
        of_counts = replace(made, summary=summary)
        assert of_counts.trusted is trusted
        assert ("4 undecided" in of_counts.headline()) is not trusted
        assert ("4 of 4 undecided" in of_counts.badge()[0]) is not trusted

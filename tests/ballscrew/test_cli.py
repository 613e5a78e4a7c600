"""The command as a person uses it: files, exit codes, one clear line for what makes no sense."""

import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import ballscrew
from ballscrew.cli import main
from ballscrew.solver.core import SUFFIX

RUN = ["run", "--controller", "pid", "--stop", "0.2"]
MONOLITHIC = [*RUN, "--coupling", "monolithic", "--out", "OUT"]


def command(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "ballscrew", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd or tempfile.gettempdir(),  # the installed package, not this checkout
    )


@pytest.mark.usefixtures("drawn")
def test_run_writes_what_it_promises(tmp_path, capsys):
    arguments = ["run", "--controller", "iol", "--stop", "2", "--svg", "--out", str(tmp_path)]
    assert main(arguments) == 0
    with open(tmp_path / "trajectory.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0][:6] == ["time", "x", "v", "z", "i", "u"]
    assert [float(v) for v in rows[1][:3]] == [0.0, 0.0, 0.0]
    assert len(rows) == 2002
    assert rows[-1][0] == "2.0"
    figures = json.loads((tmp_path / "metrics.json").read_text())
    promised = "peak_voltage peak_voltage_time settling_time_2pct overshoot steady_state_error iae"
    promised += " coupling_residual_max macro_steps coupling verdict"
    assert set(promised.split()) <= set(figures)
    assert figures["peak_voltage"] == pytest.approx(32.1, abs=0.05)
    assert figures["peak_voltage_time"] == pytest.approx(0.336, abs=2e-3)
    assert figures["settling_time_2pct"] == pytest.approx(1.2873, abs=1e-3)
    assert figures["verdict"] == "trusted"
    for stem in ("position", "voltage", "states", "phase"):
        assert (tmp_path / f"{stem}.png").read_bytes()[:4] == b"\x89PNG"
        assert "<svg" in (tmp_path / f"{stem}.svg").read_text()
    printed = capsys.readouterr().out
    assert "peak voltage" in printed
    assert "trusted" in printed


def test_a_result_not_trusted_has_exit_code_one_and_says_what_to_change(tmp_path, capsys):
    arguments = ["run", "--controller", "iol", "--stop", "0.3", "--step", "1e-4"]
    arguments += ["--coupling", "gauss-seidel", "--out", str(tmp_path)]
    assert main(arguments) == 1
    heard = capsys.readouterr().err
    assert "not converged" in heard
    assert "--coupling interface-jacobian" in heard
    assert json.loads((tmp_path / "metrics.json").read_text())["verdict"] == "not converged"


@pytest.mark.usefixtures("drawn")
def test_swap_writes_a_comparison(tmp_path, capsys, fmus):
    code = main(
        ["swap", "--controllers", "iol", str(fmus["pid"]), "--stop", "1", "--out", str(tmp_path)]
    )
    assert code == 0
    with open(tmp_path / "comparison.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [r["controller"] for r in rows] == ["iol", fmus["pid"].stem]
    assert len(json.loads((tmp_path / "comparison.json").read_text())) == 2
    assert (tmp_path / "comparison.png").stat().st_size > 10_000
    assert not (tmp_path / "comparison.svg").exists()  # not asked for
    for name in ("iol", fmus["pid"].stem):
        with open(tmp_path / f"trajectory_{name}.csv", encoding="utf-8", newline="") as stream:
            rows = list(csv.reader(stream))
        assert rows[0][:6] == ["time", "x", "v", "z", "i", "u"]
        assert len(rows) == 1002
    assert "peak [V]" in capsys.readouterr().out


ON_A_SHAFT = """
from ballscrew import Component, Input, Output, State, symbol

x, v, u = map(symbol, ("x", "v", "u"))

def shaft():
    return Component(
        "shaft", "A shaft that a torque turns",
        inputs=(Input("u", "N*m", "torque", law=("x", "v")),),
        states=(State("x", "rad", "angle", v), State("v", "rad/s", "speed", u)),
        outputs=(Output("x", "rad", "angle", x), Output("v", "rad/s", "speed", v)),
    )

def law():
    return Component(
        "law", "PD",
        inputs=(Input("x", "rad", "angle", role="measurement"),
                Input("v", "rad/s", "speed", role="measurement"),
                Input("x_d", "rad", "desired angle", role="reference")),
        outputs=(Output("u", "N*m", "torque", symbol("x_d") - x - v),),
    )
"""


def test_figures_have_the_units_of_the_plant(tmp_path, capsys):
    file = tmp_path / "mine.py"
    file.write_text(ON_A_SHAFT, encoding="utf-8")
    loop = ["--plant", f"{file}:shaft", "--setpoint", "0.5", "--stop", "0.1"]
    assert main(["run", "--controller", f"{file}:law", *loop, "--out", str(tmp_path / "run")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "peak command 0.5 N*m" in printed
    assert "steady-state error 0.49" in printed
    assert "rad*s coupling residual" in printed
    assert (
        main(["swap", "--controllers", f"{file}:law", *loop, "--out", str(tmp_path / "swap")]) == 0
    )
    assert "peak [N*m]" in capsys.readouterr().out
    made = ballscrew.run(f"{file}:law", f"{file}:shaft", 0.5, stop=0.1)
    assert dict(made.facts())["peak voltage"] == "0.5 N*m"


def test_export_only_writes_what_is_named(tmp_path):
    assert main(["export", "--out", str(tmp_path), "--only", "plant", "nctf"]) == 0
    assert sorted(p.name for p in tmp_path.glob("*.fmu")) == ["nctf.fmu", "plant.fmu"]


def test_json_output_is_one_object(tmp_path, capsys):
    assert main([*RUN, "--json", "--out", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out)["controller"] == "pid"


def test_set_and_limits_reach_the_run(tmp_path, capsys):
    arguments = ["--set", "plant.m=2", "--set", "controller.Kp=100", "--limit-voltage", "5"]
    arguments += ["--setpoint", "-0.02", "--json", "--out", str(tmp_path)]
    assert main([*RUN, *arguments]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["peak_voltage"] < 3.0  # Kp e = 2 V


def test_monolithic_and_tangent_agree(tmp_path, capsys):
    peaks = []
    for coupling in ("monolithic", "tangent"):
        assert main([*RUN, "--coupling", coupling, "--json", "--out", str(tmp_path)]) == 0
        peaks.append(json.loads(capsys.readouterr().out)["iae"])
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-6)


def test_help_names_every_command_and_gives_examples():
    done = command("--help")
    assert done.returncode == 0
    for word in ("export", "run", "swap", "examples:"):
        assert word in done.stdout
    assert "--set" in command("run", "--help").stdout


def test_help_and_version_load_none_of_the_heavy_libraries():
    code = (
        "import sys\nfrom ballscrew.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'sympy', 'fmpy', 'matplotlib', 'scipy'} & set(sys.modules)\n"
        "print(heavy, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tempfile.gettempdir()
    )
    assert done.stderr.strip() == "set()"
    assert command("--version").stdout.startswith("ballscrew ")


def test_a_run_of_what_is_derived_already_loads_no_sympy(tmp_path, fmus):
    del fmus  # derived
    code = (
        "import sys\nfrom ballscrew.cli import main\n"
        "main('run --controller pid --stop 0.01 --step 1e-3 --out'.split() + sys.argv[1:])\n"
        "print('sympy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),
    )
    assert done.stdout.splitlines()[-1] == "False"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "--controller", "iol"], "required: --out"),
        (["run", "--controller", "ioll", "--out", "OUT"], "did you mean iol?"),
        (["run", "--controller", "none.fmu", "--out", "OUT"], "none.fmu: no such file"),
        ([*RUN, "--out", "OUT", "--plant", "none.fmu"], "none.fmu: no such file"),
        ([*RUN, "--out", "OUT", "--step", "0"], "--step is 0 s, expected more than 0"),
        ([*RUN, "--out", "OUT", "--step", "nan"], "expected a finite number"),
        ([*RUN, "--out", "OUT", "--stop", "-1"], "--stop is -1 s, expected more than 0"),
        ([*RUN, "--out", "OUT", "--stop", "1e12"], "use a larger one"),
        ([*RUN, "--out", "OUT", "--coupling", "magic"], "expected one of jacobi, gauss-seidel"),
        ([*RUN, "--out", "OUT", "--corrections", "7"], "expected 0 or 1"),
        ([*RUN, "--out", "OUT", "--set", "plant.m"], "is not of the form SIDE.NAME=VALUE"),
        ([*RUN, "--out", "OUT", "--set", "m=1"], "expected plant.NAME=VALUE"),
        ([*RUN, "--out", "OUT", "--set", "plant.m=heavy"], "expected a number"),
        ([*RUN, "--out", "OUT", "--set", "plant.m=inf"], "expected a finite number"),
        ([*RUN, "--out", "OUT", "--set", "plant.mass=1"], "plant has no parameter 'mass'"),
        ([*RUN, "--out", "OUT", "--set", "plant.m=-1"], "m = -1 kg is out of its range"),
        ([*MONOLITHIC, "--set", "plant.Fc=-1"], "plant: parameter Fc = -1 is out of its range"),
        ([*MONOLITHIC, "--set", "plant.mass=1"], "plant has no parameter 'mass'"),
        ([*MONOLITHIC, "--set", "plant.solver_tolerance=1e-6"], "plant has no parameter"),
        ([*RUN, "--out", "OUT", "--map", "a"], "is not of the form THEIRS=OURS"),
        ([*RUN, "--out", "OUT", "--map", "a=b"], "neither side has a port 'a'"),
        ([*RUN, "--out", "OUT", "--limit-voltage", "0"], "expected more than 0"),
        ([*RUN, "--out", "OUT", "--reference", "none.csv"], "none.csv: there is no such file"),
        ([*RUN, "--out", "OUT", "--setpoint", "far"], "expected a number"),
        ([*RUN, "--out", __file__], "is a file, expected a folder"),
        ([*RUN, "--out", "/proc/nowhere/at/all"], "cannot be made"),
        ([*RUN, "--out", "OUT", "--time-limit", "0"], "--time-limit is 0 s, expected more than 0"),
        (["run", "--controller", str(Path(__file__).parent), "--out", "OUT"], "is a folder"),
        (
            ["export", "--out", "OUT", "--only", "plnt"],
            "'plnt' is neither one of plant,",
        ),
        (["swap", "--out", "OUT", "--controllers", "iol", "x"], "'x' is neither one of"),
        (["fly"], "invalid choice"),
        ([], "required: COMMAND"),
    ],
)
def test_what_makes_no_sense_gets_one_clear_line_and_exit_code_two(
    tmp_path, capsys, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    heard = capsys.readouterr()
    assert message in heard.err
    assert heard.err.count("\n") == 1
    assert "Traceback" not in heard.err


BOMB = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
FOREIGN = b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'


def without_binaries(name, data):
    return None if name.startswith("binaries/linux64") else data


def garbage_for_binaries(name, data):
    return b"no library" if name.startswith("binaries/linux64") else data


def in_description(old, new):
    def change(name, data):
        return data.replace(old, new) if name == "modelDescription.xml" else data

    return change


def too_large(name, data):
    return data + b" " * (257 << 20) if name == "modelDescription.xml" else data


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (b"hello", "is not a zip file"),
        (b"", "is not a zip file"),
        (lambda name, data: None, "is an empty zip file"),
        ("../../evil.py", "'../../evil.py', which is outside its folder"),
        ("/tmp/evil.py", "'/tmp/evil.py', which is outside its folder"),
        ("..\\evil.py", "which is outside its folder"),
        (
            without_binaries,
            "no binary for this platform, expected binaries/linux64/pid.so; it has "
            "binaries for win64",
        ),
        (garbage_for_binaries, "cannot be instantiated"),
        (in_description(b' fmiVersion="2.0"', b""), "is FMI of no version"),
        (in_description(b'fmiVersion="2.0"', b'fmiVersion="1.0"'), "is FMI 1.0, expected FMI 2.0"),
        (in_description(b'fmiVersion="2.0"', b'fmiVersion="9.0"'), "is FMI 9.0, expected FMI 2.0"),
        (in_description(b"</ModelVariables>", b""), "modelDescription.xml cannot be read"),
        (in_description(b"CoSimulation", b"Cosimulation"), "expected co-simulation"),
        (in_description(b"<fmiModel", BOMB + b"<fmiModel"), "declares a document type"),
        (in_description(b"<fmiModel", FOREIGN + b"<fmiModel"), "declares a document type"),
        (too_large, "expected at most 256"),
        (in_description(b'Identifier="pid"', b'Identifier="../pid"'), "expected a name in C"),
    ],
)
def test_files_that_are_no_fmu_are_refused_in_one_line(tmp_path, capsys, fmus, change, message):
    import zipfile

    path = tmp_path / "bad.fmu"
    if isinstance(change, bytes):
        path.write_bytes(change)
    else:
        with (
            zipfile.ZipFile(fmus["pid"]) as good,
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bad,
        ):
            if isinstance(change, str):
                bad.writestr(change, "")
            for name in good.namelist():
                data = good.read(name) if isinstance(change, str) else change(name, good.read(name))
                if data is not None:
                    bad.writestr(name, data)
    out = tmp_path / "out"
    assert main(["run", "--controller", str(path), "--out", str(out)]) == 2
    heard = capsys.readouterr().err
    assert f"{path}: " in heard
    assert message in heard
    assert heard.count("\n") == 1
    assert not (tmp_path.parent / "evil.py").exists()


def test_existing_results_stay_whole_when_a_request_is_refused(tmp_path):
    assert main([*RUN, "--out", str(tmp_path)]) == 0
    before = {p.name: p.read_bytes() for p in tmp_path.glob("[!.]*")}
    assert main([*RUN, "--out", str(tmp_path), "--set", "plant.Fc=-1"]) == 2
    assert {p.name: p.read_bytes() for p in tmp_path.glob("[!.]*")} == before


def test_a_result_that_cannot_be_written_is_one_line_and_leaves_the_rest_whole(tmp_path, capsys):
    (tmp_path / ".ballscrew").write_text("no folder")
    assert main([*RUN, "--out", str(tmp_path)]) == 2
    heard = capsys.readouterr().err
    assert "cannot write" in heard
    assert ".ballscrew" in heard
    assert heard.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == [".ballscrew"]


def test_a_folder_is_used_again_and_holds_one_run_and_the_users_files(tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*RUN, "--out", str(out)]) == 0
    assert (out / "phase.png").is_file()
    (out / "notes.txt").write_text("mine")
    (out / "comparison.csv").write_text("mine, too")
    capsys.readouterr()
    swap = ["swap", "--controllers", "iol", "--stop", "0.1", "--step", "1e-4"]
    assert main([*swap, "--out", str(out)]) == 0
    names = {p.name for p in out.glob("[!.]*")}
    assert names >= {"notes.txt", "comparison.csv.kept", "comparison.csv", "comparison.png"}
    assert not names & {"trajectory.csv", "metrics.json", "phase.png", "phase.svg"}
    assert (out / "comparison.csv.kept").read_text() == "mine, too"
    (note,) = [n for n in capsys.readouterr().err.splitlines() if "kept" in n]
    assert note.startswith("note: comparison.csv in ")


def test_what_is_read_is_not_removed_as_an_earlier_result(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["rig", "2.4/1", "--law", "lugre", "--out", str(out)]) == 0
    before = {p.name: p.read_bytes() for p in out.glob("[!.]*")}
    for data in (out, out / "record.csv"):
        assert main(["identify", str(data), "--law", "lugre", "--out", str(out)]) == 2
        assert "choose another folder" in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in out.glob("[!.]*")} == before


@pytest.mark.parametrize("coupling", ["tangent", "monolithic"])
def test_a_run_that_runs_away_stops_says_when_and_where_and_keeps_what_it_had(
    tmp_path, capsys, coupling
):
    """The linearizing controller with a friction stiffness that is ten per cent wrong."""
    arguments = ["run", "--controller", "iol", "--set", "plant.sigma0=6e4", "--stop", "0.5"]
    more = ["--coupling", coupling, "--step", "1e-4", "--out", str(tmp_path)]
    assert main([*arguments, *more]) == 1
    line = capsys.readouterr().err.splitlines()[0]
    assert "at t = 0.0" in line
    assert "diverges" in line or "not finite" in line
    rows = (tmp_path / "trajectory.csv").read_text().splitlines()
    assert len(rows) > 100
    assert float(rows[-1].split(",")[0]) < 0.1


def test_a_users_own_plant_py_is_never_met(tmp_path):
    for name in ("plant.py", "controllers.py", "solver.py", "fmus.py"):
        (tmp_path / name).write_text("raise ImportError('a file of the user was imported')\n")
    done = command(*RUN, "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "trajectory.csv").exists()


def test_the_wheel_holds_every_module(tmp_path):
    import zipfile

    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path), str(root)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {n for n in archive.namelist() if n.startswith("ballscrew/")}
    expected = {"ballscrew/py.typed"}
    for name in ("report.html.jinja", "sets.json"):
        expected.add(f"ballscrew/diagnosis/{name}")
    for name in (
        "orchestration/page.html.jinja",
        "orchestration/page_parts.jinja",
        "orchestration/study/report.html.jinja",
        "results/report.html.jinja",
    ):
        expected.add(f"ballscrew/{name}")
    expected |= {f"ballscrew/{p.relative_to(root)}" for p in root.glob("gallery/*/page.md")}
    for name in ("controller", "test_controller"):
        expected.add(f"ballscrew/templates/{name}.py.jinja")
    parts = {p.parent.name for p in root.glob("*/__init__.py")} - {"ballscrew", "tests", "proofs"}
    for part in parts:
        expected |= {f"ballscrew/{p.relative_to(root)}" for p in (root / part).rglob("*.py")}
    for part in ("fmus/native", "solver", "orchestration", "identification"):
        sources = [p for p in (root / part / "c").iterdir() if p.suffix in (".c", ".h")]
        expected |= {f"ballscrew/{p.relative_to(root)}" for p in sources}
    for library in (
        "solver/c/libcore",
        "orchestration/c/libmaster",
        "identification/c/libidentification",
    ):
        expected.add(f"ballscrew/{library}{SUFFIX}")
    assert "-py3-none-" in wheel.name  # for every Python on this platform
    expected |= {str(p.relative_to(root)) for p in (root / "ballscrew").rglob("*.py")}
    assert held == expected

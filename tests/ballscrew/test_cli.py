"""The command as a person uses it: its files, its units, its folder, and exit codes."""

import csv
import inspect
import json
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from any_fmu import repacked

import ballscrew
from ballscrew.cli import command_parser, main

RUN = ["run", "--controller", "pid", "--stop", "0.2"]


def python(*arguments):
    """The installed package, not this checkout, in a process of its own."""
    words = [sys.executable, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, cwd=tempfile.gettempdir())


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
    assert figures["peak_voltage"] == pytest.approx(32.1, abs=0.05)
    assert figures["peak_voltage_time"] == pytest.approx(0.336, abs=2e-3)
    assert figures["settling_time_2pct"] == pytest.approx(1.2873, abs=1e-3)
    assert figures["verdict"] == "trusted"
    for stem in ("signals", "phase"):
        assert (tmp_path / f"{stem}.png").read_bytes()[:4] == b"\x89PNG"
        assert "<svg" in (tmp_path / f"{stem}.svg").read_text()
    assert "peak voltage          32.1" in capsys.readouterr().out


def test_a_result_not_trusted_has_exit_code_one_and_says_what_to_change(tmp_path, capsys):
    arguments = ["run", "--controller", "iol", "--stop", "0.3", "--step", "1e-4"]
    arguments += ["--coupling", "gauss-seidel", "--out", str(tmp_path)]
    assert main(arguments) == 1
    heard = capsys.readouterr().err
    assert "not converged" in heard
    assert (
        "use shorter communication steps than 0.0001 s, or the coupling interface-jacobian" in heard
    )
    assert json.loads((tmp_path / "metrics.json").read_text())["verdict"] == "not converged"


@pytest.mark.usefixtures("drawn")
def test_swap_writes_a_comparison(tmp_path, capsys, fmus):
    names = ["iol", fmus["pid"].stem]
    words = ["swap", "--controllers", "iol", str(fmus["pid"]), "--stop", "1"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    rows = (tmp_path / "comparison.csv").read_text(encoding="utf-8").splitlines()
    assert [row.split(",")[0] for row in rows] == ["controller", *names]
    assert len(json.loads((tmp_path / "comparison.json").read_text())) == 2
    assert (tmp_path / "comparison.png").stat().st_size > 10_000
    assert not (tmp_path / "comparison.svg").exists()  # not asked for
    for name in names:
        rows = (tmp_path / f"trajectory_{name}.csv").read_text(encoding="utf-8").splitlines()
        assert rows[0].startswith("time,x,v,z,i,u,")
        assert len(rows) == 1002
    assert "peak [V]" in capsys.readouterr().out


@pytest.mark.ci
def test_numbers_beyond_all_bounds_are_told_in_words_alone(tmp_path):
    words = "run --controller pid --coupling monolithic --stop 0.05 --set plant.x_start=1e308"
    done = python("-m", "ballscrew", *words.split(), "--out", tmp_path)
    assert done.returncode == 1
    assert "exceeds its bound" in done.stderr
    assert not [w for w in ("Warning", "nan", ".py") if w in done.stdout + done.stderr]


def test_set_and_limits_reach_the_run(tmp_path, capsys):
    arguments = ["--set", "plant.m=2", "--set", "controller.Kp=100", "--set", "controller.Ki=0"]
    arguments += ["--set", "plant.voltage_limit=1.5", "--setpoint", "-0.02", "--json"]
    arguments += ["--out", str(tmp_path)]
    assert main([*RUN, *arguments]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["controller"] == "pid"
    assert figures["peak_voltage"] == 1.5  # of Kp e = 2 V at first


def test_the_help_of_each_option_is_the_text_of_its_argument_in_python():
    commands = command_parser()._subparsers._group_actions[0].choices
    told = {name: " ".join(parser.format_help().split()) for name, parser in commands.items()}
    for name, parser in commands.items():
        assert [a.dest for a in parser._actions if not a.help] == ["kind"] * (name == "new"), name
    for command, function, argument in (
        ("run", ballscrew.Loop, "stop"),
        ("lyapunov", ballscrew.lyapunov, "tolerance"),
        ("identify", ballscrew.read_force_records, "lead"),
    ):
        text = inspect.getdoc(function).partition(f"\n{argument} : ")[2].partition("\n")[2]
        assert text.partition("\n")[0].strip().replace("`", "") in told[command]


def test_help_and_version_load_none_of_the_heavy_libraries():
    code = (
        "import sys\nfrom ballscrew.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'sympy', 'fmpy', 'matplotlib', 'scipy'} & set(sys.modules)\n"
        "print(heavy, file=sys.stderr)"
    )
    assert python("-c", code).stderr.strip() == "set()"
    assert python("-m", "ballscrew", "--version").stdout.startswith("ballscrew ")


@pytest.mark.ci
def test_a_run_of_what_is_derived_already_loads_no_sympy(tmp_path, fmus):
    del fmus  # derived
    code = (
        "import sys\nfrom ballscrew.cli import main\n"
        "main('run --controller pid --stop 0.01 --step 1e-3 --out'.split() + sys.argv[1:])\n"
        "print('sympy' in sys.modules)"
    )
    assert python("-c", code, tmp_path).stdout.splitlines()[-1] == "False"


BOMB = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
FOREIGN = b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'


def instead_of_binaries(other):
    return lambda name, data: other if name.startswith("binaries/linux64") else data


def in_description(old, new):
    return lambda name, data: data.replace(old, new) if name == "modelDescription.xml" else data


BROKEN = [
    (b"hello", "is not a zip file"),
    ("../../evil.py", "'../../evil.py', which is outside its folder"),
    (instead_of_binaries(None), "expected binaries/linux64/pid.so; it has binaries for win64"),
    (in_description(b"<fmiModel", BOMB + b"<fmiModel"), "declares a document type"),
]
MORE_BROKEN = [
    ("/tmp/evil.py", "'/tmp/evil.py', which is outside its folder"),
    ("..\\evil.py", "which is outside its folder"),
    (instead_of_binaries(b"no library"), "cannot be instantiated"),
    (in_description(b' fmiVersion="2.0"', b""), "is FMI of no version"),
    (in_description(b'fmiVersion="2.0"', b'fmiVersion="1.0"'), "is FMI 1.0, expected FMI 2.0"),
    (in_description(b"</ModelVariables>", b""), "modelDescription.xml cannot be read"),
    (in_description(b"CoSimulation", b"Cosimulation"), "expected co-simulation"),
    (in_description(b"<fmiModel", FOREIGN + b"<fmiModel"), "declares a document type"),
    (in_description(b"<fmiModel", b" " * (257 << 20) + b"<fmiModel"), "expected at most 256"),
    (in_description(b'Identifier="pid"', b'Identifier="../pid"'), "expected a name in C"),
]


@pytest.mark.parametrize(
    ("change", "message"), [*BROKEN, *(pytest.param(*b, marks=pytest.mark.ci) for b in MORE_BROKEN)]
)
def test_files_that_are_no_fmu_are_refused_in_one_line(tmp_path, capsys, fmus, change, message):
    path = tmp_path / "bad.fmu"
    if isinstance(change, bytes):
        path.write_bytes(change)
    elif isinstance(change, str):
        shutil.copy(fmus["pid"], path)
        with zipfile.ZipFile(path, "a") as bad:
            bad.writestr(change, "")
    else:
        repacked(fmus["pid"], path, change)
    assert main(["run", "--controller", str(path), "--out", str(tmp_path / "out")]) == 2
    heard = capsys.readouterr().err
    assert f"{path}: " in heard
    assert message in heard
    assert heard.count("\n") == 1
    assert not (tmp_path.parent / "evil.py").exists()


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


@pytest.mark.parametrize(
    "coupling", ["interface-jacobian", pytest.param("monolithic", marks=pytest.mark.ci)]
)
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


@pytest.mark.ci
def test_a_reference_is_a_number_or_a_table_of_any_format(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("excel.csv").write_text("time,x_d\n0,-0.01\n1,-0.01\n", encoding="utf-8-sig")
    np.savez("there.npz", time=[0.0, 1.0], x_d=[-0.01, -0.01])
    given = (["--setpoint", "-1e-2"], ["--reference", "excel.csv"], ["--reference", "there.npz"])
    courses = []
    for words in given:
        assert main([*RUN, *words, "--out", "out"]) == 0
        courses.append(Path("out/trajectory.csv").read_bytes())
    assert courses[0] == courses[1] == courses[2]
    assert json.loads(Path("out/metrics.json").read_bytes())["steady_state_error"] < 0

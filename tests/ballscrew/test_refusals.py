"""What makes no sense gets one clear line and exit code 2, and no file is written.

One table for all commands. What a command cannot reach is with its module.
"""

from __future__ import annotations

import shlex
import shutil

import numpy as np
import pytest

from ballscrew.cli import main

RUN = "run --controller pid --stop 0.1"
WHOLE = f"{RUN} --coupling monolithic"
SWAP = "swap --stop 0.02 --controllers"
TUNE = "tune --controller p_pi"
HEAVY = f"{TUNE} --params heavy.toml"
PID = "lyapunov --controller pid"
OVER = f"{PID} --via fmu"
X = "map --controller iol --x sigma0_hat=66966:66968:2"
MAP = f"{X} --y sigma1_hat=340:350:2"
LONG = "a" * 256

SHOWN = [
    ("fly", "invalid choice"),
    ("run --controller ioll", "did you mean iol?"),
    ("run --controller none.fmu", "none.fmu: no such file"),
    ("run --controller mine.py:mak", "controller: mine.py has no function 'mak'"),
    ("run --controller mine.py:deaf", "nothing is connected to the input 'u' of plant"),
    ("run --controller pid+camera", "no instrument 'camera'; there are position_encoder, "),
    (f"{RUN} --step 0", "step is 0 s, expected more than 0"),
    (f"{RUN} --setpoint -inf", "setpoint is -inf, expected a finite number"),
    (f"{RUN} --coupling magic", "coupling is 'magic', expected one of jacobi, gauss-seidel"),
    (f"{RUN} --set plant.mass=1", "plant has no parameter 'mass'; it has "),
    (f"{RUN} --set plant.m=-1", "plant: parameter m = -1 kg is out of its range [1e-06, inf]"),
    (f"{WHOLE} --set plant.Fc=-1", "plant: parameter Fc = -1 N is out of its range"),
    (f"{RUN} --set plant.m=1 --set plant.m=2", "plant.m is given as 1 and as 2"),
    (f"{RUN} --map a=b", "mapping: neither side has a port 'a'"),
    (f"{RUN} --reference none.csv", "none.csv: there is no such file"),
    (f"{RUN} --reference mvoe:speed=1", "did you mean move"),
    (f"{RUN} --reference move:speed=1e-300", "its times or places are beyond all numbers"),
    (f"{RUN} --sampled 1e308", "sampled is 1e+308 s, expected at most stop"),
    (f"{RUN} --params sigma.toml", "[plant] there is no 'sigma', did you mean sigma"),
    (f"{RUN} --params grams.toml", "[plant] m has the unit 'g', expected 'kg'"),
    (f"{RUN} --out record.csv", "--out record.csv is a file, expected a folder"),
    (f"{SWAP} pid pid", "controllers has pid twice"),
    ("tune --controller none", "controllers with gains are iol"),
    (f"{HEAVY} --limit 0", "limit is 0, expected more than 0"),
    (f"{PID} --budget 0", "budget is 0 s"),
    ("lyapunov --controller mine.fmu", "lyapunov runs it with a communication step (--via fmu)"),
    (f"{X} --y sigma0_hat=1:2:3", "--x and --y are both sigma0_hat"),
    (f"{X} --y sigma1_hat", "NAME=LOW:HIGH:COUNT"),
    (f"{MAP} --resume", "contains no map to continue"),
    ("export --only plnt", "component 'plnt' is neither one of plant,"),
    ("export --only pid --fmi 3", "fmi and platforms are for native FMUs"),
    ("export --loop iol --ssp", "--loop and --ssp: expected one of them"),
    ("study none.toml", "none.toml: cannot be read"),
    ("new controller class", "expected an identifier"),
    ("new controller pid", "which is already the name of a part"),
    ("identify none.csv --law dahl", "none.csv: there is no such file"),
    ("identify record.csv --law lugree", "did you mean lugre"),
    ("compare record.csv", "the following arguments are required: --params"),
]
MORE = [
    # parts
    ("run --controller folder", "folder: is a folder"),
    ("run --controller position_encoder", "'position_encoder' is neither one of iol, "),
    ("run --controller mine.py", "give the function that makes the component"),
    ("run --controller mine.py:odd", "'volt' is not known"),
    ("run --controller iol --params force.toml", "made for the voltage of a motor"),
    # numbers
    (f"{RUN} --stop 1e12", "use a larger one"),
    # values
    # what does not go together
    (f"{WHOLE} --isolate", "--isolate is for FMUs"),
    (f"{RUN} --no-isolate --time-limit 5", "--time-limit is for FMUs in their own process"),
    # set-points and folders
    (f"{RUN} --reference long.csv", "values that are not finite"),
    (f"{RUN} --reference twice.csv", "has the columns time, x_d #1, x_d #2, expected"),
    (f"{RUN} --out /proc/nowhere/at/all", "cannot be made"),
    (f"{RUN} --out {LONG}", "cannot be made: File name too long"),
    (f"{RUN} --out ''", "--out: is empty; expected a folder"),
    # comparisons of controllers
    (f"{SWAP} mine.py:make ./mine.py:make", "./mine.py:make are both called pid_a; rename one"),
    (f"{SWAP} pid --sampled 1e-3 --set pid.sample_time=2e-3", "expected one of them"),
    (f"{SWAP} pid_sampled+position_encoder --noise", "already has instruments; expected pid_samp"),
    (f"{SWAP} hand.fmu --noise", "hand.fmu is an FMU without equations"),
    (f"{SWAP} mine.py:blind --noise", "blind measures nothing, but the instruments measure x_m"),
    (f"{SWAP} pid+position_encoder+sampled", "no instrument 'sampled'; there are position_encoder"),
    # tuning
    (HEAVY, "drive_lugre has no limit of its command; give one"),
    ("run --system s.ssp --plant p.fmu", "plant cannot be used with --system"),
    (f"{HEAVY} --limit 90", "the limit of the command is 90, but friction alone needs 80"),
    (f"{TUNE} --stop 1", "give reference as well"),
    (f"{TUNE} --reference step:length=1", "step has no 'length'; it has size, at"),
    ("tune --controller lqi --params heavy.toml --limit 500", "no output 'i', lqi measures it"),
    # exponents and maps
    (f"{PID} --stop 1e-320", "at least 1e-09"),
    ("lyapunov --controller iol --plant plant_classical", "no output 'z'"),
    (f"{OVER} --tolerance 1e-8", "--tolerance is for --via model"),
    ("lyapunov --controller pid_sampled --via fmu", "pid_sampled is sampled, and FMUs of sampled"),
    ("lyapunov --controller pid_sampled.fmu --via fmu", "a controller with direct feedthrough"),
    (f"{X} --y setpoint=0:1:3 --setpoint -1e-2", "an axis of set-points"),
    (f"{MAP} --set controller.sigma0_hat=3", "sigma0_hat is given as a value and as an axis"),
    ("map --controller my.fmu --x Kp=1:2:2 --y Ki=1:2:2", "an FMU has no equations"),
    (f"{MAP} --dask foo", "no Dask scheduler responds at foo: missing port"),
    (f"{MAP} --dask tcp://127.0.0.1:1", "Connection refused"),
    ("map --controller mine.py:make --x Kq=1:2:2 --y Ki=1:2:2", "neither pid_a nor plant has 'Kq'"),
    # exports
    ("export --only pid --tangents 3", "--tangents is for --variational"),
    ("export --variational --only iol --tangents 0", "tangents is '0'"),
    ("export --variational --only pid_sampled", "pid_sampled has discrete states"),
    ("export --native --only pid --platforms linux64,amiga", "no platform 'amiga'; there are"),
    ("export --native --only plant_classical --variational", "plant_classical has modes"),
    ("export --modelica --native", "--modelica and --native: expected one of them"),
    ("export --loop mine.py:deaf", "deaf has no output 'u', plant needs it"),
    (
        "export --loop pid --plant mine.py:make",
        "pid_a has no output 'x', pid measures it; it has u",
    ),
    ("export --ssp --only pid+position_encoder --params behind.toml", "are separate parts"),
    ("export --component pid --plant mine.py:body", "--plant is for --loop or --ssp"),
    ("export --ssp --component pid --plant mine.py:make", "its inputs do not fit the outputs of"),
    # the rig and the gallery
    ("rig --list", "--list and --out: expected one of them"),
    ("rig 2.4/7 --seed 1.5", "seed is '1.5', expected a whole number from 0 on"),
    ("gallery", "give its NAME"),
    ("new controller json", "which is a module of this Python"),
    # records and parameter files
    ("identify long.csv --law dahl", "no column 'force'"),
    ("identify folder --law dahl", "with a finite `plant.m` above 0 kg"),
    ("diagnose loop", "symbolic links"),
    ("diagnose record.csv --params deep.toml", "nested too deeply"),
    ("diagnose record.csv --params hexadecimal.toml", "m is a number beyond 1e308"),
    ("diagnose record.csv --params more_digits.toml", "is not a TOML file"),
    ("diagnose record.csv --params current.toml --unit u=N", "drive is driven by a current"),
    ("diagnose record.csv --params turns.toml --lead 5e-3", "without one; leave the lead out"),
    ("compare record.csv --params fmu.toml", "kind is 'fmu', expected one of ball_screw, drive"),
    ("compare record.csv --params screw.toml --lead 0.001", "but screw.toml has 0.005 m"),
    (f"{RUN} --params interval.toml", "with the value 1 between them"),
    (f"{RUN} --params misspelt.toml", "there is no 'uint', did you mean unit"),
    (f"{RUN} --params newer.toml", "expected 'ballscrew-parameters 1'"),
    (f"{RUN} --params thrust.toml", "expected one of voltage, current, force"),
]
DRIVE = """
kind = "drive"
law = "lugre"
plant = {m = 40.0, sigma0 = 1e7, sigma1 = 2e4, sigma2 = 200.0, Fc = 80.0, Fs = 80.0, Vs = 0.01}
"""
PARAMETERS = {
    "heavy": DRIVE,
    "force": f'command = "force"{DRIVE}',
    "current": f'command = "current"{DRIVE}',
    "thrust": f'command = "thrust"{DRIVE}',
    "turns": 'kind = "rotary_drive"\nlaw = "classical"\nplant = {J = 0.5, gain = 1.0}',
    "fmu": 'kind = "fmu"',
    "screw": "plant = {p = 200.0}",
    "sigma": "plant = {sigma = 1e5}",
    "grams": 'plant = {m = {value = 1, unit = "g"}}',
    "behind": '[controller."pid+position_encoder"]\nKp = 1.0',
    "interval": "plant = {m = {value = 1, interval = [2, 3]}}",
    "misspelt": 'plant = {m = {value = 1, uint = "kg"}}',
    "newer": 'format = "ballscrew-parameters 2"',
    "deep": f"a = {'[' * 5000}{']' * 5000}",
    "hexadecimal": f"plant = {{m = 0x{'f' * 5000}}}",
    "more_digits": f"plant = {{m = {'1' * 5000}}}",
}
PARTS = """
from dataclasses import replace
from ballscrew import Component, Input, Output, symbol
from ballscrew.controllers.pid import pid
from ballscrew.plant.axis import axis

def make():
    return replace(pid(), name="pid_a")

def body():
    return replace(axis(), name="body")

def deaf():
    made = pid()
    return replace(made, name="deaf", outputs=(replace(made.outputs[0], name="volts"),))

def odd():
    made = pid()
    return replace(made, name="odd", outputs=(replace(made.outputs[0], unit="volt"),))

def blind():
    inputs = (Input("x_d", "m", "set-point", role="reference"),)
    return Component("blind", "U", inputs=inputs, outputs=(Output("u", "V", "u", symbol("x_d")),))
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory, fmus):
    """A folder with files that are meant badly."""
    folder = tmp_path_factory.mktemp("refused")
    for name, text in PARAMETERS.items():
        (folder / f"{name}.toml").write_text(f"{text}\n")
    (folder / "mine.py").write_text(PARTS)
    shutil.copy(fmus["pid_sampled"], folder / "pid_sampled.fmu")
    (folder / "long.csv").write_text(f"time,x_d\n0,0\n1,{'1' * 131_073}\n")
    (folder / "twice.csv").write_text("time,x_d,x_d\n0,0,1\n1,1,2\n")
    (folder / "loop").symlink_to("loop")
    time = np.arange(0.0, 2.0, 2e-3)
    course = np.column_stack([time, np.sin(20.0 * time), 1e-3 * np.cos(20.0 * time)])
    for name, columns in (("record.csv", "time,u,x"), ("folder/record.csv", "time,force,x")):
        (folder / name).parent.mkdir(exist_ok=True)
        np.savetxt(folder / name, course, delimiter=",", header=columns, comments="")
    (folder / "folder" / "trial.json").write_text(f'{{"parameters": {{"plant.m": {"1" * 400}}}}}')
    return folder


def files(folder):
    return sorted(p for p in folder.rglob("*") if not p.is_dir())


@pytest.mark.parametrize(
    ("words", "line"), [*SHOWN, *(pytest.param(*row, marks=pytest.mark.ci) for row in MORE)]
)
def test_one_line_and_exit_code_two_and_no_file(made, monkeypatch, capsys, words, line):
    monkeypatch.chdir(made)
    before = files(made)
    arguments = shlex.split(words)
    assert main(arguments if "--out" in arguments else [*arguments, "--out", "new"]) == 2
    printed, said = capsys.readouterr()
    assert line in said, said
    assert said.startswith("ballscrew: ")
    assert said.count("\n") == 1
    assert printed == ""
    assert files(made) == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("", "the following arguments are required: COMMAND"),
        ("run --controller pid", "the following arguments are required: --out"),
        ("rig 2.4/1", "--out DIR is missing"),
        ("rig --list 2.4/7", "--list and a TRIAL"),
    ],
)
def test_what_is_missing_is_named(words, line, capsys):
    assert main(words.split()) == 2
    assert line in capsys.readouterr().err

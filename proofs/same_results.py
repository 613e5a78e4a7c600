"""Whether two versions compute the same: parts, loops, records, diagnoses, studies, the gallery.

``python proofs/same_results.py write FILE.json`` computes with the installed package, in at most
ten minutes on two cores; ``python proofs/same_results.py compare OLD.json NEW.json`` prints the
differences, and exits with 1 if a number differs by more than 1e-12 of the largest of its column,
or is missing. Different words are printed, but do not change the exit code. A third argument is a
pattern: only items whose names contain it are written.

An item is a command of the console, or what the public functions give. Each has its processor time
in the file; times that end in "seconds" are not compared.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
import zlib
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage

import numpy as np
import pandas as pd
from pyarrow.parquet import read_table

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT / "proofs"), str(ROOT / "tests" / "support")]
ALLOWED = 1e-12
SPENT = "processor seconds"
PRACTICE = ["pid+sampled+position_encoder", "iol+sampled"]
PRACTICE += ["nctf+position_encoder+velocity_estimate+current_sensor"]
# In these, {name} is the folder of the data of this name, see `data`.
COMMANDS = """
run --controller iol --stop 0.5
run --controller pid --stop 0.3 --coupling jacobi
run --controller pid --stop 0.3 --coupling gauss-seidel
run --controller nctf --stop 0.3 --reference move:distance=0.02,speed=0.1,acceleration=1,jerk=50
swap --controllers iol nctf pid --stop 0.3
swap --controllers iol pid --sampled 1e-3 --noise --stop 0.3
lyapunov --controller iol --stop 5
lyapunov --controller nctf --stop 5
lyapunov --controller nctf --stop 2 --via fmu
lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20
map --controller iol --x sigma0_hat=66965.89:66969.24:3 --y sigma1_hat=339.56:367.56:3 --workers 1
rig 2.4/7
identify {rig} --law modified_lugre
identify {rig} --law classical
identify {rig} --law dahl
identify {force} --law classical --mass fit --offset --unit x=m --unit force=N
identify {force} --law lugre --mass 5 --unit x=m --unit force=N
identify {noise} --response --unit x=m --unit force=N
tune --controller p_pi --budget 20 --reference step:size=5e-3 --stop 0.3
tune --controller pid --budget 20 --seed 2 --limit 24
tune --controller p_pi --plant plant_dahl --budget 20
tune --controller pid_dob --budget 12 --reference sine:amplitude=5e-3,frequency=1 --stop 1
tune --controller lqi --budget 12 --set plant.m=2
tune --controller nctf --budget 12
"""
# The first is without an effect; `diagnose` and `compare` read each.
WORLDS = {
    "fast_screw": "",
    "heavy_screw": "load_bias",
    "linear_drive": "unmodelled_inertia",
    "industrial": "input_delay",
    "simulated": "direction_asymmetry",
    "wrong_scales": "scale_of_u",
}
STUDIES = "nctf p_pi iol lqi pid_dob relay".split()  # beside pid, in the tests' small study
SI, MILLI = {"time": "s", "x": "m", "u": "V"}, {"units": {"time": "ms"}}
CASE_RECORDS = {  # file of a case: what the user says of it
    "angle_wraps/run.csv": {"lead": 0.001, "units": None},
    "labview_lvm/run.lvm": {"mapping": {"X_Value": "time", "Position": "x", "Voltage": "u"}},
    "mat_matrix/tofile.mat": {"mapping": {"ans.1": "time", "ans.2": "x", "ans.3": "u"}},
    "mat_matrix/scope.mat": {"mapping": {"pos": "x", "volt": "u"}},
    "mat_matrix/dspace.mat": {"mapping": {"Pos": "x", "U": "u"}},
    "record_thousands_dot/run.csv": {"units": {"x": "um"}},
    "record_unit_in_brackets_unknown/run.csv": {"units": None},
    "time_as_date/run.csv": {"units": None},
    "twincat_scope_eof/scope.csv": {"mapping": {"Axis.ActPos": "x", "Axis.Torque": "u"}} | MILLI,
}


def data(folder: Path) -> dict[str, object]:
    """Write what the commands read; the columns of the worlds' records."""
    from case_inputs import diagnose_voltage_scaled_none, heavy_friction_names_inertia
    from scipy.signal import lfilter
    from worlds import draw_case, write_case

    for make in (diagnose_voltage_scaled_none, heavy_friction_names_inertia):
        make(named(folder, make.__name__))
    console("rig 2.4/7", folder, "rig")
    t = np.arange(8000) * 1e-3
    x = 0.03 * np.sin(3 * t) + 0.01 * np.sin(8 * t)
    v, a = np.gradient(x, 1e-3), np.gradient(np.gradient(x, 1e-3), 1e-3)
    noise = 0.02 * np.random.default_rng(7).standard_normal(t.size)
    force = 5 * a + 40 * v + 8 * np.sign(v) + noise
    write_csv(named(folder, "force") / "record.csv", time=t, x=x.round(7), force=force)
    pushed, noise = np.random.default_rng(8).standard_normal((2, t.size))
    moved = lfilter([0, 1e-5], [1, -1.99, 0.9901], pushed) + 1e-7 * noise
    write_csv(named(folder, "noise") / "record.csv", time=t, x=moved, force=20 * pushed)
    found: dict[str, object] = {}
    for world, effects in WORLDS.items():
        case = draw_case(world, tuple(effects.split()), 1)
        write_case(case, named(folder, world))
        found |= leaves([{n: c.tolist() for n, c in r.items()} for r in case.records], world)
    study = (ROOT / "tests" / "data" / "small_study.toml").read_text("utf-8")
    for name in STUDIES:
        path = named(folder, "studies") / f"{name}.toml"
        path.write_text(study.replace("nctf", name), "utf-8")
    return found


def named(folder: Path, name: str) -> Path:
    (folder / name).mkdir(exist_ok=True)
    return folder / name


def write_csv(path: Path, **columns: np.ndarray) -> None:
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.12g")


def write_formats(folder: Path) -> list[Path]:
    import h5py
    from asammdf import MDF, Signal
    from nptdms import ChannelObject, TdmsWriter
    from scipy.io import savemat

    t = np.arange(1500) * 1e-3
    columns = {"time": t, "x": 0.03 * np.sin(12 * t), "u": 4 * np.cos(12 * t)}
    frame = pd.DataFrame(columns)
    write_csv(folder / "a.csv", **columns)
    for packer in ("gz", "bz2", "xz", "zip"):
        frame.to_csv(folder / f"a.csv.{packer}", index=False)
    frame.to_parquet(folder / "a.parquet")
    frame.to_feather(folder / "a.arrow")
    frame.to_excel(folder / "a.xlsx", index=False)
    np.savez(folder / "a.npz", **columns)
    np.save(folder / "a.npy", frame.to_records(index=False))
    savemat(folder / "a.mat", columns)
    with h5py.File(folder / "a.h5", "w") as file:
        file.update(columns)
    with TdmsWriter(str(folder / "a.tdms")) as writer:
        writer.write_segment([ChannelObject("rig", n, c) for n, c in columns.items()])
    with MDF() as measured:
        measured.append([Signal(columns[n], t, name=n) for n in ("x", "u")])
        measured.save(folder / "a.mf4")
    return sorted(folder.iterdir())


def records(folder: Path) -> dict[str, object]:
    import case_inputs

    from ballscrew import read_drive_records

    given = {path: {} for path in write_formats(named(folder, "formats"))}
    for file, options in CASE_RECORDS.items():
        case = file.partition("/")[0]
        if not (folder / case).exists():
            getattr(case_inputs, case)(named(folder, case))
        given[folder / file] = options
    found: dict[str, object] = {}
    for path, options in given.items():
        (record,) = read_drive_records([path], **{"units": SI} | options)
        name = f"{path.parent.name}/{path.name}"
        found |= {f"{name} {n}": s.tolist() for n, s in record.signals.items()}
        found |= {f"{name} note {k}": note for k, note in enumerate(record.notes)}
    return found


def parts(kind: str, folder: Path) -> dict[str, object]:
    """Courses of all parts of a kind, as native FMUs."""
    import ballscrew as bs

    x, v = bs.symbol("x"), bs.symbol("v")
    states = bs.State("x", "m", "position", v), bs.State("v", "m/s", "velocity")
    balance = bs.ForceBalance("v", 1, (bs.ForceTerm("spring", -100 * x, "a spring"),))
    body = bs.Component("body", "A mass", states=states, balances=(balance,))
    names = (*bs.catalogue()[kind], *PRACTICE[:2] * (kind == "controllers"))
    made = {n: bs.with_friction(body, n) if kind == "laws" else bs.component(n) for n in names}
    found: dict[str, object] = {}
    for name, component in made.items():
        path = folder / f"{name}.fmu"
        bs.export(component, path, native=True)
        course = course_of(path)
        found |= {f"{name}: {n}": course[n].tolist() for n in course.dtype.names}
    return found


def course_of(path: Path) -> np.ndarray:
    """Outputs of an FMU with drawn parameters and swinging inputs, in fmpy."""
    import fmpy

    told = fmpy.read_model_description(str(path))
    starts, swings, t = {}, {"time": np.arange(101) * 2e-3}, np.arange(101) * 2e-3
    for w in told.modelVariables:
        drawn = math.tanh(np.random.default_rng(zlib.crc32(w.name.encode())).normal())
        if w.type == "Real" and w.causality == "parameter":
            value = float(w.start) * (1 + 0.05 * drawn)
            starts[w.name] = min(max(value, float(w.min or value)), float(w.max or value))
        elif w.type == "Real" and w.causality == "input":
            swings[w.name] = float(w.nominal or 1) * np.sin((40 + 30 * drawn) * t)
    given = np.rec.fromarrays(list(swings.values()), names=list(swings))
    options = {"stop_time": t[-1], "output_interval": t[1], "start_values": starts}
    return fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", input=given, **options)


def commands() -> list[str]:
    """The commands, the slowest first."""
    from ballscrew import catalogue
    from ballscrew.gallery import SYSTEMS

    words = [f"study {{studies}}/{name}.toml --workers 1" for name in STUDIES]
    words += [f"gallery {name}" for name in SYSTEMS] + COMMANDS.strip().split("\n")
    models = [(f"{{{w}}}/record.csv", f"{{{w}}}/believed.toml") for w in WORLDS]
    voltage, heavy = "{diagnose_voltage_scaled_none}", "{heavy_friction_names_inertia}"
    models += [(f"{voltage}/run.csv", f"{voltage}/axis.toml --lead 0.001")]
    models += [(f"{heavy}/f_m25_50Hz.csv", f"{heavy}/p25.toml")]
    for law in (n for n in catalogue()["plants"] if n.startswith("drive_")):
        stop = 0.02 if "maxwell" in law else 2  # s; not so long that computing time ends it
        words.append(f"lyapunov --controller pid --plant {law} --stop {stop}")
    words += [f"{c} {r} --params {m}" for r, m in models for c in ("diagnose", "compare")]
    for controller in (*catalogue()["controllers"], *PRACTICE):
        run = f"run --controller {controller} --stop 0.3 --step 1e-3"
        words += [run, f"{run} --coupling monolithic"]
    return words


def console(words: str, scratch: Path, out: str) -> dict[str, object]:
    """What a command prints as numbers, and those in its tables."""
    command = [Path(sys.executable).with_name("ballscrew")]
    command += [*re.sub(r"\{(\w+)\}", r"data/\1", words).split(), "--out", out]
    command += [] if words.startswith("rig") else ["--json"]
    done = subprocess.run(command, cwd=scratch, capture_output=True)
    if done.returncode not in (0, 1):
        print(f"{words}: exit code {done.returncode}")
    found: dict[str, object] = {"code": done.returncode}
    with contextlib.suppress(json.JSONDecodeError):
        found |= leaves(json.loads(done.stdout))
    for path in sorted((scratch / out).rglob("*.csv")):
        table = pd.read_csv(path, comment="#")
        found |= {f"{path.name} {name}": table[name].tolist() for name in table}
    for path in sorted((scratch / out).rglob("*.parquet")):
        columns = read_table(path).to_pydict().items()
        found |= {f"{path.name} {column}": cells for column, cells in columns}
    return found


def spent() -> float:
    """Processor time of this process and of those that it waited for [s]."""
    used = (getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)


def item(name: str, scratch: Path) -> dict[str, object]:
    folder = named(scratch, "data" if name == "data" else f"out-{zlib.crc32(name.encode())}")
    (head, *rest), began = name.split(), spent()
    is_function = head in FUNCTIONS
    found = FUNCTIONS[head](*rest, folder) if is_function else console(name, scratch, folder.name)
    found |= {"code": found.get("code", 0), SPENT: spent() - began}
    if name != "data":
        shutil.rmtree(folder)
    return {f"{name}: {key}": value for key, value in found.items()}


FUNCTIONS = {"data": data, "records": records, "parts": parts}


def write(pattern: str) -> dict[str, object]:
    groups = [f"parts {kind}" for kind in ("plants", "controllers", "instruments", "laws")]
    names = [n for n in (*groups, "records", *commands()) if pattern in n]
    workers = ProcessPoolExecutor(2, get_context("spawn"))
    with tempfile.TemporaryDirectory() as scratch, workers as pool:
        found = pool.submit(item, "data", Path(scratch)).result()
        for got in pool.map(item, names, repeat(Path(scratch))):
            found |= got
    return found


def leaves(tree: object, path: str = "") -> dict[str, object]:
    """Lists of values stay whole."""
    listed = enumerate(tree if type(tree) is list else ())
    branches = [*(tree.items() if isinstance(tree, dict) else listed)]
    if not isinstance(tree, dict) and not any(isinstance(b, dict | list) for _, b in branches):
        return {path: tree}
    return {k: v for name, branch in branches for k, v in leaves(branch, f"{path}/{name}").items()}


def difference(old: object, new: object) -> float | str:
    """Largest difference over the largest magnitude; a text if values are not numbers."""
    old, new = (v if isinstance(v, list) else [v] for v in (old, new))
    if len(old) != len(new):
        return f"{len(old)} values became {len(new)}"
    pairs = [(a, b) for a, b in zip(old, new, strict=True) if repr(a) != repr(b)]
    if not all(isinstance(v, int | float) for pair in pairs for v in pair):
        return "{!r} became {!r}".format(*pairs[0])
    size = max((abs(v) for v in old if isinstance(v, int | float) and v == v), default=0.0)
    return max((abs(a - b) / size if size else math.inf for a, b in pairs), default=0.0)


def compare(old: dict[str, object], new: dict[str, object]) -> int:
    spent = [sum(v for k, v in of.items() if k.endswith(SPENT)) for of in (old, new)]
    old, new = ({k: v for k, v in of.items() if not k.endswith("seconds")} for of in (old, new))
    found = {key: difference(old[key], new[key]) for key in old if key in new}
    differing = {key: how for key, how in found.items() if how != 0.0}
    words = {key for key in differing if isinstance(old[key], str)}
    numbers = [differing[key] for key in differing.keys() - words]
    bad = [how for how in numbers if isinstance(how, str) or how > ALLOWED]
    missing = sorted(old.keys() - new.keys())
    for key in missing:
        print(f"missing: {key}")
    for key, how in differing.items():
        print(f"{'words: ' if key in words else ''}{key}: {how}")
    print(f"{len(found) - len(differing)} of {len(old)} the same to the bit, {len(bad)} differ by")
    print(f"more than {ALLOWED:g}, {len(words)} in words; {len(missing)} are missing")
    print("processor time: {:.0f} s, then {:.0f} s".format(*spent))
    return 1 if bad or missing else 0


if __name__ == "__main__":
    mode, *words = sys.argv[1:] or [""]
    if mode == "write" and words:
        Path(words[0]).write_text(json.dumps(write("".join(words[1:]))), "utf-8")
    elif mode == "compare" and len(words) == 2:
        raise SystemExit(compare(*(json.loads(Path(p).read_text("utf-8")) for p in words)))
    else:
        raise SystemExit(__doc__)

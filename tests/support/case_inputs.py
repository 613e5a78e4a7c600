"""The inputs of the cases: small files of the kinds that users of other tools had trouble with.

Each function writes the files of the case of its name into a folder. Noise is drawn with fixed
seeds, FMUs are compiled.
"""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import small_fmus as mk
from networks_of_parts import write_system
from scipy.integrate import solve_ivp
from scipy.io import savemat
from third_party_fmus import proportional

START = datetime(2024, 3, 1, 12)
AXIS = 'kind = "ball_screw"\nlaw = "lugre"\n'
HEAVY_DRIVE = """kind = "drive"
law = "classical"
[plant]
m = 25.0
gain = 1.0
sigma2 = 100.0
Fc = 1658.0
Vs = 0.001
[tolerance]
gain = 0
"""


def write(path: Path, names: str, formats: str, *columns, sep=",", end="\n", after="") -> None:
    """A table in text with a line of names; with another separator, it has decimal commas."""
    row = sep.join(f"{{:{f}}}" for f in formats.split())
    text = "\n".join(row.format(*cells) for cells in zip(*columns, strict=True))
    text = text if sep == "," else text.replace(".", ",")
    path.write_text(f"{names}\n{text}\n{after}", encoding="utf-8", newline=end)


def swings(t: np.ndarray, *parts: tuple[float, float]) -> list[np.ndarray]:
    """Position, speed and acceleration from rest at 0, of swings of amplitude [m] and frequency."""
    turned = [(amplitude, 2 * np.pi * f, 2 * np.pi * f * t) for amplitude, f in parts]
    return [
        sum(a * (1 - np.cos(angle)) for a, _, angle in turned),
        sum(a * w * np.sin(angle) for a, w, angle in turned),
        sum(a * w**2 * np.cos(angle) for a, w, angle in turned),
    ]


# Records


def axis_record(samples: int = 3000) -> dict[str, np.ndarray]:
    """The nominal ball screw with LuGre friction under a smooth voltage, at 1 kHz.

    The position is an angle in degrees, in counts of 1/4096 turn.
    """
    turn = 2 * np.pi * 1000.0  # rad/m

    def voltage(t):
        waves = 6 * np.sin(2 * np.pi * 0.4 * t) + 3 * np.sin(2 * np.pi * 0.9 * t + 0.5)
        return -np.expm1(-((t / 0.3) ** 2)) * waves

    def slope(t, state):
        _, v, z, i = state
        level = (1.284 + (2.35 - 1.284) * np.exp(-((v / 1.13975e-3) ** 2))) / 66967.231
        bristle = v - abs(v) * z / level
        friction = 66967.231 * z + 344.56 * bristle + 173.0 * v
        back = 60 / (255 * 2 * np.pi) * turn * v
        return [
            v,
            37.4e-3 * turn * i - friction,
            bristle,
            (voltage(t) - 21.4 * i - back) / 0.953e-3,
        ]

    t = np.arange(samples) * 1e-3
    x, _, _, i = solve_ivp(slope, (0, t[-1]), np.zeros(4), "LSODA", t, rtol=1e-8, atol=1e-12).y
    return {"time": t, "x": np.round(x * 1000 * 4096) / 4096 * 360, "u": voltage(t), "i": i}


def angle_wraps(folder):
    t, x, u, i = axis_record().values()
    write(folder / "run.csv", "time,x [deg],u,i", ".6f .6f .6f .6f", t, x % 360, u, i)
    (folder / "axis.toml").write_text(AXIS)


def diagnose_voltage_scaled_none(folder):
    t, x, u, i = axis_record().values()
    for name, scale in (("right", 1.0), ("run", np.sqrt(3))):
        write(folder / f"{name}.csv", "time,x [deg],u,i", ".6f .6f .6f .6f", t, x, scale * u, i)
    (folder / "axis.toml").write_text(AXIS)


def lead_screw(mass: float = 60.0, backwards: float = 1.0, seconds: float = 10.0) -> np.ndarray:
    """Time, position, torque and speed of a screw of 5 mm with Karnopp's stiction, at 1 kHz.

    Coulomb friction of 90 N, `backwards` times as much in -x; the torque is held between samples.
    """
    h, per_torque = 1e-4, 2 * np.pi / 0.005
    t = np.arange(round(1e3 * seconds)) * 1e-3
    way, speed, _ = swings(t, (0.02, 0.17), (0.012, 0.63), (0.01, 1.09))
    way, speed = way * np.minimum(t, 1.0), speed * np.minimum(t, 1.0)
    x = v = summed = 0.0
    rows = []
    for k, at in enumerate(t):
        read = round(x / 2e-6) * 2e-6
        summed += (way[k] - read) * 1e-3
        asked = 3e5 * (way[k] - read) + 2e6 * summed + 6e3 * (speed[k] - v)
        torque = round(max(-800.0, min(800.0, asked)) / per_torque, 5)
        rows.append((at, read, torque, v))
        for _ in range(10):
            x, v = karnopp_step(x, v, torque * per_torque, h, mass, 90.0, backwards)
    return np.array(rows).T


def karnopp_step(x, v, force, h, mass, coulomb, backwards):
    """One step of a body that sticks at zero speed, for the record and for its oracle."""
    if v == 0.0 and -1.28 * coulomb * backwards <= force <= 1.28 * coulomb:
        return x, 0.0
    way = np.copysign(1.0, v or force)
    level = coulomb * (1.0 if way > 0 else backwards)
    friction = way * level * (1.0 + 0.28 * np.exp(-((v / 0.012) ** 2))) + 260.0 * v
    after = v + h * (force - friction) / mass
    after = after if after * way > 0.0 else 0.0
    return x + 0.5 * h * (v + after), after


def own_machine(folder):
    head = "Achse 1;Messung\nZeit;Istposition;Drehmoment\nms;mm;Nm"
    for name, given in (("rec", {}), ("heavy", {"mass": 72.0}), ("asym", {"backwards": 1.15})):
        t, x, torque, _ = lead_screw(**given)
        write(folder / f"{name}.csv", head, ".1f .3f .5f", 1e3 * t, 1e3 * x, torque, sep=";")
    plant = HEAVY_DRIVE.replace("25.0", "60.0").replace("100.0", "260.0").replace("0.001", "0.012")
    for name, coulomb in (("right", 90.0), ("weak", 88.0)):
        text = plant.replace("Fc = 1658.0", f"Fc = {coulomb}\nFs = {1.28 * coulomb:.2f}")
        (folder / f"{name}.toml").write_text(text + "Fc = 0.1\nFs = 0.1\n")


def record_thousands_dot(folder):
    t, x, u, _ = axis_record(1500).values()
    path, whole = folder / "run.csv", np.round(x / 0.36).astype(int)  # micrometres
    write(path, "time;x;u", ".3f _d .6f", t, whole, u, sep=";")
    path.write_text(path.read_text().replace("_", "."))


def record_unit_in_brackets_unknown(folder):
    t, x, u, _ = axis_record(1500).values()
    names = "time [s],x [in],u [V]"
    write(folder / "run.csv", names, ".6f .7f .6f", t, x / 360e3 / 0.0254, u)


def swing(count: int = 2000, period: float = 1e-3) -> list[np.ndarray]:
    """Time, position [m] and voltage of a record that is only to be read."""
    t = np.arange(count) * period
    angle, speed = 2 * np.pi * 1.9 * t, 2 * np.pi * 1.9 * 0.03
    return [t, 0.03 * np.sin(angle), 11 * speed * np.cos(angle) + 3.0 * np.cos(2 * np.pi * 3 * t)]


def binary_measurement_files(folder):
    starts = {"h5": b"\x89HDF\r\n\x1a\n", "mf4": b"MDF ", "tdms": b"TDSm", "xlsx": b"PK\3\4"}
    for kind, magic in starts.items():
        (folder / f"a.{kind}").write_bytes(magic + bytes(2000))


def labview_lvm(folder):
    head = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t,
X_Columns\tOne
***End_of_Header***\t

Channels\t2\t\t\t
Samples\t1500\t1500\t\t
Date\t2019/07/22\t2019/07/22\t\t
Delta_X\t0,001000\t0,001000\t\t
***End_of_Header***\t\t\t\t
X_Value\tPosition\tVoltage\tComment"""
    t, x, u = swing(1500)
    words = [f"{volts:.6f}" for volts in u]
    words[0] += "\tstart"
    write(folder / "run.lvm", head, ".6f .6f s", t, x, words, sep="\t", end="\r\n")


def mat_matrix(folder):
    t, x, u = swing()
    savemat(folder / "tofile.mat", {"ans": np.stack([t, x, u])})
    signals = [{"values": c, "dimensions": 1, "label": n} for n, c in (("pos", x), ("volt", u))]
    scope = {"time": t, "signals": np.array(signals), "blockName": "m/Scope"}
    savemat(folder / "scope.mat", {"ScopeData": scope})
    y = [{"Name": n, "Data": c, "Unit": e} for n, c, e in (("Pos", x, "m"), ("U", u, "V"))]
    record = {"X": {"Name": "time", "Data": t}, "Y": np.array(y), "Description": "d"}
    savemat(folder / "dspace.mat", {"rec_001": record})


def time_as_date(folder):
    t, x, u = swing()
    stamps = [(START + timedelta(seconds=s)).isoformat(timespec="microseconds") for s in t]
    write(folder / "run.csv", "time,x,u", "s .6f .6f", stamps, x, u)


def fast_stamps(folder):
    """At 2.5 kHz: a database's nanoseconds, and float32 after an hour."""
    import pyarrow
    from pyarrow import parquet

    t, x, u = swing(2600, 4e-4)
    since = np.round(1e9 * t).astype("i8") + 1_760_000_000_000_000_000
    parquet.write_table(pyarrow.table({"time": since, "x": x, "u": u}), folder / "run.parquet")
    np.savez(folder / "run.npz", time=(5000.0 + t).astype("f4"), x=x, u=u)


def hdf5_scale_factor(folder):
    """As netCDF packs numbers: a position in counts of 1 um from -0.01 m on, one of them empty."""
    import h5py

    t, x, u = swing()
    packed = np.round((x + 0.01) / 1e-6).astype("i4")
    packed[700] = -999
    with h5py.File(folder / "run.h5", "w") as file:
        file["time"], file["u"], file["x"] = t, u, packed
        told = {"scale_factor": 1e-6, "add_offset": -0.01, "_FillValue": np.int32(-999)}
        file["x"].attrs.update(told | {"units": "m"})


def words_beside_the_table(folder):
    t, x, u = swing(1500)
    beside = [["Record Length", "1500", ""], ["Source", "CH1", ""], ["Vertical Units", "V", ""]]
    rows = zip(beside + [[""] * 3] * 1497, t, x, u, strict=True)
    lines = (f"{','.join(words)},{a:.6f},{b:.6f},{c:.6f}\n" for words, a, b, c in rows)
    (folder / "scope.csv").write_text("".join(lines))


def block_record(noise: float, random: np.random.Generator) -> list[np.ndarray]:
    """Time, position, speed, and the force that moves 5 kg with dry and viscous friction."""
    t = np.arange(8000) * 1e-3
    x, v, a = swings(t, (0.03, 0.7), (0.008, 2.1))
    force = 5.0 * a + 40.0 * v + 8.0 * np.sign(v) + noise * random.standard_normal(t.size)
    return [t, x, v, force]


def samples_lost_under_even_stamps(folder, every: int | None = None):
    """A logger that counts rows lost samples where the block moves."""
    random = np.random.default_rng(7)
    t, x, v, force = block_record(0.2, random)
    moving = np.flatnonzero(np.abs(v) > 0.05)
    lost = moving[::every] if every else random.choice(moving, 240, replace=False)
    t, *columns = (np.delete(c, lost) for c in (t, x, force))
    write(folder / "run.csv", "time,x,force", ".3f .7f .3f", 1e-3 * np.arange(t.size), *columns)
    np.save(folder / "true.npy", t)


def xlsx_far_cell(folder):
    import openpyxl

    book = openpyxl.Workbook()
    for row in (["time", "x", "u"], *([0.01 * k, k, 2 * k] for k in range(50))):
        book.active.append(row)
    book.active["XFD1048576"] = 1
    book.save(folder / "far.xlsx")


def header_brackets(folder):
    t, x, u = swing(300)
    write(folder / "record.csv", f"time{'(' * 50_000},x,u", ".3f .6f .6f", t, x, u)


def twincat_scope_eof(folder):
    head = """Name\tYT Scope Project
File\tC:\\scope\\a.svdx
Starttime of export\t132959769843760000\tMonday, 2 May 2022\t13:56:24.376

Name\tAxis.ActPos\tName\tAxis.Torque
SymbolComment\t\tSymbolComment\t
SampleTime[ms]\t1\tSampleTime[ms]\t1
SymbolName\tMain.Axis.NcToPlc.ActPos\tSymbolName\tMain.Axis.Torque
Unit\tmm\tUnit\tV
"""
    t, x, u = swing(1500)
    columns = 1e3 * t, 1e3 * x, 1e3 * t, u
    options = {"sep": "\t", "end": "\r\n", "after": "EOF\n"}
    write(folder / "scope.csv", head, ".0f .6f .0f .6f", *columns, **options)


def heavy_friction_names_inertia(folder):
    for rate in (50, 200):
        t = np.arange(40 * rate) / rate
        x, v, a = swings(t, (0.0555, 0.25), (0.002, 1.25))
        noise = 60.0 * np.random.default_rng(rate).standard_normal(t.size)
        force = 25.0 * a + 100.0 * v + 1658.0 * np.sign(v) + noise
        write(folder / f"f_m25_{rate}Hz.csv", "time,u,x", "g .5f g", t, force, x.round(6))
    (folder / "p25.toml").write_text(HEAVY_DRIVE)


def strokes(t: np.ndarray, *parts: tuple[float, float, float]) -> list[np.ndarray]:
    """Position, speed and acceleration of strokes and back: length [m], frequency, duration."""
    motion, start = [np.zeros_like(t) for _ in range(3)], 0.0
    for length, frequency, duration in parts:
        here = (t >= start) & (t < start + duration)
        for whole, part in zip(
            motion, swings(t[here] - start, (0.5 * length, frequency)), strict=True
        ):
            whole[here] = part
        start += duration
    return motion


def jitter_hides_the_mass(folder):
    random = np.random.default_rng(1)
    t = np.arange(0, 9, 1e-3)
    parts = (0.03, 0.5, 2), (0.06, 1, 2), (0.08, 1.5, 2), (0.02, 3, 3)
    x, v, a = strokes(t + random.normal(0, 2e-5, t.size), *parts)
    friction = np.sign(v) * (31.8 + 17.5 * np.exp(-((v / 0.0173) ** 2))) + 30 * v
    force = 22.6 * a + friction - 1.77 + random.normal(0, 0.06, t.size)
    write(folder / "j.csv", "time,force,x", "g .1f .6f", t, force, x)


def oneway_offset_identified(folder):
    t = np.arange(0, 6, 5e-3)
    x, v, a = swings(t, (0.01, 0.7))
    x, v = x + 0.1 * t, v + 0.1
    noise = np.random.default_rng(1).normal(0, 0.02, t.size)
    force = 5.0 * a + 40.0 * v + 8.0 + 20.0 + noise
    write(folder / "up.csv", "time,x,force", ".3f .7f .4f", t, x, force)


# FMUs: a cart and its PD controller, each with one peculiarity


def _pair(folder, name, **options):
    mk.plant(str(folder / f"{name}.fmu"), name, **options)
    mk.pd(str(folder / "pd.fmu"))


def algebraic_loop_step_too_long(folder):
    _pair(folder, "cart_ft", out="$x$=S[0]+0.02*$u$;$v$=S[1];", deps=True)


def disturbance_input_of_plant(folder):
    load = [("F_load", "input", 0.0, "")]
    step = mk.PLANT_STEP.replace("$u$", "($u$+$F_load$)")
    _pair(folder, "cart_ld", more=load, step=step)


def output_at_start(folder):
    current = [("i", "output", None, "")]
    _pair(folder, "motor", more=current, more_out="$i$=($u$-0.5*S[1])/2.0;", deps=True)


def setpoint_taken_by_plant_output(folder):
    names = {"u": "u_in"}
    echo = [("x_d", "output", None, "")]
    step = mk.PLANT_STEP.replace("$u$", "$u_in$")
    _pair(folder, "cart_uu", names=names, more=echo, step=step, more_out="$x_d$=88;")


def roles_of_set_points(folder):
    """A cascade with feed-forward, whose three set-points have one role."""
    (folder / "cascade.py").write_text(
        """from ballscrew import Component, Input, Output, Parameter, symbol

def cascade():
    x_d, v_d, a_d, x, v, K, L = map(symbol, "x_d v_d a_d x v Kpos Kvel".split())
    goals = (("x_d", "m"), ("v_d", "m/s"), ("a_d", "m/s^2"))
    gains = (("Kpos", 8.0, "1/s"), ("Kvel", 400.0, "V*s/m"))
    return Component(
        "cascade", "P-P cascade",
        tuple(Parameter(*p, "gain", "by hand", minimum=0.0) for p in gains),
        (*(Input(*i, "set-point", role="reference") for i in goals),
         Input("x", "m", "position", role="measurement"),
         Input("v", "m/s", "velocity", role="measurement")),
        outputs=(Output("u", "V", "voltage", L * (K * (x_d - x) + v_d - v) + 0.1 * a_d),))
"""
    )


def step_discarded(folder):
    _pair(folder, "cart_d", step="if(h>2.0001e-4)return 2;" + mk.PLANT_STEP)


def plant_with_fixed_step(folder):
    step = "if(fabs(h-0.01)>1e-12)return 3;" + mk.PLANT_STEP
    exp = '<DefaultExperiment stepSize="0.01"/>'
    _pair(folder, "cart_fx", step=step, varstep=False, exp=exp)


def sources_with_their_own_prefix(folder):
    """With a header of FMI 2.0.0, in which only the model says the prefix."""
    source = mk.source_of("cart_src", mk.PLANT, out="$x$=S[0];$v$=S[1];", step=mk.PLANT_STEP)
    functions = sorted(set(re.findall(r"\bfmi2\w+", source)))
    header = """#define fmi2Paste(a, b) a ## b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
"""
    header += "".join(f"#define {f} fmi2FullName({f})\n" for f in functions)
    own = "#define FMI2_FUNCTION_PREFIX cart_src_\n#endif\n"
    source = f'#ifndef FMI2_FUNCTION_PREFIX\n{own}#include "fmi2Functions.h"\n{source}'
    files = {"fmi2Functions.h": header, "cart_src.c": source}
    _pair(folder, "cart_src", sources=files)


def ssp_implementation_model_exchange(folder):
    _pair(folder, "cart")
    system(folder, "me.ssp", said='implementation="ModelExchange"')


PORTS = [*((n, "input", 0, "") for n in ("x", "v", "x_d")), ("u", "output", None, "")]
OURS = (418.44677021819587, 174.3135365959808, 0.1517675138068781)  # gains of the built-in pid


def _pid(folder, name, start=0.0, **options):
    """In Python: u is known after the first step, and what is summed up is no variable."""
    lines = {
        "at_start": f"self.sum, self.u = 0.0, {start}",
        "in_step": "self.sum += (self.x_d - self.x) * step_size",
        "law": "{} * (self.x_d - self.x) + {} * self.sum - {} * self.v".format(*OURS),
    }
    proportional(folder, name, **lines, **options)


def inputs_after_initialization(folder):
    """Commands that follow from what was there when initialization ended."""
    for name, seen in (("probe", "$x_d$"), ("probe_x", "$x$")):
        lines = {"init": f"S[0]=1+100*{seen};", "out": "$u$=S[0];"}
        mk.build(str(folder / f"{name}.fmu"), name, PORTS, **lines)
    law = "$u$=418.0*(S[0]-$x$)-0.15*$v$;$seen$=S[1];"
    ports = [*PORTS, ("seen", "output", None, "")]
    start = "S[0]=$x$;S[1]=1+100*$x_d$;"
    mk.build(str(folder / "hold.fmu"), "hold", ports, init=start, out=law)
    mk.plant(str(folder / "cart.fmu"))
    _pid(folder, "PyPid")
    _pid(folder, "PidA", start=0.08 * OURS[0])
    _pid(folder, "Fixed", canHandleVariableCommunicationStepSize=False)


UNITS = {  # by name: base units and what to multiply with
    "m": ('m="1"', 1.0),
    "mm": ('m="1"', 1e-3),
    "m/s": ('m="1" s="-1"', 1.0),
    "N": ('kg="1" m="1" s="-2"', 1.0),
    "kN": ('kg="1" m="1" s="-2"', 1e3),
    "rad": ('rad="1"', 1.0),
    "deg": ('rad="1"', np.pi / 180),
    "rad/s": ('rad="1" s="-1"', 1.0),
    "rpm": ('rad="1" s="-1"', np.pi / 30),
    "V": ('kg="1" m="2" s="-3" A="-1"', 1.0),
    "mV": ('kg="1" m="2" s="-3" A="-1"', 1e-3),
    "K": ('K="1"', 1.0),
    "degC": ('K="1" offset="273.15"', 1.0),
}
DEFINED = "".join(
    f'<Unit name="{n}"><BaseUnit {base} factor="{factor!r}"/></Unit>'
    for n, (base, factor) in UNITS.items()
)
DEFINED = f"<UnitDefinitions>{DEFINED}</UnitDefinitions>"


def _size(unit: str | None) -> float:
    return UNITS[unit][1] if unit in UNITS else 1.0


def _ports(inputs: str, outputs: str, units: dict[str, str]) -> list[mk.Variable]:
    told = {
        n: f'unit="{units[n]}"' if n in units else "" for n in (*inputs.split(), *outputs.split())
    }
    return [
        (n, *(("input", 0) if n in inputs.split() else ("output", None)), told[n]) for n in told
    ]


def cart_in(folder, name: str = "cart", offset: float = 0.0, **units: str) -> None:
    """The cart, whose ports have these units; `offset` is that of the unit of x."""
    x, v, u = (_size(units.get(n)) for n in ("x", "v", "u"))
    step = "double F=$u$*@/2.0,v=S[1],e=exp(-2.0*h);S[0]+=F*h+(v-F)*(1-e)/2.0;S[1]=F+(v-F)*e;"
    lines = {
        "out": f"$x$=(S[0]-{offset!r})/{x!r};$v$=S[1]/{v!r};",
        "step": step.replace("@", repr(u)),
    }
    path, ports = str(folder / f"{name}.fmu"), _ports("u", "x v", units)
    mk.build(path, name, ports, deps=False, units=DEFINED, **lines)


def pd_in(folder, name: str = "pd", **units: str) -> None:
    """The PD controller, whose ports have these units."""
    x, v, x_d, u = (_size(units.get(n)) for n in ("x", "v", "x_d", "u"))
    law = f"$u$=($Kp$*($x_d$*{x_d!r}-$x$*{x!r})-8.0*$v$*{v!r})/{u!r};"
    ports = [*_ports("x v x_d", "u", units), ("Kp", "parameter", 25.0, "")]
    mk.build(str(folder / f"{name}.fmu"), name, ports, out=law, units=DEFINED)


def units_relative_quantity(folder):
    """A heater of 10 J/K that loses 2 W/K, and a gain of 20 W/K: temperatures above the room's."""
    told = 'relativeQuantity="true" unit='
    room = [("u", "input", 0, ""), ("x", "output", None, told + '"degC"')]
    lines = {"step": "double e=exp(-0.2*h);S[0]=S[0]*e+$u$/2.0*(1-e);", "out": "$x$=S[0];"}
    mk.build(str(folder / "cart.fmu"), "cart", room, deps=False, units=DEFINED, **lines)
    own = [("x", "input", 0, told + '"K"'), ("x_d", "input", 0, ""), ("u", "output", None, "")]
    mk.build(str(folder / "pd.fmu"), "pd", own, out="$u$=20.0*($x_d$-$x$);", units=DEFINED)
    system(folder, "s.ssp", without="v")


def system(
    folder, name: str, said: str = "", controller: str = "pd", inside: str = "", without: str = ""
) -> None:
    """An .ssp of cart.fmu and a controller of this folder.

    `said` is an attribute of the plant, `inside` its content; ports `without` are not connected.
    """
    wires = [("plant", "x", controller), ("plant", "v", controller), (controller, "u", "plant")]
    joined = [f"{a}.{port} -> {b}.{port}" for a, port, b in wires if port not in without.split()]
    parts = {"plant": folder / "cart.fmu", controller: folder / f"{controller}.fmu"}
    write_system(folder / name, parts, joined, said={"plant": (said, inside)})

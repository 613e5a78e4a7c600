"""Comparison of this program with alternatives: ``python benchmarks/peers.py``.

Prints tables of docs/speed.md. Programs that are not installed are listed as such; `make bench`
installs those of ``benchmarks/peers.txt``. The EMPS record is read from ``BALLSCREW_EMPS``, see
docs/measured-drives.md. The cost of exponents in other programs is in benchmarks/lyapunov.py.
"""

from __future__ import annotations

import inspect
import math
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

# compilation is timed, so the cache must be empty; set before the package is imported
_FOLDER = tempfile.TemporaryDirectory()
os.environ["BALLSCREW_CACHE"] = _FOLDER.name
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(ROOT / "tests" / "support"))

import fmpy  # noqa: E402
import master  # noqa: E402
import numpy as np  # noqa: E402
import numpy.typing as npt  # noqa: E402
import swap_by_hand  # noqa: E402
from networks_of_parts import link  # noqa: E402
from other_masters import HOSTS, TimedChain, TimedLoop, side_by_side  # noqa: E402
from reference_fmus import reference_fmu, reference_result  # noqa: E402
from scipy.optimize import minimize  # noqa: E402
from scipy.signal import butter, filtfilt  # noqa: E402

import ballscrew  # noqa: E402
from ballscrew.controllers.rigid_axis import rigid_axis  # noqa: E402
from ballscrew.fmus.native.export import export_native  # noqa: E402
from ballscrew.solver.component import Component, DiscreteState, Parameter, symbol  # noqa: E402

EMPS = Path(os.environ.get("BALLSCREW_EMPS", ROOT.parent / "shared" / "data" / "EMPS"))
Vector = npt.NDArray[np.float64]
Lines = list[str]
LOSSES: Lines = []


def timed(work: Callable[[], Any], rounds: int = 1) -> tuple[float, Any]:
    """Seconds of the fastest round, and the result of the last one."""
    best, result = math.inf, None
    for _ in range(rounds):
        began = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - began)
    return best, result


def table(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> Lines:
    columns = list(columns)
    head = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return head + ["| " + " | ".join(str(c) for c in row) + " |" for row in rows]


def compare(what: str, ours: float, others: dict[str, float], unit: str) -> None:
    """Note every program that is better than ours; smaller is better."""
    for name, value in others.items():
        if value < ours:
            LOSSES.append(f"- {what}: {name} {value:.3g} {unit}, this program {ours:.3g} {unit}")


# -- exponents -------------------------------------------------------------------------------------


def folded_towel() -> Component:
    """The folded towel map, as a component sampled once per second."""
    x1, x2, x3 = (symbol(n) for n in ("x1", "x2", "x3"))
    maps = (
        3.8 * x1 * (1 - x1) - 0.05 * (x2 + 0.35) * (1 - 2 * x3),
        0.1 * ((x2 + 0.35) * (1 - 2 * x3) - 1) * (1 - 1.9 * x1),
        3.78 * x3 * (1 - x3) + 0.2 * x2,
    )
    starts = (0.085, -0.121, 0.075)
    states = zip(("x1", "x2", "x3"), maps, starts, strict=True)
    return Component(
        "towel",
        "the folded towel map",
        discrete=tuple(DiscreteState(n, "1", "state", m, start=s) for n, m, s in states),
        sample_time=Parameter("sample_time", 1.0, "s", "period", "one", minimum=1e-6),
        outputs=(ballscrew.Output("y", "1", "state", x1),),
    )


def lorenz() -> Component:
    x, y, z = (symbol(n) for n in "xyz")
    rates = {"x": 10.0 * (y - x), "y": x * (32.0 - z) - y, "z": x * y - 8.0 / 3.0 * z}
    return Component(
        "lorenz",
        "Lorenz' system",
        states=tuple(ballscrew.State(n, "1", n, r, start=10.0) for n, r in rates.items()),
        outputs=(ballscrew.Output("out", "1", "x", x),),
    )


PUBLISHED = (  # documentation of ChaosTools.jl, "Lyapunov exponents"; its laptop for the time
    (folded_towel, 1e4, (0.43224475747701546, 0.3722615352085776, -3.296655735650821), 966.5e-6),
    (lorenz, 1e3, (0.984974201005527, 0.0036498494900651193, -14.655223962016466), None),
)


def exponents() -> Lines:
    from ballscrew.solver.codegen import generate
    from ballscrew.solver.for_tangents import with_held_states
    from ballscrew.solver.kernel import Kernel, Model
    from ballscrew.solver.spectrum import follow_tangents

    rows = []
    for make, stop, published, laptop in PUBLISHED:
        made = make()
        kernel = generate(with_held_states(made) if made.discrete else made)
        kernel.compile()

        def follow(nudge: int, kernel: Kernel = kernel, stop: float = stop) -> Vector:
            model = Model(kernel, {}, 1e-8)
            model.x[0] += 1e-13 * nudge
            return follow_tangents(model, [0.0, stop]).exponents

        seconds, _ = timed(lambda follow=follow: follow(0), 3)
        every = np.array([follow(k) for k in range(12)])
        found, scatter = every[0], every.std(axis=0)
        theirs = f"{1e3 * laptop:.2f} ms on its authors' laptop" if laptop else "not published"
        for ours, off, printed in zip(found, scatter, published, strict=True):
            name = make.__name__.replace("_", " ")
            rows.append([name, f"{printed:.4f}", f"{ours:.4f}", f"{off:.4f}"])
        rows[-len(found)] += [theirs, f"{1e3 * seconds:.1f} ms"]
        if laptop and laptop < seconds:
            LOSSES.append(
                f"- exponents of a map of 10 000 steps: ChaosTools {1e3 * laptop:.2f} ms, this "
                f"program {1e3 * seconds:.1f} ms, on another computer"
            )
    rows = [row + [""] * (6 - len(row)) for row in rows]
    return [
        "In nats per step (map) and per second (Lorenz' system with rho = 32 over 1000 s).",
        "Both are chaotic: the scatter is the standard deviation over twelve starts that",
        "differ by 1e-13. ChaosTools.jl needs Julia; its figures are those that its",
        "documentation prints.",
        "",
        *table(
            ("system", "ChaosTools prints", "this program", "scatter", "its time", "here"), rows
        ),
    ]


# -- masters ---------------------------------------------------------------------------------------


def masters(folder: Path) -> Lines:
    native = {n: export_native(ballscrew.component(n), folder / f"{n}.fmu").path for n in PARTS}
    loops = {
        "iol loop, 1 ms": TimedLoop(native["plant"], native["iol"], 1e-3, 5.0),
        "nctf loop, 0.1 ms": TimedLoop(native["plant"], native["nctf"], 1e-4, 1.0),
    }
    made = export_native(link(), folder / "link.fmu").path
    chains = {f"chain of {n}": TimedChain(made, n, 1e-3, 2.0) for n in (3, 20)}
    costs = side_by_side(
        lambda loop: master.step_cost(loop.plant, loop.controller, loop.step, False, loop.stop),
        loops,
    )
    costs |= side_by_side(master.chain_cost, chains, ("libcosim", "ecos"))
    rows = []
    for name, row in costs.items():
        rows.append([name, *(f"{row[h]:.1f}" if h in row else "" for h in ("ours", *HOSTS))])
        others = {h: row[h] for h in HOSTS if h in row}
        compare(f"a communication step, {name}", row["ours"], others, "us")
    return [
        "Microseconds per communication step of the same native FMUs, on one core, without",
        "checks. Ours has no verdict in this figure; with it a run takes two to three times",
        "as long.",
        "",
        *table(("network", "this program", "libcosim", "Ecos", "FMU container"), rows),
    ]


PARTS = ("plant", "iol", "nctf", "pid")


# -- preparing and loading -------------------------------------------------------------------------


def by_casadi(folder: Path) -> Path:
    """FMU by CasADi: it writes C and a description, which the user compiles and packs."""
    import casadi

    model = casadi.DaeBuilder("vanderpol")
    model.add("time", "independent")
    x, v = (model.add(n, "output", "continuous", {"start": s}) for n, s in (("x", 2.0), ("v", 0.0)))
    model.eq(model.der(x), v)
    model.eq(model.der(v), (1 - x * x) * v - x)
    here = Path.cwd()
    os.chdir(folder)
    try:
        files = model.export_fmu()
        headers = Path(fmpy.__file__).parent / "c-code"
        sources = [f for f in files if f.endswith(".c")]
        command = ["gcc", "-O2", "-shared", "-fPIC", f"-I{headers}", *sources]
        subprocess.run([*command, "-o", "vanderpol.so", "-lm"], check=True)
        with zipfile.ZipFile("vanderpol.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
            for name in files:
                archive.write(name, name if name.endswith(".xml") else f"sources/{name}")
            archive.write("vanderpol.so", "binaries/x86_64-linux/vanderpol.so")
    finally:
        os.chdir(here)
    return folder / "vanderpol.fmu"


def van_der_pol() -> Component:
    x, v = symbol("x"), symbol("v")
    states = (("x", v, 2.0), ("v", (1 - x * x) * v - x, 0.0))
    return Component(
        "vanderpol",
        "Van der Pol's oscillator",
        states=tuple(ballscrew.State(n, "1", n, r, start=s) for n, r, s in states),
        outputs=(ballscrew.Output("y", "1", "position", x),),
    )


def preparing(folder: Path) -> Lines:
    ours, _made = timed(lambda: export_native(van_der_pol(), folder / "vdp.fmu", fmi=3))
    rows = [["from equations to a compiled FMI 3.0 FMU, Van der Pol", f"{ours:.2f} s"]]
    if installed("casadi"):
        (folder / "casadi").mkdir()
        theirs, _ = timed(lambda: by_casadi(folder / "casadi"))
        rows[-1] += [f"{theirs:.2f} s, CasADi {version('casadi')}, model exchange alone"]
        compare("preparing an FMU", ours, {"CasADi": theirs}, "s")
    else:
        rows[-1] += ["CasADi is not installed"]
    for name, signal in (("Dahlquist", "x"), ("VanDerPol", "x0"), ("BouncingBall", "h")):
        path = compiled(folder, name)
        truth = reference_result(name)
        stop = truth["time"][-1]

        def here(path: Path = path, stop: float = stop) -> object:
            return ballscrew.run("none", plant=path, stop=stop, step=stop / 1000)

        def there(path: Path = path, stop: float = stop) -> object:
            return fmpy.simulate_fmu(str(path), stop_time=stop, output_interval=stop / 1000)

        (ours, run), (theirs, other) = timed(here, 3), timed(there, 3)
        off = np.abs(
            np.interp(truth["time"], run.run.time, run.run.outputs[signal]) - truth[signal]
        )
        off_theirs = np.abs(np.interp(truth["time"], other["time"], other[signal]) - truth[signal])
        rows.append(
            [
                f"load and run the Reference FMU {name}, 1000 steps",
                f"{ours:.2f} s, off by {off.max():.1e} at most",
                f"{theirs:.2f} s, off by {off_theirs.max():.1e} at most, FMPy {fmpy.__version__}",
            ]
        )
        compare(f"loading and running {name}", ours, {"FMPy": theirs}, "s")
    return [
        "Off: from the result that is published with the FMU. This program runs FMUs of",
        "others in a process of their own, tries whether their states come back, and checks",
        "the run; FMPy does none of these.",
        "",
        *table(("work", "this program", "others"), rows),
    ]


def compiled(folder: Path, name: str) -> Path:
    """A Reference FMU with its binary, so that compilation is not timed."""
    path = reference_fmu(folder, name, 2)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder / name)
    code = folder / name / "sources"
    headers = Path(fmpy.__file__).parent / "c-code"
    subprocess.run(
        f"gcc -O2 -shared -fPIC -I. -I{headers} all.c -o {folder}/{name}.so -lm".split(),
        check=True,
        cwd=code,
    )
    with zipfile.ZipFile(path, "a") as archive:
        archive.write(folder / f"{name}.so", f"binaries/linux64/{name}.so")
    return path


# -- a swap by hand --------------------------------------------------------------------------------


def swapping(folder: Path) -> Lines:
    names = ("iol", "nctf", "pid")
    for name in ("plant", *names):
        export_native(ballscrew.component(name), folder / f"{name}.fmu")
    truth = {n: ballscrew.run(n, stop=4.0, step=1e-4).run for n in names}
    ours, swapped = timed(
        lambda: ballscrew.swap([str(folder / f"{n}.fmu") for n in names], stop=4.0)
    )
    lines = len((HERE / "swap_by_hand.py").read_text(encoding="utf-8").splitlines())
    rows = [
        [
            "`ballscrew swap`",
            "1",
            f"{ours:.1f}",
            worst({n: (r.time, r.outputs["x"]) for n, r in runs_of(swapped, names)}, truth),
            "an error estimate for each signal; settling, overshoot, pictures, report",
        ]
    ]
    for step, law in ((1e-3, False), (1e-4, False), (1e-3, True)):
        seconds, found = timed(
            lambda s=step, w=law: {
                n: swap_by_hand.run(folder / "plant.fmu", folder / f"{n}.fmu", s, w) for n in names
            }
        )
        courses = {n: (rows_[:, 0], rows_[:, 1]) for n, rows_ in found.items()}
        way = "law ports wired" if law else "u alone"
        rows.append(
            [
                f"FMPy by hand, {1e3 * step:g} ms, {way}",
                str(lines),
                f"{seconds:.1f}",
                worst(courses, truth),
                "none",
            ]
        )
        compare(f"seconds of a swap ({way}, {1e3 * step:g} ms)", ours, {"by hand": seconds}, "s")
    return [
        "Three controllers on the nominal axis, 8 cm, 4 s, native FMUs. The error is the",
        "largest of the position, against runs with steps of 0.1 ms that are trusted. By",
        "hand is `benchmarks/swap_by_hand.py`: what one writes who has FMPy and nothing",
        "else.",
        "",
        *table(("way", "lines", "s", "largest error", "says of its error"), rows),
    ]


def runs_of(swapped: object, names: Iterable[str]) -> list[tuple[str, object]]:
    results = swapped.results  # type: ignore[attr-defined]
    return [(n, r.run) for n, r in zip(names, results, strict=True)]


def worst(courses: dict[str, tuple[Vector, Vector]], truth: dict[str, object]) -> str:
    said = []
    for name, (t, x) in courses.items():
        right = truth[name]
        error = np.abs(np.interp(t, right.time, right.outputs["x"]) - x).max()
        said.append(f"{name} {error:.1e} m")
    return ", ".join(said)


# -- identification --------------------------------------------------------------------------------


def emps() -> tuple[Vector, Vector, Vector]:
    from scipy.io import loadmat

    data = loadmat(EMPS / "DATA_EMPS.mat")
    t, x, u = (np.ravel(data[n]).astype(float) for n in ("t", "qm", "vir"))
    return t, x, 35.1506518790 * u


def rates(t: Vector, x: Vector, force: Vector) -> tuple[Vector, Vector, Vector]:
    """Velocity, acceleration and force, with the same 100 Hz filter in both time directions."""
    h = t[1] - t[0]
    b, a = butter(4, 100.0 * 2 * h)
    smooth = filtfilt(b, a, x)
    v = np.gradient(smooth, h)
    return v, np.gradient(v, h), filtfilt(b, a, force)


Fitted = tuple[float, Callable[[Vector], Vector], float]  # mass, friction, offset


@dataclass(frozen=True)
class Laps:
    """EMPS: all laps, filtered; `train` are the first three."""

    time: Vector
    position: Vector
    force: Vector
    v: Vector
    acceleration: Vector
    filtered: Vector

    @property
    def train(self) -> npt.NDArray[np.bool_]:
        return self.time < 0.75 * self.time[-1]

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        return np.abs(self.v) > 2e-3  # at rest friction is undetermined


def by_least_squares(laps: Laps) -> Fitted:
    v, rows = laps.v, laps.train & laps.moving
    columns = np.column_stack([laps.acceleration, v, np.sign(v), np.ones_like(v)])[rows]
    m, viscous, coulomb, offset = np.linalg.lstsq(columns, laps.filtered[rows], rcond=None)[0]
    return m, lambda w: viscous * w + coulomb * np.sign(w), offset


def by_lmfit(laps: Laps) -> Fitted:
    import lmfit

    def friction(w: Vector, q: dict[str, float]) -> Vector:
        level = q["coulomb"] + q["peak"] * np.exp(-((w / q["vs"]) ** 2))
        return q["viscous"] * w + level * np.tanh(w / 1e-3)

    def left(values: Any) -> Vector:
        q = values.valuesdict()
        model = q["m"] * laps.acceleration + friction(laps.v, q) + q["b"]
        return (laps.filtered - model)[laps.train]

    starts = {"m": 90.0, "viscous": 100.0, "coulomb": 20.0, "peak": 1.0, "b": 0.0}
    values = lmfit.create_params(**starts, vs={"value": 0.02, "min": 1e-3})
    q = lmfit.minimize(left, values).params.valuesdict()
    return q["m"], lambda w: friction(w, q), q["b"]


def by_pysindy(laps: Laps) -> Fitted:
    import pysindy

    terms = {
        "v": lambda w, a: w,
        "a": lambda w, a: a,
        "sign": lambda w, a: np.sign(w),
        "v|v|": lambda w, a: w * np.abs(w),
    }
    library = pysindy.CustomLibrary(
        list(terms.values()), [lambda w, a, n=name: n for name in terms]
    )
    motion = np.column_stack([laps.v, laps.acceleration])[laps.train]
    columns = np.asarray(library.fit_transform(motion))
    columns = np.column_stack([columns, np.ones(len(columns))])
    optimizer = pysindy.STLSQ(threshold=0.5)
    optimizer.fit(columns, laps.filtered[laps.train, None])
    viscous, m, coulomb, square, offset = np.ravel(optimizer.coef_)
    return m, lambda w: viscous * w + coulomb * np.sign(w) + square * w * np.abs(w), offset


def by_identify(laps: Laps) -> Fitted:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "emps.csv"
        columns = (laps.time, laps.force, laps.position)
        table = np.column_stack([c[laps.train] for c in columns])
        np.savetxt(path, table, delimiter=",", header="time,force,x", comments="")
        found = ballscrew.identify(path, "classical", offset=True, mass=True)
    q = {name: p.value for name, p in found.parameters.items()}

    def friction(w: Vector) -> Vector:
        level = q["Fc"] + (q["Fs"] - q["Fc"]) * np.exp(-((w / q["Vs"]) ** 2))
        return q["sigma2"] * w + level * np.sign(w)

    return q["m"], friction, q["offset"]


def published(_: Laps) -> Fitted:
    return 95.1089, lambda w: 203.5034 * w + 20.3935 * np.sign(w), -3.1648


IDENTIFIED: dict[str, tuple[Callable[[Laps], Fitted], str]] = {
    "published values": (published, ""),
    "NumPy, least squares": (by_least_squares, ""),
    "lmfit, Stribeck curve": (by_lmfit, "lmfit"),
    "pysindy, sparse regression": (by_pysindy, "pysindy"),
    "`ballscrew identify`, classical": (by_identify, ""),
}


def identification() -> Lines:
    if not (EMPS / "DATA_EMPS.mat").is_file():
        return ["The EMPS record is not here."]
    t, x, force = emps()
    laps = Laps(t, x, force, *rates(t, x, force))
    judged = ~laps.train & laps.moving
    rows: list[list[str]] = []
    for name, (fit, needs) in IDENTIFIED.items():
        if needs and not installed(needs):
            rows.append([name, "not installed", "", "", "", ""])
            continue
        seconds, (m, friction, offset) = timed(lambda fit=fit: fit(laps), 2)
        left = laps.filtered - (m * laps.acceleration + friction(laps.v) + offset)
        rms = float(np.sqrt(np.mean(left[judged] ** 2)))
        lines = 1 if fit is by_identify else len(inspect.getsource(fit).splitlines())
        figures = f"{m:.2f}", f"{offset:.2f}", f"{rms:.3f}", f"{seconds:.3f}", str(lines)
        rows.append([name, *figures])
    rows = [r for r in rows if r[-1]] + [r for r in rows if not r[-1]]
    measured = [r for r in rows[1:] if r[-1] and "ballscrew" not in r[0]]
    ours = next(r for r in rows if "ballscrew" in r[0])
    compare(
        "force left on lap 4 of EMPS", float(ours[3]), {r[0]: float(r[3]) for r in measured}, "N"
    )
    compare("seconds to identify", float(ours[4]), {r[0]: float(r[4]) for r in measured}, "s")
    return [
        "EMPS, three laps to fit, judged on the fourth: force minus model while it moves,",
        "the same filter for all. Only the last line has intervals, says what the record",
        "does not tell, and finds the time between force and motion.",
        "",
        *table(("program", "m [kg]", "offset [N]", "left on lap 4 [N]", "s", "lines"), rows),
    ]


# -- tuning ----------------------------------------------------------------------------------------


def tuning() -> Lines:
    if not installed("control"):
        return ["python-control is not installed."]
    import control

    rigid = rigid_axis()
    s = control.tf("s")
    plant = rigid.speed_per_volt / (s * (rigid.lag * s + 1) * (rigid.electrical_time * s + 1))
    grid = np.linspace(0.0, 4.0, 2000)

    def cost(logs: Vector) -> float:
        kp, ki, kd = np.exp(logs)
        forward = kp + ki / s
        loop = control.minreal(plant / (1 + plant * kd * s / (1e-3 * s + 1)), verbose=False)
        closed = control.feedback(forward * loop, 1)
        if np.real(closed.poles()).max() >= 0.0:
            return 1e9
        _, y = control.step_response(closed, grid)
        volts = 0.08 * kp  # the first value of the command, which is the largest in a step
        return float(np.trapezoid(grid * np.abs(1 - y), grid)) + 10.0 * max(volts / 36.0 - 1.0, 0.0)

    def by_control() -> Vector:
        return np.exp(
            minimize(
                cost, np.log([300.0, 100.0, 10.0]), method="Nelder-Mead", options={"maxfev": 200}
            ).x
        )

    seconds, gains = timed(by_control)
    named = dict(zip(("Kp", "Ki", "Kd"), map(float, gains), strict=True))
    ours, tuned = timed(lambda: ballscrew.tune("pid"))
    rows = []
    for name, took, values, lines in (
        ("default gains (SIMC rule)", 0.0, {}, 0),
        ("python-control and SciPy, linear model", seconds, named, 16),
        ("`ballscrew tune`", ours, tuned.values, 1),  # type: ignore[attr-defined]
    ):
        row = [name]
        for motion in ("move:distance=0.03,speed=0.08,acceleration=0.8,jerk=20", "step:size=0.02"):
            run = ballscrew.run("pid", reference=motion, stop=4.0, controller_values=values).run
            error = run.outputs["x"] - run.reference
            row.append(f"{1e6 * float(np.sqrt(np.mean(error**2))):.0f}")
        rows.append([*row, f"{took:.1f}", lines])
    return [
        "A PID for the nominal axis within 36 V. By hand: ITAE of the step response of the",
        "axis without friction. Judged on the axis with friction, in two motions that",
        "nobody tuned on: rms error in um.",
        "",
        *table(("way", "move of 3 cm", "step of 2 cm", "s", "lines"), rows),
    ]


def installed(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


SECTIONS: dict[str, Callable[..., Lines]] = {
    "Exponents": exponents,
    "Masters": masters,
    "Preparing and loading": preparing,
    "A swap by hand": swapping,
    "Identification": identification,
    "Tuning": tuning,
}


def main() -> None:
    for title in sys.argv[1:] or list(SECTIONS):
        section = SECTIONS[title]
        with tempfile.TemporaryDirectory() as folder:
            takes = section.__code__.co_argcount
            lines = section(Path(folder)) if takes else section()
        print("\n".join([f"## {title}", "", *lines, ""]), flush=True)
    print("\n".join(["## Where we lose", "", *(LOSSES or ["Nowhere in these tables."])]))
    named = "numpy scipy fmpy libcosimpy ecospy casadi lmfit pysindy control".split()
    print(", ".join(f"{n} {version(n)}" if installed(n) else f"{n}: not there" for n in named))
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end")


if __name__ == "__main__":
    main()

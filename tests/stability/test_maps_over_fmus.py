"""Maps over FMUs against maps over the equations; signals with a known motion."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pyarrow.parquet as pq
import pytest
from third_party_fmus import STATE_FEEDBACK_PORTS, state_feedback

from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.workers import Processes
from ballscrew.stability.attractor import Kind
from ballscrew.stability.map_plan import BadMap
from ballscrew.stability.signal_motion import signal_motion
from ballscrew.stability.stability_map import make_map, plan_map

STEP = 1e-3


def study(controller, x, y, plant="plant", via="fmu", mapping=None, **options):
    step, stop = STEP if via == "fmu" else None, options.pop("stop", 20.0)
    loop = Loop(controller, plant, stop=stop, mapping=mapping, step=step)
    return plan_map(loop, x, y, tolerance=1e-8, **options)


def table(made, folder, workers=1, resume=False):
    make_map(made, folder, Processes(workers), resume)
    return pq.read_table(folder / "map.parquet").to_pylist()


GAMMA = "sigma0_hat=66967.007:66969.24:3", "sigma1_hat=340:357.34:3"


def test_cells_are_classified_as_by_the_equations(native, tmp_path):
    """The corners hold a cycle, a line of equilibria and a flight."""
    over = table(study("iol", *GAMMA, stop=20.0), tmp_path / "fmu", workers=2)
    model = table(study("iol", *GAMMA, via="model", stop=20.0), tmp_path / "model")
    both = [
        (a, b)
        for a, b in zip(over, model, strict=True)
        if Kind.UNDECIDED not in (a["verdict"], b["verdict"]) and b["verdict"] != Kind.CREEPING
    ]
    assert len(both) >= 7
    assert {b["verdict"] for _, b in both} >= {Kind.CYCLE, Kind.DIVERGES, Kind.LINE}
    for a, b in both:
        assert a["verdict"] == b["verdict"]
        if b["verdict"] == Kind.LINE:
            assert a["final_error"] == pytest.approx(b["final_error"], rel=2e-3)
        if b["verdict"] == Kind.CYCLE:
            swing = b["oscillation_amplitude"]
            assert a["oscillation_amplitude"] == pytest.approx(swing, rel=0.01)
        assert a["lambda1_bits_per_s"] is None


def test_exponents_of_cells_are_those_of_the_equations(native, tmp_path):
    axes = "design.sigma1=300:400:2", "plant.Fc=1.2:1.4:2"
    options = {"stop": 1.0, "exponents": True}
    over = table(study("nctf", *axes, **options), tmp_path / "fmu")
    model = table(study("nctf", *axes, via="model", **options), tmp_path / "model")
    for a, b in zip(over, model, strict=True):
        expected = b["lambda1_bits_per_s"]
        assert a["lambda1_bits_per_s"] == pytest.approx(expected, rel=2e-3, abs=2e-3)
        assert a["final_error"] == pytest.approx(b["final_error"], rel=1e-3, abs=1e-8)


def test_a_third_party_controller_has_its_parameters_on_an_axis(native, tmp_path):
    """By motion alone, and with exponents; its twin with another content is another map."""
    path = state_feedback(tmp_path, "Mapped")
    axes = "gain=200:400:2", "plant.Fs=2.35:2.5:2"
    made = study(str(path), *axes, mapping=STATE_FEEDBACK_PORTS, stop=0.2)
    rows = table(made, tmp_path / "motion")
    assert [r["gain"] for r in rows] == [200.0, 400.0] * 2
    assert all(r["final_error"] < 0.0 for r in rows)  # on its way
    assert abs(rows[1]["final_error"]) < abs(rows[0]["final_error"])  # the stiffer, the nearer
    with_exponents = study(str(path), *axes, mapping=STATE_FEEDBACK_PORTS, stop=0.1, exponents=True)
    rows = table(with_exponents, tmp_path / "exponents")
    assert all(r["lambda1_bits_per_s"] is not None for r in rows)
    path.write_bytes(path.read_bytes() + b"\0")
    other = study(str(path), *axes, mapping=STATE_FEEDBACK_PORTS, stop=0.2)
    assert other.fingerprint() != made.fingerprint()
    with pytest.raises(BadMap, match="another map"):
        make_map(other, tmp_path / "motion", Processes(1), resume=True)


def test_a_plant_without_tangents_is_mapped_by_motion_and_refused_with_exponents(native, tmp_path):
    axes, plant = ("Kp=300:400:2", "plant.Fs=2.35:2.5:2"), str(native("plant"))
    made = study("pid", *axes, plant=plant, stop=0.2)
    assert len(table(made, tmp_path)) == 4
    with pytest.raises(BadMap, match="plant has no tangent ports"):
        study("pid", *axes, plant=plant, stop=0.2, exponents=True)


def test_loops_that_cannot_be_mapped_are_refused_before_the_first_cell(native, tmp_path):
    with pytest.raises(BadMap, match="neither"):
        study("iol", "Kx=1:2:2", "plant.Fs=2.35:2.5:2")
    path = str(state_feedback(tmp_path, "Unmapped"))
    with pytest.raises(BadMap, match="use --map"):
        study(path, "gain=1:2:2", "plant.Fs=2.35:2.5:2")


@dataclass
class Course:
    """A run with one output."""

    time: np.ndarray
    outputs: dict
    stopped: str = ""
    diverged: bool = False


T = np.linspace(0.0, 20.0, 20001)


@pytest.mark.parametrize(
    ("signal", "kind"),
    [
        (np.exp(-2.0 * T), Kind.REST),
        (0.08 + 0.0 * T, Kind.REST),
        (np.exp(-0.2 * T), Kind.UNDECIDED),  # still falling, and nothing says where to
        (np.sqrt(1.0 + T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.3 * np.cos(14.0 * T), Kind.CYCLE),
        (np.sin(7.0 * T) + 0.8 * np.sin(3.5 * T + 0.3), Kind.CYCLE),  # two returns
        (np.exp(-0.1 * T) * np.sin(7.0 * T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.5 * np.sin(7.0 * np.sqrt(2.0) * T), Kind.UNDECIDED),
    ],
)
def test_signals_tell_rest_and_cycles_and_nothing_else(signal, kind):
    assert signal_motion(Course(T, {"x": signal}), {"x": 1.0}).kind is kind


@pytest.mark.parametrize(
    ("rate", "kind"),
    [(0.0, Kind.LINE), (-1.0, Kind.FIXED_POINT), (-0.02, Kind.REST), (0.5, Kind.UNDECIDED)],
)
def test_at_rest_the_first_tangent_tells_a_line_from_a_point(rate, kind):
    run = Course(T, {"x": np.exp(-2.0 * T)})
    assert signal_motion(run, {"x": 1.0}, rate * T).kind is kind


def test_a_run_that_ended_early_diverges_or_is_undecided():
    assert signal_motion(Course(T, {"x": T}, "x left", True), {"x": 1.0}).kind is Kind.DIVERGES
    assert signal_motion(Course(T, {"x": T}, "died"), {"x": 1.0}).kind is Kind.UNDECIDED


def test_a_killed_map_over_fmus_is_resumed_with_what_was_done(native, tmp_path):
    words = ["map", "--controller", "pid", "--via", "fmu", "--stop", "0.3", "--workers", "1"]
    words += ["--x", "Kp=300:400:10", "--y", "plant.Fs=2.35:2.5:10", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "ballscrew", *words]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, cwd=tmp_path, **quiet)
    parts, deadline = tmp_path / "map.parts", time.monotonic() + 120
    while not list(parts.glob("c0-*.json")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    kept = {f: f.stat().st_mtime_ns for f in parts.glob("c0-*.json")}
    assert kept
    again = [*command, "--resume", "--json"]
    done = subprocess.run(again, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["cells"] == 100

"""Predicted positions of a drive that moves, rests under a load and moves again.

The oracle is a plain loop typed here, Karnopp's stiction.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import NOMINAL

from ballscrew.measurement.diagnosis.compare import compare_records
from ballscrew.measurement.diagnosis.corrected import Predictor, with_causes
from ballscrew.measurement.diagnosis.model import Drive
from ballscrew.measurement.diagnosis.motion import lay_along
from ballscrew.measurement.records.reading import check_record
from ballscrew.orchestration.loop.parameter_file import DRIVE, Diagnosed, ParameterFile, Value
from ballscrew.plant import LAWS
from ballscrew.plant.with_friction import with_friction
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

STEP, SECOND = 1e-3, 1000
TRUTH = {"m": 10.0, "gain": 1.0, "offset": 0.0, "Fc": 15.0, "Fs": 20.0, "Vs": 0.01, "sigma2": 30.0}
WEAK = {**TRUTH, "Fs": 11.0, "Fc": 8.0}
LOAD = 12.0  # below the true break-away force, above the weak one
LOADED = slice(2900, 6500)  # its jumps bend the motion where no second begins
RESTS = slice(4000, 6000)


def command(load):
    time = STEP * np.arange(9 * SECOND)
    u = 60 * np.sin(2 * math.pi * 1.1 * time) + 25 * np.sin(2 * math.pi * 2.3 * time)
    u[LOADED] = load[LOADED] if np.ndim(load) else load
    return u


def karnopp(u, x, v, p, parts=100):
    """Position and velocity at the samples: stuck at v = 0 up to Fs, which a sign change meets."""
    h, out = STEP / parts, []
    for force in u:
        out.append((x, v))
        for _ in range(parts):
            if v == 0.0 and abs(force) <= p["Fs"]:
                continue
            way = math.copysign(1.0, v or force)
            fall = (p["Fs"] - p["Fc"]) * math.exp(-((v / p["Vs"]) ** 2))
            after = v + h * (force - way * (p["Fc"] + fall) - p["sigma2"] * v) / p["m"]
            after = after if after * way > 0.0 else 0.0
            x, v = x + h * (v + after) / 2, after
    return np.array(out).T


def karnopp_by_second(record, v, p):
    """Position [m], begun anew at each second from the oracle's own state."""
    parts = (slice(k, k + SECOND) for k in range(0, len(v), SECOND))
    return np.concatenate([karnopp(record.u[q], record.x[q][0], v[q][0], p)[0] for q in parts])


def a_record(u, x):
    return check_record("run.csv", {"time": STEP * np.arange(len(u)), "u": u, "x": x}, "force")


def predicted(record, drive):
    return Predictor(drive, {})(lay_along(record, drive))


def a_file(name, values):
    return ParameterFile(kind=DRIVE, law=name, plant={n: Value(v) for n, v in values.items()})


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def stuck():
    """A record of the true drive, with its velocity."""
    u = command(LOAD)
    x, v = karnopp(u, 0.0, 0.0, TRUTH)
    assert np.all(v[RESTS] == 0.0)
    assert np.ptp(x[6500:]) > 0.1
    return a_record(u, x), v


def test_the_true_classical_law_stays_at_rest_and_follows_the_motion(stuck):
    record, _ = stuck
    off = predicted(record, Drive(DRIVE, "classical", TRUTH)) - record.x
    assert np.abs(off[RESTS]).max() < 1e-9
    assert rms(off) < 1e-5 < 1e-4 * np.ptp(record.x)


def test_the_figures_of_a_comparison_are_those_of_the_prediction(stuck):
    record, v = stuck
    true = compare_records([record], a_file("classical", TRUTH))
    assert list(true.models) == ["model"]
    parts = true.models["model"]
    assert parts["all"].position.value < 1e-5
    assert parts["rest"].force.value == 0.0  # 12 N is held
    assert true.shares["rest"] == pytest.approx(np.mean(v == 0.0), abs=0.01)
    assert true.courses[0].rests[RESTS].all()
    # what opposes the motion, by the oracle's own law
    fast = np.abs(v) > 0.1
    friction = np.sign(v) * TRUTH["Fc"] + TRUTH["sigma2"] * v
    assert rms(true.traces["model"].required[fast] - friction[fast]) < 0.3
    assert "of a friction of" in true.says

    weak = compare_records([record], a_file("classical", WEAK))
    drifts = rms(karnopp_by_second(record, v, WEAK) - record.x)
    assert weak.models["model"]["all"].position.value == pytest.approx(drifts, rel=2e-3)
    # the load is 1 N above what the weak law can hold; sliding, it lacks 7 N
    assert weak.models["model"]["rest"].force.value == pytest.approx(1.0, rel=0.02)
    assert weak.models["model"]["steady"].force.value == pytest.approx(7.0, rel=0.02)
    assert weak.says.startswith("the model leaves 7 N rms of a friction of ")
    assert weak.says.endswith(f"; its position drifts {1e3 * drifts:.3g} mm rms within a second")


@pytest.mark.ci
@pytest.mark.parametrize("name", LAWS)
def test_every_law_goes_on_from_second_to_second_as_in_one_run(name):
    """One run of the package's solver from the start, which the seconds have to follow."""
    drive = Drive(DRIVE, name, {})
    values = {p.name: p.default for p in drive.plant.all_parameters} | {"m": 1.0}
    drive = Drive(DRIVE, name, values)
    holds = drive.friction_scale
    u = holds / 15.0 * command(0.5 * 15.0)
    body = drive.plant
    whole = with_friction(_without_friction(body), name) if name.endswith("classical") else body
    model = Model(generate(whole), values)
    time = STEP * np.arange(len(u))
    run = model.simulate(time, (np.append(u[:1], u[:-1])[:, None], u[:, None]))
    x = run.states["x"]
    off = predicted(a_record(u, x), drive) - x
    assert rms(off) < 2e-4 * np.ptp(x)
    assert rms(off[RESTS]) < 2e-6


def _without_friction(body):
    (balance,) = body.balances
    terms = tuple(t for t in balance.terms if t.name != "friction")
    return replace(body, balances=(replace(balance, terms=terms),))


@pytest.mark.ci
def test_a_gap_before_a_block_that_sticks_is_crossed_as_in_one_run():
    """The gap of a diagnosis, with the rotor on one side and stiction on the other."""
    plain = Drive("ball_screw", "classical", {})
    values = {p.name: NOMINAL.get(p.name, p.default) for p in plain.plant.all_parameters}
    gap = {"backlash": {"gap": 5e-5}}
    model = Model(generate(with_causes(replace(plain, values=values), list(gap.items()))))
    time = STEP * np.arange(9 * SECOND)
    u = command(1.5) / 15.0  # the load is 0.1 V
    x = model.simulate(time, (np.append(u[:1], u[:-1])[:, None], u[:, None])).states["x"]
    record = check_record("run.csv", {"time": time, "u": u, "x": x})
    plant = {n: Value(v) for n, v in values.items()}
    told = Diagnosed(("one.csv",), "voltage", 0.0, "classical", values, values, gap)
    found = compare_records([record], ParameterFile(law="classical", plant=plant, diagnosis=told))
    off = {name: parts["all"].position.value for name, parts in found.models.items()}
    assert off["corrected"] < 2e-7
    assert off["prior"] > 5e-6  # a tenth of the gap
    assert found.models["corrected"]["rest"].force.value == 0.0

    values["Jm"], plant["Jm"] = 0.0, Value(0.0)
    found = compare_records([record], ParameterFile(law="classical", plant=plant, diagnosis=told))
    assert found.models["corrected"]["all"].position is None
    assert found.gains[-1].position is None
    assert any("a gap before the block needs a rotor" in note for note in found.notes)
    assert "position" not in found.says

"""What was found becomes part of the plant: in force, as an FMU, in the closed loop."""

import json
from dataclasses import dataclass, fields

import numpy as np
import pytest

from ballscrew.cli import main
from ballscrew.fmus.export import export
from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.measurement.diagnosis.causes import CAUSES
from ballscrew.measurement.diagnosis.causes.command import late, smeared
from ballscrew.measurement.diagnosis.corrected import with_causes
from ballscrew.measurement.diagnosis.model import Drive, midway
from ballscrew.measurement.diagnosis.motion import Course
from ballscrew.measurement.records.record import Record
from ballscrew.plant.ball_screw import PARAMETERS as SCREW
from ballscrew.plant.direct_drive import PARAMETERS as DRIVE
from ballscrew.plant.law import law
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import symbol
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

STEP = 1e-3
PARTS = 10  # points between two samples at which the truth is looked at
SAMPLES = 3000
ROTOR = 4.2e-7

FOUND = {
    "position_periodic_friction": {
        "periods_per_metre": 1000.0,
        "periodic_viscous_share": 1.0,
        "friction_cos": 0.2,
        "friction_sin": -0.1,
    },
    "position_trend_friction": {
        "friction_trend": 0.3,
        "x_middle": 0.0,
        "x_half": 0.01,
        "trend_viscous_share": 0.0,
    },
    "load_bias": {"load": 0.3},
    "stribeck_mismatch": {"dF_low": 0.4, "V_mismatch": 2e-2},
    "backlash": {"gap": 2e-5},
    "compliance": {"stiffness": 1e6},
}
# bristles have their damping as sigma1; a wrong value of the model is no form
FORMS = [
    (cause.name, {p.name: 0.1 * (k + 1) for k, p in enumerate(form.parameters)})
    for cause in CAUSES.values()
    for form in cause.mechanisms
    if form.parameters and "damping_ratio" not in {p.name for p in form.parameters}
]
# their amplitude is one, the size is the value itself
SIZED = ("gap", "stiffness", "delay")


def prior_model(kind="ball_screw", law_name="modified_lugre", **values):
    drive = SCREW if kind == "ball_screw" else DRIVE
    defaults = {p.name: p.default for p in (*drive, *law(law_name)(symbol("v")).parameters)}
    rotor = {"Jm": ROTOR} if kind == "ball_screw" else {}
    return Drive(kind, law_name, defaults | rotor | values)


def plant_with(model, *names):
    return with_causes(model, [(n, FOUND[n]) for n in names])


@pytest.mark.ci
@pytest.mark.parametrize(("name", "values"), FORMS, ids=lambda p: p if isinstance(p, str) else "")
def test_every_form_of_a_cause_is_part_of_the_plant_with_its_values(name, values):
    """Bristles are found under the only law without presliding."""
    law_name = "classical" if name == "presliding_hysteresis" else "modified_lugre"
    plant = with_causes(prior_model(law_name=law_name), [(name, values)])
    known = {p.name: p.default for p in plant.all_parameters}
    assert {n: known[n] for n in values} == values
    assert generate(with_law_ports(plant)).states


def test_bristles_with_less_damping_have_it_as_sigma1():
    model = prior_model(law_name="classical", sigma2=0.0)
    sigma1 = []
    for ratio in (0.0, 0.35, 1.0):
        values = {"sigma0": 2e5, "damping_ratio": ratio}
        plant = with_causes(model, [("presliding_hysteresis", values)])
        sigma1.append({p.name: p.default for p in plant.all_parameters}["sigma1"])
    assert sigma1[2] == pytest.approx(2.0 * np.sqrt(2e5 * model.linear.block), rel=1e-12)
    assert sigma1[:2] == pytest.approx([0.0, 0.35 * sigma1[2]])


def test_all_causes_at_once_are_one_plant():
    found = {n: values for n, values in reversed(FORMS) if n != "presliding_hysteresis"}
    plant = with_causes(prior_model(law_name="classical"), list(found.items()))
    sources = {p.name: p.source for p in plant.all_parameters}
    for values in found.values():
        assert {sources[n] for n in values} == {"found in measured data"}
    assert sources["kt"] == "prior value, adjusted to measured data"
    assert generate(with_law_ports(plant)).modes == ["stuck", "forward", "backward"]


def test_of_several_records_the_last_ones_phase_is_taken():
    values = {"periods_per_metre": 1000.0}
    values |= {f"friction_cos.{k}": 0.01 * k for k in range(1, 12)}
    values |= {f"friction_sin.{k}": 0.02 * k for k in range(1, 12)}
    plant = with_causes(prior_model(), [("position_periodic_friction", values)])
    known = {p.name: p.default for p in plant.all_parameters}
    assert known["friction_cos"] == pytest.approx(0.11)
    assert known["friction_sin"] == pytest.approx(0.22)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("kind", "found", "said"),
    [
        ("ball_screw", ("gremlins", {}), "no cause 'gremlins'; there are direction_asymmetry"),
        ("ball_screw", ("load_bias", {"weight": 1.0}), "no parameter 'weight'"),
        ("drive", ("resistance_drift", {}), "the model has no motor"),
    ],
)
def test_what_cannot_be_built_in_is_one_line(kind, found, said):
    with pytest.raises(ContractError, match=said) as caught:
        with_causes(prior_model(kind), [found])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("command_held", "breaks_away"), [(2.7, False), (2.8, True)])
def test_a_bend_at_low_speed_is_part_of_the_break_away_force(command_held, breaks_away):
    """2.35 N and 0.4 N."""
    plant = plant_with(prior_model("drive", "classical"), "stribeck_mismatch")
    (forward,) = (e for e in plant.modes[0].events if e.name == "breaks away forward")
    table = {symbol(p.name): p.default for p in plant.all_parameters}
    table |= {symbol("x"): 0.0, symbol("u"): command_held}
    assert (float(forward.indicator.subs(table)) > 0) == breaks_away


# -- the force in motion against the shape that the cause was found by -----------------------------


@dataclass(frozen=True)
class Motion:
    """A simulated motion: at samples, and on average over the intervals after them."""

    x: np.ndarray
    v: np.ndarray
    i: np.ndarray
    arrived: np.ndarray  # voltage at the motor
    force: np.ndarray  # all that opposes the drive, inertia of the prior model taken off


def command():
    """Swings from 0.4 to 25 Hz, up to 12 V, held between samples."""
    draw = np.random.default_rng(1)
    time = np.arange(SAMPLES) * STEP
    swings = [
        np.sin(2 * np.pi * f * time + draw.uniform(0, 6.28)) / np.sqrt(1 + f)
        for f in np.geomspace(0.4, 25, 9)
    ]
    return 12.0 * np.sum(swings, axis=0) / np.abs(np.sum(swings, axis=0)).max()


def simulated(model, found):
    run = Model(generate(with_law_ports(with_causes(model, found))))
    names = [s.name for s in run.kernel.states]
    states = np.empty((SAMPLES * PARTS + 1, len(names)))
    states[0] = run.x
    u = command()
    for k, volts in enumerate(u):
        run.set_input("u", volts)
        if run.kernel.modes:
            run.settle(k * STEP)
        for j in range(PARTS):
            run.advance(k * STEP + j * STEP / PARTS, k * STEP + (j + 1) * STEP / PARTS)
            states[k * PARTS + j + 1] = run.x
    fine = dict(zip(names, states.T, strict=True))
    x, v = fine["x"][::PARTS], fine["v"][::PARTS]
    if not model.has_motor:
        force = model.values["gain"] * u - model.linear.inertia * np.diff(v) / STEP
        return Motion(x[:-1].copy(), v[:-1].copy(), np.zeros(SAMPLES), u, force)
    q, i = model.values, fine["i"][::PARTS]
    mean = (0.5 * (fine["i"][1:] + fine["i"][:-1])).reshape(-1, PARTS).mean(axis=1)
    rates = {"emf": model.linear.back_emf * np.diff(x), "coil": q["L"] * np.diff(i)}
    arrived = q["R"] * mean + (rates["emf"] + rates["coil"]) / STEP
    force = model.linear.per_ampere * mean - model.linear.inertia * np.diff(v) / STEP
    return Motion(x[:-1].copy(), v[:-1].copy(), i[:-1].copy(), arrived, force)


def laid(motion, bristle=0.0):
    """The motion as a diagnosis has it, without any noise."""
    record = {"time": np.arange(SAMPLES) * STEP, "u": command(), "x": motion.x, "i": motion.i}
    known = {"x": motion.x, "v": motion.v, "i": motion.i, "bristle": bristle}
    known |= {"record": Record("swings", record, STEP), "width": 1, "calibration": {}}
    return Course(**{f.name: np.zeros(SAMPLES) for f in fields(Course)} | known)


def foretold(model, motion, found):
    """Force along that motion by the model, without and with the causes' shapes [N]."""
    offset = 0.0 if model.has_motor else model.values["offset"]
    bristle = model.friction(motion.x, motion.v, STEP) - offset
    course = laid(motion, bristle)
    without = bristle + model.linear_friction * midway(motion.v) + offset
    whole = without.copy()
    for name, values in found:
        shape = CAUSES[name].at([course], model, values)
        sizes = [1.0 if a in SIZED else values[a] for a in shape.amplitudes]
        whole += shape.force[0] @ np.array(sizes)
    return without, whole


def apart(seen, told, where):
    """Root mean square of the difference, as a share of what is seen."""
    return np.sqrt(np.mean((seen - told)[where] ** 2) / np.mean(seen[where] ** 2))


@pytest.mark.ci
@pytest.mark.parametrize(
    ("model", "names"),
    [
        (prior_model(), ("position_periodic_friction", "load_bias")),
        (prior_model(), ("compliance",)),
        (prior_model("drive", "classical", offset=0.2), ("position_trend_friction", "load_bias")),
        (prior_model(), ("backlash",)),
        (prior_model("drive", "classical", offset=0.2), ("stribeck_mismatch",)),
    ],
    ids=["periodic and load", "compliance", "drive, sticking", "backlash", "bend, sticking"],
)
def test_the_force_in_motion_is_the_one_it_was_found_by(model, names):
    found = [(n, FOUND[n]) for n in names]
    motion = simulated(model, found)
    without, whole = foretold(model, motion, found)
    moving = np.abs(motion.v) > 1e-4  # stuck, the classical law does not say which force
    moving[:-1] &= np.sign(motion.v[1:]) == np.sign(motion.v[:-1])
    moving[:20] = moving[-2:] = False
    assert moving.mean() > 0.5
    assert apart(motion.force, whole, moving) < 0.01
    assert apart(motion.force, without, moving) > 0.02


@pytest.mark.ci
@pytest.mark.parametrize("found", [{"delay": 3e-4}, {"command_lag": 2e-3}], ids="+".join)
def test_a_late_command_arrives_as_was_foretold(found):
    motion = simulated(prior_model(), [("input_delay", found)])
    u = command()
    change = CAUSES["input_delay"].at([laid(motion)], prior_model(), found).command[0][:, 0]
    later = np.arange(SAMPLES) > 20
    assert apart(motion.arrived, u + change, later) < 5e-4
    assert apart(motion.arrived, u, later) > 5e-3


@pytest.mark.parametrize("window", [3e-4, 7.123e-3])
def test_a_mean_over_a_window_is_the_mean_of_all_delays_in_it(window):
    u = np.random.default_rng(1).normal(size=50)
    delays = (np.arange(4000) + 0.5) / 4000 * window
    told = np.mean([late(u, d, STEP) for d in delays], axis=0)
    assert smeared(u, window, STEP) == pytest.approx(told, abs=1e-6)


# -- in the closed loop -------------------------------------------------------------------------


@pytest.mark.ci
def test_a_drive_that_sticks_runs_under_a_controller(tmp_path):
    model = prior_model("drive", "classical", offset=0.2)
    plant = plant_with(model, "position_trend_friction", "load_bias")
    fmu = export(plant, tmp_path / "extended_plant.fmu")
    left = []
    for trend in ("0.3", "0"):
        run = ["run", "--plant", str(fmu), "--controller", "pid", "--stop", "1"]
        run += ["--set", f"plant.friction_trend={trend}", "--out", str(tmp_path)]
        assert main(run) == 0
        figures = json.loads((tmp_path / "metrics.json").read_text())
        assert figures["verdict"] == "trusted"
        left.append(figures["steady_state_error"])
    assert left[0] > 2 * abs(left[1])  # friction grows on the way to the set-point

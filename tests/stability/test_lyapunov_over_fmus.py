"""Exponents of loops of FMUs by name and by file, native, readable and not ours."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import sympy as sp
from third_party_fmus import STATE_FEEDBACK_PORTS, proportional, state_feedback

from ballscrew import Component, Loop, Output, UserError, symbol
from ballscrew.controllers.limited import measurements_of
from ballscrew.fmus.native.export import write_native
from ballscrew.orchestration.loop.catalogue import catalogued_model
from ballscrew.plant.axis import axis
from ballscrew.stability.attractor import Kind
from ballscrew.stability.lyapunov import loop_lyapunov
from ballscrew.stability.lyapunov_over_fmus import loop_lyapunov_over_fmus, signal_motion

STOP, STEP = 0.3, 1e-3


def share_of_allowed(found, expected):
    """Largest difference over what is allowed: 1e-3 relative, or 1e-3 bits/s near zero."""
    bits, goal = found / np.log(2), expected / np.log(2)
    return float(np.max(np.abs(bits - goal) / np.maximum(1e-3 * np.abs(goal), 1e-3)))


@pytest.fixture(scope="module")
def third_party(tmp_path_factory):
    return state_feedback(tmp_path_factory.mktemp("third_party"), "Feedback")


def equations_of_the_stranger():
    """What `state_feedback` does, written as a component."""
    inputs = [i for i in measurements_of(axis()) if i.name in ("x", "v", "x_d")]
    command = 400 * (symbol("x_d") - symbol("x")) - sp.Integer(2) * symbol("v")
    return Component(
        name="feedback",
        description="State feedback",
        inputs=tuple(inputs),
        outputs=(Output("u", "V", "motor voltage", command, nominal=10.0),),
    )


@pytest.mark.ci
@pytest.mark.parametrize("controller", [pytest.param("iol", marks=pytest.mark.ci), "pid"])
def test_native_variational_fmus_have_the_exponents_of_the_equations(native, controller):
    run = loop_lyapunov_over_fmus(Loop(controller, stop=STOP, step=STEP))
    assert run.method.startswith("native variational FMUs, tangent ports")
    assert share_of_allowed(run.exponents, np.sort(run.tighter.exponents)[::-1]) < 1.0
    assert run.motion.evidence == loop_lyapunov(Loop(controller, stop=STOP)).motion.evidence


@pytest.mark.ci
def test_a_third_party_controller_is_probed_in_a_process_of_its_own(third_party):
    loop = Loop(str(third_party), mapping=STATE_FEEDBACK_PORTS)
    run = loop_lyapunov_over_fmus(replace(loop, stop=STOP, step=STEP))
    expected = loop_lyapunov(Loop(equations_of_the_stranger(), stop=STOP))
    assert "controller: third-party FMU, probed by differences" in run.method
    assert share_of_allowed(run.exponents, expected.exponents) < 3.0
    assert np.all(run.error < 5e-3 * np.maximum(1.0, np.abs(run.exponents)))
    assert run.names == ["x", "v", "z", "i"]


@pytest.mark.ci
def test_a_plain_export_of_a_controller_with_a_state_is_probed(native):
    """Its state is followed in volts: the sum of all exponents stays, and so do the fast ones."""
    run = loop_lyapunov_over_fmus(Loop(str(native("pid", 3)), stop=STOP, step=STEP))
    expected = np.sort(loop_lyapunov(Loop("pid", stop=STOP)).exponents)[::-1]
    assert run.exponents.sum() == pytest.approx(expected.sum(), rel=1e-4)
    assert run.exponents[-1] == pytest.approx(expected[-1], rel=2e-3)
    assert "differ by a constant divided by the time" in run.method
    assert run.sum_rule_error() is None  # a third-party FMU tells no trace


@pytest.mark.prove
def test_without_equations_the_signals_tell_and_it_is_said_that_they_tell_no_more(native):
    loop = Loop("iol", str(write_variational_plant(native)))
    run = loop_lyapunov_over_fmus(replace(loop, stop=20.0, step=2e-3))
    assert run.motion.kind is Kind.LINE
    assert "the first tangent grows by" in run.motion.evidence
    assert run.motion.limit is None
    assert "finite-time only" in run.method
    early = loop_lyapunov_over_fmus(replace(loop, stop=0.5, step=2e-3))
    assert early.motion.kind is Kind.UNDECIDED
    assert not early.decided


def write_variational_plant(native):
    """A plant with tangents, as `export --native --variational` writes it."""
    path = native("plant").with_name("plant_variational.fmu")
    return (
        path
        if path.is_file()
        else write_native(catalogued_model("plant", tangents=5), path, 2).path
    )


@pytest.mark.ci
def test_what_cannot_be_followed_is_refused_with_what_is_missing(tmp_path, fmus):
    def refused(words, **loop):
        with pytest.raises(UserError, match=words):
            loop_lyapunov_over_fmus(Loop(**loop, stop=0.1, step=STEP))

    ports = {"mapping": STATE_FEEDBACK_PORTS}
    refused("cannot save", controller=str(state_feedback(tmp_path, "Forgets", False)), **ports)
    refused("no tangent ports", controller="pid", plant=str(fmus["plant"]))
    refused("cannot save", controller=str(proportional(tmp_path, "Stepped")))
    refused("modes", controller="pid", plant="plant_classical")


# -- what signals alone tell ---------------------------------------------------------------------


@dataclass
class Course:
    """A run with one output."""

    time: np.ndarray
    outputs: dict
    stopped: str = ""
    diverged: bool = False


T = np.linspace(0.0, 20.0, 20001)


def test_signals_tell_rest_and_cycles_and_nothing_else():
    for signal, kind in (
        (np.exp(-2.0 * T), Kind.REST),
        (0.08 + 0.0 * T, Kind.REST),
        (np.exp(-0.2 * T), Kind.UNDECIDED),  # still falling, and nothing says where to
        (np.sqrt(1.0 + T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.3 * np.cos(14.0 * T), Kind.CYCLE),
        (np.sin(7.0 * T) + 0.8 * np.sin(3.5 * T + 0.3), Kind.CYCLE),  # two returns
        (np.exp(-0.1 * T) * np.sin(7.0 * T), Kind.UNDECIDED),
        (np.sin(7.0 * T) + 0.5 * np.sin(7.0 * np.sqrt(2.0) * T), Kind.UNDECIDED),
    ):
        assert signal_motion(Course(T, {"x": signal}), {"x": 1.0}).kind is kind


def test_at_rest_the_first_tangent_tells_a_line_from_a_point():
    run = Course(T, {"x": np.exp(-2.0 * T)})
    for rate, kind in (
        (0.0, Kind.LINE),
        (-1.0, Kind.FIXED_POINT),
        (-0.02, Kind.REST),
        (0.5, Kind.UNDECIDED),
    ):
        assert signal_motion(run, {"x": 1.0}, rate * T).kind is kind


def test_a_run_that_ended_early_diverges_or_is_undecided():
    assert signal_motion(Course(T, {"x": T}, "x left", True), {"x": 1.0}).kind is Kind.DIVERGES
    assert signal_motion(Course(T, {"x": T}, "died"), {"x": 1.0}).kind is Kind.UNDECIDED


def steps(end, period):
    """It stands still but for a tenth of each period: it moves on, and back in the next."""
    time = np.linspace(0.0, end, 4001)
    ramp = np.clip((time % period) / (0.1 * period), 0.0, 1.0)
    odd = np.floor(time / period) % 2
    return Course(time, {"x": np.where(odd, 1.0 - ramp, ramp)})


@pytest.mark.parametrize("periods", [2.9, 1.95])
def test_signals_that_stood_as_long_before_and_moved_again_are_not_at_rest(periods):
    motion = signal_motion(steps(periods, 1.0), {"x": 1.0})
    assert motion.kind is Kind.UNDECIDED, motion.evidence

"""Modes under hosts of model exchange: round-off, careless stops and any tolerance do no harm.

``proofs/exchange.py`` runs 200 of these courses; here is a sample of the same seeds.
"""

import fmpy
import numpy as np
import pytest
import sympy as sp
from exchange_courses import COMPONENTS, cases, complaint, outcome
from exchange_host import ExchangeHost

from ballscrew.fmus.catalogue import NAMES, component
from ballscrew.fmus.native.export import export_native
from ballscrew.solver.component import (
    TIME,
    Component,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)

FS = 2.35  # N, breaks away


def test_every_component_of_the_catalogue_with_modes_and_states_has_courses():
    """A relay has no states, so there is nothing that round-off could move."""
    parts = {n: component(n) for n in NAMES}
    moded = {n for n, part in parts.items() if part.modes and part.all_states}
    assert moded <= set(COMPONENTS)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", COMPONENTS)
def test_courses_are_as_near_to_co_simulation_as_its_own_perturbed_ones(name, fmi, tmp_path):
    kernel, path = COMPONENTS[name].made(fmi, tmp_path)
    outcomes = [outcome(kernel, path, one) for one in cases(name, fmi, 5)]
    assert [c for c in map(complaint, outcomes) if c] == []
    assert sum(o.travel > 1e-6 for o in outcomes) >= 3  # they break away


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_body_breaks_away_whatever_round_off_the_solver_left_in_its_velocity(native, fmi):
    host = ExchangeHost(native("plant_classical", fmi), {}, 1e-6, np.random.default_rng(0))
    force = host.slope(0.0, np.zeros(3)).copy()  # stuck: there is no motion
    assert force.tolist() == [0.0, 0.0, 0.0]
    for current, left in ((0.011, 2.6e-25), (-0.011, 2.6e-25), (0.011, -2.6e-25)):
        host.put_states(0.0, np.array([0.0, left, current]))
        host.fmu.enterEventMode()
        host.update()
        assert host.get(["stuck"]) == [0.0]
        assert np.sign(host.slope(0.0, host.x)[1]) == np.sign(current)
        assert (host.z != 0.0).all()
        back = 1e-12 * np.sign(current)  # it stops
        host.put_states(0.0, np.array([0.0, -back, 0.0]))
        host.fmu.enterEventMode()
        host.update()
        assert host.get(["stuck", "v"]) == [1.0, 0.0]
        assert (host.z != 0.0).all()
    host.close()


def test_a_completed_step_asks_for_the_event_that_the_host_has_not_found(native):
    host = ExchangeHost(native("plant_classical"), {}, 1e-6, np.random.default_rng(0))
    host.put_states(0.0, np.array([0.0, 0.0, 0.009]))
    assert host.fmu.completedIntegratorStep()[0] == 0
    host.put_states(0.0, np.array([0.0, 0.0, 0.011]))
    assert host.fmu.completedIntegratorStep()[0] == 1
    host.close()


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """The axis with classical friction and a sine as its voltage, by version of FMI."""
    amplitude, frequency = symbol("amplitude"), symbol("frequency")
    own = (
        Parameter("amplitude", 1.0, "V", "amplitude", "the test"),
        Parameter("frequency", 1.0, "1/s", "frequency", "the test"),
    )
    axis = component("plant_classical")
    axis = axis.substituted(
        {symbol("u"): amplitude * sp.sin(2 * sp.pi * frequency * TIME)},
        name="driven",
        inputs=(),
        parameters=(*axis.parameters, *own),
    )
    folder = tmp_path_factory.mktemp("driven")
    return {fmi: export_native(axis, folder / f"{fmi}.fmu", fmi=fmi).path for fmi in (2, 3)}


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("amplitude", "frequency", "tolerance"), [(0.3, 0.7, 1e-6), (1.0, 3.1, 1e-5), (4.0, 3.1, 1e-6)]
)
def test_a_sine_under_cvode_never_sticks_above_the_break_away_force(
    driven, fmi, amplitude, frequency, tolerance
):
    """As fmpy's command line runs them; these three were off by all of their travel or half."""

    def run(kind, tolerance):
        return fmpy.simulate_fmu(
            str(driven[fmi]),
            fmi_type=kind,
            stop_time=1.5,
            output_interval=1e-3,
            relative_tolerance=tolerance,
            start_values={"amplitude": amplitude, "frequency": frequency},
            output=["x", "friction", "stuck"],
            record_events=False,
        )

    exact, course = run("CoSimulation", 1e-10), run("ModelExchange", tolerance)
    assert np.abs(course["friction"][course["stuck"] == 1.0]).max() <= FS * (1 + 1e-9)
    error = np.abs(course["x"] - np.interp(course["time"], exact["time"], exact["x"])).max()
    assert error <= 20 * tolerance * 1e-3 + 1e-3 * np.ptp(exact["x"])


def test_events_that_reset_or_watch_either_way_leave_no_indicator_at_zero(tmp_path):
    """A ball on a floor, and a switch: stopped exactly where both indicators are zero."""
    height, speed, side, w = (symbol(n) for n in ("height", "speed", "side", "w"))
    ball = Component(
        "watched_ball",
        "a ball and a switch",
        states=(
            State("height", "m", "height", speed, start=1.0),
            State("speed", "m/s", "speed", -9.81 + 0 * height, start=-1.0),
            State("side", "1", "side", 0 * side),
        ),
        inputs=(Input("w", "1", "watched", start=-1.0),),
        outputs=(Output("h", "m", "height", height), Output("s", "1", "side", side)),
        modes=(
            Mode(
                "flies",
                events=(
                    Event("bounce", height, -1, {"speed": -0.8 * speed}),
                    Event("switch", w, 0, {"side": side + 1}),
                ),
            ),
        ),
    )
    path = export_native(ball, tmp_path / "ball.fmu").path
    host = ExchangeHost(path, {}, 1e-6, np.random.default_rng(0))

    def event(states, values):
        host.put_states(host.time, np.array(states))
        host.jump(values)
        assert (host.z != 0.0).all()
        return host.x.tolist()

    assert event([-1e-12, -1.0, 0.0], {"w": 1e-12}) == [-1e-12, 0.8, 1.0]  # both, exactly there
    assert event([-1e-12, 0.8, 1.0], {"w": 1e-12}) == [-1e-12, 0.8, 1.0]  # and once only
    assert event([1e-3, 0.8, 1.0], {"w": 1e-3}) == [1e-3, 0.8, 1.0]  # leaving is no event
    assert event([1e-3, -0.8, 1.0], {"w": -1e-12}) == [1e-3, -0.8, 2.0]  # the switch goes back
    assert event([-1e-6, -1.0, 2.0], {"w": -1.0}) == [-1e-6, 0.8, 2.0]
    # it does not fall through the floor where it falls again before it was above
    assert event([-2e-6, -0.5, 2.0], {"w": -1.0}) == [-2e-6, 0.4, 2.0]
    host.close()

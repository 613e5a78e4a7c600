"""The servo that compensates friction: another solver, closed forms, and both at random."""

import math
from dataclasses import dataclass

import fmpy
import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ballscrew
from ballscrew.gallery.servo_compensation import findings as ours

RANDOM = settings(max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate])


@dataclass(frozen=True)
class Servo:
    """The gallery's servo, written anew; `model` is what is compensated of 0.1 N*m."""

    model: float
    damping: float
    at_rest: bool

    def force(self, x, v, direction):
        """Torque beside the friction: PD, and what is compensated."""
        return -x - self.damping * v + self.model * direction

    def stops(self, start, stop):
        """Time and angle of each stop, by DOP853 from one to the next; the last: where it rests."""
        time, x, found = 0.0, start, []
        while True:
            held = self.force(x, 0.0, -np.sign(x) if self.at_rest else 0.0)
            if abs(held) <= 0.1:
                return [*found, (time, x)], True
            direction = np.sign(held)

            def rates(_t, y, direction=direction):
                return [y[1], (self.force(*y, direction) - 0.1 * direction) / 0.01]

            def turns(_t, y):
                return y[1]

            turns.terminal, turns.direction = True, -direction
            first = (self.force(x, 0.0, direction) - 0.1 * direction) / 0.01
            short = 1e-7  # past the stop, whose event is this very one
            end = solve_ivp(
                rates,
                (time + short, stop),
                [x + first * short**2 / 2, first * short],
                "DOP853",
                rtol=1e-11,
                atol=1e-14,
                events=turns,
            )
            if end.status != 1:
                return found, False
            time, x = end.t[-1], end.y[0, -1]
            found.append((time, x))


@pytest.mark.parametrize("law", [ours.BY_VELOCITY, ours.BY_ERROR])
@pytest.mark.parametrize(
    ("model", "damping"), [(0.2, 0.06), (0.11, 0.02), (0.05, 0.02), (0.05, -0.02), (0.12, -0.02)]
)
def test_each_stop_is_that_of_another_solver(law, model, damping):
    theirs, rested = Servo(model, damping, law == ours.BY_ERROR).stops(0.3, 4.0)
    run = ours.motion(law, model, damping, 4.0, 5e-4)
    x, v = run.outputs["x"], run.outputs["v"]
    turns = np.flatnonzero(v[1:-1] * v[2:] < 0.0) + 1
    assert len(theirs) >= len(turns) >= 1
    for (time, angle), turn in zip(theirs, turns, strict=False):
        assert run.time[turn] == pytest.approx(time, abs=1e-3)
        # between two samples the angle moves by half of what the acceleration makes of one
        assert x[turn] == pytest.approx(angle, abs=5e-5 * max(1.0, abs(angle)))
    assert ours.rests(run) == rested
    if rested:
        assert x[-1] == pytest.approx(theirs[-1][1], rel=1e-7)


@pytest.mark.parametrize("damping", [*ours.DAMPED, -0.02])
def test_the_closed_form_of_a_stop_is_that_of_another_solver(damping):
    (time, after), (later, back) = Servo(0.2, damping, at_rest=True).stops(0.3, 2.0)[0][:2]
    q, centre = ours.decay(damping), (ours.TC - 0.2) / ours.K
    assert -after == pytest.approx(q * 0.3 - (1 + q) * centre, rel=1e-8)
    assert back == pytest.approx(-q * after - (1 + q) * centre, rel=1e-8)
    assert time == pytest.approx(0.5 * ours.period(damping), rel=1e-6)
    assert later == pytest.approx(ours.period(damping), rel=1e-6)


def test_the_errors_of_the_describing_function_go_as_the_square_of_the_damping_ratio():
    ratios, sizes, periods, thirds = np.array([0.05, 0.1, 0.2]), [], [], []
    for z in ratios:
        damping = 2.0 * math.sqrt(ours.K * ours.J) * z
        found = ours.cycle(ours.BY_ERROR, ours.FAR_OVER, damping)
        sizes.append(found.amplitude["plant_x"] / ours.sine(ours.TC - ours.FAR_OVER, damping) - 1)
        periods.append(found.period * ours.NATURAL / (2 * math.pi) - 1)
        thirds.append(ours.third(damping))
    for values, order in ((sizes, 2), (periods, 2), (thirds, 1)):
        assert np.polyfit(np.log(ratios), np.log(values), 1)[0] == pytest.approx(order, abs=0.1)
    # of the closed form: coth(y) = 1/y + y/3 - ..., y = pi z / (2 sqrt(1 - z^2))
    assert sizes[0] == pytest.approx((math.pi**2 / 12 - 1 / 2) * ratios[0] ** 2, rel=0.02)


def test_the_third_harmonic_of_the_describing_function_is_that_of_the_sign():
    damping = 0.06
    size = ours.sine(-ours.TC, damping)
    third = 4 * ours.TC / (3 * math.pi)
    stiffness = abs(ours.K - ours.J * (3 * ours.NATURAL) ** 2 + 3j * ours.NATURAL * damping)
    assert ours.third(damping) == pytest.approx(third / stiffness / size, rel=1e-12)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_another_solver_diverges_outside_the_unstable_cycle_and_rests_within(share):
    damping = -0.02
    servo = Servo(ours.UNDER, damping, at_rest=False)
    stops, rested = servo.stops(share * ours.radius(damping), 10.0)
    assert rested == (share < 1.0)
    if not rested:
        assert abs(stops[-1][1]) > 1.0


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_another_solver_swings_from_the_same_over_compensation_on(share):
    servo = Servo(ours.TC + share * ours.swings_from(0.02), 0.02, at_rest=False)
    assert servo.stops(0.3, 15.0)[1] == (share < 1.0)


@pytest.mark.parametrize("law", [ours.BY_VELOCITY, ours.BY_ERROR])
def test_with_heavy_damping_it_creeps_beyond_the_goal_and_does_not_swing(law):
    found = ours.cycle(law, ours.OVER, ours.HEAVY)
    assert found.kind.value == "isolated fixed point"
    assert found.equilibrium.state == pytest.approx([ours.TC - ours.OVER, 0.0], abs=1e-9)
    rates = np.roots([ours.J, ours.HEAVY, ours.K])
    assert found.limit == pytest.approx(sorted(rates, reverse=True), rel=1e-6)


@pytest.mark.parametrize("law", [ours.BY_VELOCITY, ours.BY_ERROR])
def test_the_map_has_all_three_outcomes_and_each_where_theory_has_it(law):
    _, _, kinds, swings = ours.cells(law)
    assert set(kinds) == {0, 1, 2}
    assert ours.differing(law) == 0
    mismatch, damping, *_ = ours.cells(law)
    sizes = [ours.swing(*cell) for cell in zip(mismatch, damping, strict=True)]
    cycles = kinds == 1
    # the least damped ones are still growing when the time of a cell ends
    assert swings[cycles] == pytest.approx(np.array(sizes)[cycles], rel=0.05)


def test_what_is_compensated_at_rest_decides_on_a_slight_over_compensation():
    still = ours.cycle(ours.BY_VELOCITY, 0.103, ours.KD)
    swings = ours.cycle(ours.BY_ERROR, 0.103, ours.KD)
    assert still.kind.value == "stuck on a line of equilibria"
    assert swings.kind.value == "limit cycle"
    assert swings.amplitude["plant_x"] == pytest.approx(ours.swing(-0.003, ours.KD), rel=1e-5)


@pytest.mark.parametrize("step", [3e-3, 7e-3])
def test_over_fmus_each_half_period_is_a_whole_number_of_steps(step):
    result = ballscrew.run(
        ours.BY_VELOCITY,
        ours.SERVO,
        reference=0.0,
        stop=7.0,
        step=step,
        controller_values={"Tc_hat": ours.FAR_OVER, "Kd": ours.DAMPED[1]},
    )
    exact = ours.period(ours.DAMPED[1])
    rounded = 2.0 * step * math.ceil(0.5 * exact / step)
    time, x = result.run.time, result.run.outputs["x"]
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    passes = time[up] - x[up] * step / (x[up + 1] - x[up])
    assert np.diff(passes)[-3:] == pytest.approx(rounded, rel=1e-4)
    assert not result.trusted


def test_as_one_fmu_the_loop_has_the_cycle_of_the_closed_form(tmp_path):
    loop = ballscrew.connect(ballscrew.component(ours.SERVO), ballscrew.component(ours.BY_VELOCITY))
    fmu = ballscrew.export(loop, tmp_path / "loop.fmu", native=True)
    gains = {"controller_Tc_hat": ours.FAR_OVER, "controller_Kd": ours.DAMPED[1], "x_d": 0.0}
    step = 7e-3
    found = fmpy.simulate_fmu(
        str(fmu), stop_time=8.0, step_size=step, output_interval=step, start_values=gains
    )
    time, x = found["time"], found["x"]
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    passes = time[up] - x[up] * step / (x[up + 1] - x[up])
    assert np.diff(passes)[-4:].mean() == pytest.approx(ours.period(ours.DAMPED[1]), rel=1e-3)
    assert np.abs(x[time > 6.0]).max() == pytest.approx(
        ours.swing(-ours.TC, ours.DAMPED[1]), rel=1e-3
    )


masses, springs = st.floats(1e-3, 0.1), st.floats(0.2, 5.0)
amplifiers = st.floats(0.5, 4.0)


def drawn_loop(law, j, kp, kamp, z, coulomb, mismatch, start):
    """A loop by its damping ratio; the friction is dry alone, and a negative one is by b_hat."""
    kt = 0.5
    damping = 2.0 * z * math.sqrt(kamp * kt * kp * j)
    return ballscrew.lyapunov(
        law,
        ours.SERVO,
        stop=30.0 * 2.0 * math.pi * math.sqrt(j / (kamp * kt * kp)) + 12.0 * j / abs(damping),
        reference=0.0,
        plant_values={
            **{"J": j, "Kamp": kamp, "KT": kt, "Fc": coulomb, "Fs": coulomb, "sigma2": 0.0},
            "x_start": start,
        },
        controller_values={
            **{"Kp": kp, "Kd": max(damping, 0.0) / (kamp * kt), "b_hat": -min(damping, 0.0)},
            **{"Tc_hat": coulomb - mismatch, "Kamp_hat": kamp, "KT_hat": kt},
        },
    ).motion


@RANDOM
@given(
    j=masses,
    kp=springs,
    kamp=amplifiers,
    z=st.floats(0.05, 0.8),
    coulomb=st.floats(0.02, 0.5),
    share=st.floats(-1.5, -0.05),
    away=st.floats(0.3, 3.0),
)
def test_theorem_compensated_at_rest_every_over_compensation_swings_as_the_closed_form(
    j, kp, kamp, z, coulomb, share, away
):
    q = math.exp(-math.pi * z / math.sqrt(1 - z * z))
    size = -share * coulomb / (kamp * 0.5 * kp) * (1 + q) / (1 - q)
    natural = math.sqrt(kamp * 0.5 * kp / j)
    found = drawn_loop(ours.BY_ERROR, j, kp, kamp, z, coulomb, share * coulomb, away * size)
    assert found.kind.value == "limit cycle"
    assert found.amplitude["plant_x"] == pytest.approx(size, rel=1e-3)
    assert found.period == pytest.approx(2 * math.pi / natural / math.sqrt(1 - z * z), rel=1e-5)
    assert found.limit == pytest.approx([0.0, -z * natural], abs=5e-3 * z * natural)


@RANDOM
@given(
    at_rest=st.booleans(),
    j=masses,
    kp=springs,
    kamp=amplifiers,
    z=st.one_of(st.floats(0.05, 0.8), st.floats(-0.5, -0.05)),
    coulomb=st.floats(0.02, 0.5),
    share=st.one_of(st.floats(-1.5, -0.05), st.floats(0.05, 0.95)),
    away=st.floats(0.1, 20.0),
)
def test_theorem_the_stops_in_closed_form_tell_what_becomes_of_every_start(
    at_rest, j, kp, kamp, z, coulomb, share, away
):
    """All three outcomes, in units of Tc / k; not beside a border, where round-off decides."""
    q = math.exp(-math.pi * z / math.sqrt(1 - z * z))
    band = max(share, 0.0) if at_rest else 1.0
    size = abs(share * (1 + q) / (1 - q))
    assume(abs(size / 1.0 - 1.0) > 0.02)
    if share * z < 0.0:
        assume(abs(away / size - 1.0) > 0.02)
    angle, expected = away, "limit cycle"
    for _ in range(2000):
        assume(abs(angle - band) > 1e-3)
        if angle <= band:
            expected = "stuck on a line of equilibria"
            break
        if angle > 1e6:
            expected = "diverges"
            break
        angle = q * angle - (1 + q) * share
    law = ours.BY_ERROR if at_rest else ours.BY_VELOCITY
    start = away * coulomb / (kamp * 0.5 * kp)
    found = drawn_loop(law, j, kp, kamp, z, coulomb, share * coulomb, start)
    assert found.kind.value == expected

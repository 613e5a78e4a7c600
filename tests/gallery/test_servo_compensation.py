"""The servo that compensates friction: another solver, closed forms, and both at random."""

import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

import ballscrew
from ballscrew.gallery.servo_compensation import findings as ours

RANDOM = settings(max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate])


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


@pytest.mark.ci
@pytest.mark.parametrize("law", [ours.BY_VELOCITY, ours.BY_ERROR])
def test_with_heavy_damping_it_creeps_beyond_the_goal_and_does_not_swing(law):
    found = ours.cycle(law, ours.OVER, ours.HEAVY)
    assert found.kind.value == "isolated fixed point"
    assert found.equilibrium.state == pytest.approx([ours.TC - ours.OVER, 0.0], abs=1e-9)
    rates = np.roots([ours.J, ours.HEAVY, ours.K])
    assert found.limit == pytest.approx(sorted(rates, reverse=True), rel=1e-6)


@pytest.mark.ci
@pytest.mark.parametrize("law", [ours.BY_VELOCITY])
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


@pytest.mark.ci
@pytest.mark.parametrize("step", [7e-3])
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


@pytest.mark.ci
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


@pytest.mark.ci
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

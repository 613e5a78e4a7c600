"""The servo that compensates friction: closed forms at random."""

import math

import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

import ballscrew
from ballscrew.gallery.servo_compensation import findings as ours

RANDOM = settings(max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate])


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

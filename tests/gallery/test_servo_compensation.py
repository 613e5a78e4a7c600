"""The servo that compensates friction: closed forms at random."""

import math

import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

import ballscrew
from ballscrew.gallery.servo_compensation import findings as ours

KT = 0.5


@pytest.mark.ci
@settings(max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    at_rest=st.booleans(),
    j=st.floats(1e-3, 0.1),
    kp=st.floats(0.2, 5.0),
    kamp=st.floats(0.5, 4.0),
    z=st.one_of(st.floats(0.05, 0.8), st.floats(-0.5, -0.05)),
    coulomb=st.floats(0.02, 0.5),
    share=st.one_of(st.floats(-1.5, -0.05), st.floats(0.05, 0.95)),
    away=st.floats(0.1, 20.0),
)
def test_theorem_the_stops_in_closed_form_tell_what_becomes_of_every_start(
    at_rest, j, kp, kamp, z, coulomb, share, away
):
    """All three outcomes, in units of Tc / k; not beside a border, where round-off decides.

    The friction is dry alone, and a negative damping is by b_hat.
    """
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
    stiffness = kamp * KT * kp
    natural, unit = math.sqrt(stiffness / j), coulomb / stiffness
    damping = 2.0 * z * math.sqrt(stiffness * j)
    plant = {"J": j, "Kamp": kamp, "KT": KT, "Fc": coulomb, "Fs": coulomb, "sigma2": 0.0}
    own = {"Kp": kp, "Kd": max(damping, 0.0) / (kamp * KT), "b_hat": -min(damping, 0.0)}
    own |= {"Tc_hat": coulomb - share * coulomb, "Kamp_hat": kamp, "KT_hat": KT}
    found = ballscrew.lyapunov(
        ours.BY_ERROR if at_rest else ours.BY_VELOCITY,
        ours.SERVO,
        stop=30.0 * 2.0 * math.pi / natural + 12.0 * j / abs(damping),
        reference=0.0,
        plant_values={**plant, "x_start": away * unit},
        controller_values=own,
    ).motion
    assert found.kind.value == expected
    if expected == "limit cycle":
        assert found.amplitude["plant_x"] == pytest.approx(size * unit, rel=1e-3)
        assert found.period == pytest.approx(2 * math.pi / natural / math.sqrt(1 - z * z), rel=1e-5)
        assert found.limit == pytest.approx([0.0, -z * natural], abs=5e-3 * z * natural)

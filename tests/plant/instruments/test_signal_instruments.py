"""Position encoder, velocity estimate and current sensor against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.plant.instruments.current_sensor import current_sensor
from ballscrew.plant.instruments.encoder import position_encoder
from ballscrew.plant.instruments.velocity_estimate import velocity_estimate
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model

PERIOD = 1e-3
ENCODER, VELOCITY, CURRENT = map(
    generate, (position_encoder(), velocity_estimate(), current_sensor())
)
FAITHFUL = {"first_harmonic": 0.0, "second_harmonic": 0.0}
SILENT = {"offset": 0.0, "gain_error": 0.0, "deviation": 0.0}


def course(kernel, signal, values=None):
    """The output after each sample of the input."""
    model = Model(kernel, values)
    (given,), (output,) = kernel.inputs, kernel.outputs
    read = np.empty(len(signal))
    for k, value in enumerate(signal):
        model.set_input(given.name, value)
        if kernel.discrete:
            model.sample(k * PERIOD)
        read[k] = model.outputs(k * PERIOD, model.x)[output.name]
    return read


# the encoder


@settings(max_examples=40, deadline=None)
@given(x=st.floats(-0.5, 0.5), resolution=st.floats(1e-9, 1e-3), phase=st.floats(0.0, 0.999))
def test_the_encoder_gives_whole_steps_less_than_one_from_the_position(x, resolution, phase):
    (read,) = course(ENCODER, [x], FAITHFUL | {"resolution": resolution, "phase": phase})
    assert read / resolution == pytest.approx(round(read / resolution), abs=1e-6)
    digits = 1e-6 * resolution + 4 * np.finfo(float).eps * abs(x)
    assert (phase - 1) * resolution - digits <= read - x <= phase * resolution + digits
    (zero,) = course(ENCODER, [0.0], FAITHFUL | {"resolution": resolution, "phase": phase})
    assert zero == 0.0


def test_the_encoder_s_error_has_the_harmonics_that_are_stated_and_no_others():
    periods, count = 5, 1000
    amplitudes = {"first_harmonic": 0.15e-6, "second_harmonic": 0.04e-6}
    values = amplitudes | {"first_phase": 0.3, "second_phase": -1.0, "resolution": 1e-13}
    x = np.arange(count) * periods * 20e-6 / count
    spectrum = 2 * np.fft.rfft(course(ENCODER, x, values) - x) / count
    expected = np.zeros(len(spectrum), dtype=complex)
    expected[periods] = 0.15e-6 * np.exp(1j * (0.3 - np.pi / 2))
    expected[2 * periods] = 0.04e-6 * np.exp(1j * (-1.0 - np.pi / 2))
    np.testing.assert_allclose(spectrum[1:], expected[1:], atol=1e-13)


# the velocity


def test_the_difference_of_a_parabola_is_the_speed_half_a_period_ago():
    t = np.arange(200) * PERIOD
    speed = course(VELOCITY, 0.3 + 0.02 * t + 1.7 * t**2 / 2)
    assert speed[0] == 0.0  # no position before it
    np.testing.assert_allclose(speed[1:], 0.02 + 1.7 * (t[1:] - PERIOD / 2), rtol=1e-9)


def test_the_filter_answers_a_step_as_the_continuous_one_at_its_samples():
    t = np.arange(1, 400) * PERIOD
    filtered = course(VELOCITY, np.append(0.0, 0.05 * t), {"cutoff": 12.0})[1:]
    np.testing.assert_allclose(filtered, 0.05 * (1 - np.exp(-2 * np.pi * 12.0 * t)), rtol=1e-9)


# the current sensor


def test_the_sensor_has_offset_and_gain_error_to_half_a_step():
    i = np.linspace(-2, 2, 401)
    read = course(CURRENT, i, {"deviation": 0.0, "offset": 0.02, "gain_error": -0.03})
    assert np.abs(read - (0.97 * i + 0.02)).max() <= 0.5 * 4 / 4096 * (1 + 1e-9)
    fine = course(CURRENT, i, SILENT | {"step": 1e-9})
    np.testing.assert_allclose(fine, i, atol=0.5e-9 * (1 + 1e-6))


def test_the_sensor_s_noise_has_the_deviation_that_is_stated_with_the_converter_s_beside_it():
    count, step, deviation = 4000, 4 / 4096, 2e-3
    read = course(CURRENT, np.full(count, 0.3), SILENT | {"deviation": deviation})
    expected = deviation**2 + step**2 / 12  # Sheppard's, as the noise is wider than a step
    assert read.var() == pytest.approx(expected, rel=4 * np.sqrt(2 / count))
    assert read.mean() == pytest.approx(0.3, abs=4 * np.sqrt(expected / count))

"""Instruments against closed forms: steps, ranges, lags, errors and noise are those stated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.plant.instruments.acquisition import (
    SAMPLE_TIME,
    acquisition,
    filter_lag,
    load_cell,
    low_pass,
)
from ballscrew.plant.instruments.capacitance_sensor import CONVERSION_SAMPLES, capacitance_sensor
from ballscrew.plant.instruments.current_sensor import current_sensor
from ballscrew.plant.instruments.encoder import encoder, position_encoder
from ballscrew.plant.instruments.noise import MODULI, MULTIPLIERS, SEED, SPREAD, white_noise
from ballscrew.plant.instruments.velocity_estimate import velocity_estimate
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Parameter, State, symbol
from ballscrew.solver.for_tangents import dithered_average, with_held_states
from ballscrew.solver.functions import slopes
from ballscrew.solver.kernel import Model

PERIOD = 1e-3
ENCODER, VELOCITY, CURRENT = map(
    generate, (position_encoder(), velocity_estimate(), current_sensor())
)
FAITHFUL = {"first_harmonic": 0.0, "second_harmonic": 0.0}
SILENT = {"offset": 0.0, "gain_error": 0.0, "deviation": 0.0}


def read(kernel, values=None, **signals):
    """The first output of a component that is sampled once at each of the inputs' values."""
    model = Model(kernel, values)
    rows = []
    for k in range(len(next(iter(signals.values())))):
        for name, values in signals.items():
            model.set_input(name, values[k])
        if kernel.discrete:
            model.sample(k * model.sample_time)
        rows.append(model.outputs(k * PERIOD, model.x)[kernel.outputs[0].name])
    return np.array(rows)


def test_the_encoder_counts_512_to_the_millimetre():
    x = np.linspace(-2e-3, 2e-3, 40_001)
    counted = read(generate(encoder()), x=x)
    counts = counted * 512_000
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert set(np.unique(np.round(np.diff(counts)))) == {0.0, 1.0}
    assert np.abs(counted - x).max() <= 0.5 / 512_000 * (1 + 1e-9)
    assert round(counts[-1] - counts[0]) == 4 * 512


def test_the_load_cell_gives_whole_steps_of_89_millinewtons_within_44_5_newtons():
    force = np.linspace(-60, 60, 20_001)
    found = read(generate(load_cell()), force=force, noise=np.zeros_like(force))
    steps = found / 0.089
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(found - force)[np.abs(force) < 44.5].max() <= 0.0445 * (1 + 1e-9)
    assert found.max() == 44.5
    assert found.min() == -44.5
    assert len(np.unique(np.round(steps))) == 1001


def test_the_acquisition_holds_what_it_sampled_until_it_samples_again():
    model = Model(generate(acquisition()))
    for k in range(5):
        model.set_input("force_read", 1.0 + k)
        model.set_input("x_counted", -1.0 - k)
        model.sample(k * SAMPLE_TIME)
        model.set_input("force_read", 100.0)
        model.set_input("x_counted", 100.0)
        for share in (0.0, 0.5, 0.99):
            held = model.outputs((k + share) * SAMPLE_TIME, model.x)
            assert held == {"force": 1.0 + k, "x": -1.0 - k}
    assert model.sample_time == 1 / 200


@pytest.mark.parametrize("cutoff", [5.0, 60.0])
def test_the_filter_lags_a_ramp_by_what_is_stated(cutoff):
    ramp = 3.0 * np.arange(1000) * SAMPLE_TIME
    kernel = generate(low_pass("f", "N", "force", cutoff, "test"))
    behind = (ramp - read(kernel, signal=ramp)) / 3.0
    assert behind[-1] == pytest.approx(filter_lag(cutoff), rel=1e-9)


@pytest.mark.parametrize("cutoff", [5.0, 60.0])
def test_the_filter_loses_three_decibels_at_its_cutoff_and_none_at_rest(cutoff):
    t = np.arange(4000) * SAMPLE_TIME
    kernel = generate(low_pass("f", "N", "force", cutoff, "test"))
    assert read(kernel, signal=np.ones(2000))[-1] == pytest.approx(1, rel=1e-12)
    wave = np.exp(2j * math.pi * cutoff * t)
    parts = [read(kernel, signal=part) for part in (wave.real, wave.imag)]
    np.testing.assert_allclose(np.abs(parts[0] + 1j * parts[1])[2000:], 0.5**0.5, rtol=1e-9)


def plates(x):
    separation = 150e-6
    at_rest = 8.854e-12 * 1e-4 / separation
    starts = {
        "count_start": CONVERSION_SAMPLES - 1,
        "total_start": (CONVERSION_SAMPLES - 1) * at_rest,
    }
    found = read(generate(capacitance_sensor()), starts, x=x, noise=np.zeros_like(x))
    return found, 8.854e-12 * 1e-4 / found - separation


def test_the_capacitance_follows_the_plates_distance_in_steps_of_the_converter():
    for x in (0.0, 10e-6, 70e-6):
        found, displacement = plates(np.full(3 * CONVERSION_SAMPLES, x))
        step = 2 * 8.192e-12 / 2**24
        assert found[-1] / step == pytest.approx(round(found[-1] / step), abs=1e-6)
        assert found[-1] == pytest.approx(8.854e-12 * 1e-4 / (150e-6 + x), abs=step / 2)
        # Eq. 2.2: a step of the converter is this much displacement
        assert abs(displacement[-1] - x) <= step * (150e-6 + x) ** 2 / (8.854e-12 * 1e-4)


def test_the_capacitance_sensor_lags_by_what_is_stated():
    speed = 7.5e-6
    x = speed * np.arange(40 * CONVERSION_SAMPLES) * SAMPLE_TIME
    _, displacement = plates(x)
    cycles = (x - displacement)[10 * CONVERSION_SAMPLES + 0 : 30 * CONVERSION_SAMPLES]
    assert cycles.mean() / speed == pytest.approx((CONVERSION_SAMPLES - 1) * SAMPLE_TIME, rel=1e-3)
    assert set(np.diff(np.flatnonzero(np.diff(displacement)))) == {CONVERSION_SAMPLES}


# the encoder


@settings(max_examples=40, deadline=None)
@given(x=st.floats(-0.5, 0.5), resolution=st.floats(1e-9, 1e-3), phase=st.floats(0.0, 0.999))
def test_the_encoder_gives_whole_steps_less_than_one_from_the_position(x, resolution, phase):
    values = FAITHFUL | {"resolution": resolution, "phase": phase}
    (found,) = read(ENCODER, values, x=[x])
    assert found / resolution == pytest.approx(round(found / resolution), abs=1e-6)
    digits = 1e-6 * resolution + 4 * np.finfo(float).eps * abs(x)
    assert (phase - 1) * resolution - digits <= found - x <= phase * resolution + digits
    (zero,) = read(ENCODER, values, x=[0.0])
    assert zero == 0.0


def test_the_encoder_s_error_has_the_harmonics_that_are_stated_and_no_others():
    periods, count = 5, 1000
    amplitudes = {"first_harmonic": 0.15e-6, "second_harmonic": 0.04e-6}
    values = amplitudes | {"first_phase": 0.3, "second_phase": -1.0, "resolution": 1e-13}
    x = np.arange(count) * periods * 20e-6 / count
    spectrum = 2 * np.fft.rfft(read(ENCODER, values, x=x) - x) / count
    expected = np.zeros(len(spectrum), dtype=complex)
    expected[periods] = 0.15e-6 * np.exp(1j * (0.3 - np.pi / 2))
    expected[2 * periods] = 0.04e-6 * np.exp(1j * (-1.0 - np.pi / 2))
    np.testing.assert_allclose(spectrum[1:], expected[1:], atol=1e-13)


# the velocity


def test_the_difference_of_a_parabola_is_the_speed_half_a_period_ago():
    t = np.arange(200) * PERIOD
    speed = read(VELOCITY, x=0.3 + 0.02 * t + 1.7 * t**2 / 2)
    assert speed[0] == 0.0  # no position before it
    np.testing.assert_allclose(speed[1:], 0.02 + 1.7 * (t[1:] - PERIOD / 2), rtol=1e-9)


def test_the_filter_answers_a_step_as_the_continuous_one_at_its_samples():
    t = np.arange(1, 400) * PERIOD
    filtered = read(VELOCITY, {"cutoff": 12.0}, x=np.append(0.0, 0.05 * t))[1:]
    np.testing.assert_allclose(filtered, 0.05 * (1 - np.exp(-2 * np.pi * 12.0 * t)), rtol=1e-9)


# the current sensor


def test_the_sensor_has_offset_and_gain_error_to_half_a_step():
    i = np.linspace(-2, 2, 401)
    found = read(CURRENT, {"deviation": 0.0, "offset": 0.02, "gain_error": -0.03}, i=i)
    assert np.abs(found - (0.97 * i + 0.02)).max() <= 0.5 * 4 / 4096 * (1 + 1e-9)
    fine = read(CURRENT, SILENT | {"step": 1e-9}, i=i)
    np.testing.assert_allclose(fine, i, atol=0.5e-9 * (1 + 1e-6))


def test_the_sensor_s_noise_has_the_deviation_that_is_stated_with_the_converter_s_beside_it():
    count, step, deviation = 4000, 4 / 4096, 2e-3
    found = read(CURRENT, SILENT | {"deviation": deviation}, i=np.full(count, 0.3))
    expected = deviation**2 + step**2 / 12  # Sheppard's, as the noise is wider than a step
    assert found.var() == pytest.approx(expected, rel=4 * np.sqrt(2 / count))
    assert found.mean() == pytest.approx(0.3, abs=4 * np.sqrt(expected / count))


# noise

NOISY = Component(
    name="noisy",
    description="A lag with noise.",
    parameters=(SEED,),
    states=(State("x", "1", "state", symbol("noise") - symbol("x")),),
    discrete=white_noise(),
    sample_time=Parameter("sample_time", 1e-3, "s", "sampling period", "test", minimum=1e-6),
)


def whole_numbers(seed: int):
    """L'Ecuyer's generator in whole numbers: its states, and its numbers from 1 to m1 - 1."""
    states = [1 + seed * s % (m - 1) for s, m in zip(SPREAD, MODULI, strict=True)]
    while True:
        states = [a * s % m for a, s, m in zip(MULTIPLIERS, states, MODULI, strict=True)]
        z = states[0] - states[1]
        yield list(states), z if z >= 1 else z + MODULI[0] - 1


@pytest.mark.parametrize("seed", [1, 2**31])
def test_it_is_l_ecuyer_s_generator_to_the_last_digit(seed):
    oracle, model = whole_numbers(seed), Model(generate(NOISY), {"seed": seed})
    for k in range(200):
        model.sample(k * 1e-3)
        (_, first), (states, second) = next(oracle), next(oracle)
        assert model.u[:2].tolist() == states
        radius = math.sqrt(-2 * math.log(first / MODULI[0]))
        value = radius * math.cos(2 * math.pi * second / MODULI[0])
        assert model.u[2] == pytest.approx(value, rel=1e-12, abs=1e-12)


def test_tangents_see_noise_as_given_from_outside():
    """A loop's exponents are its own, not the generator's, averaged quantizers or not."""
    assert dithered_average(NOISY) is NOISY
    update = [d.update for d in NOISY.discrete]
    held = with_held_states(NOISY)
    assert [e.reset[d.name] for e in held.modes[0].events for d in NOISY.discrete] == update
    by = [symbol(d.name) for d in NOISY.discrete]
    assert all(entry == 0 for entry in slopes(update, by))

"""The rig's instruments: their steps, ranges and lags are the ones that are stated."""

import math

import numpy as np
import pytest

from ballscrew.plant.instruments.acquisition import (
    SAMPLE_TIME,
    acquisition,
    filter_lag,
    load_cell,
    low_pass,
)
from ballscrew.plant.instruments.capacitance_sensor import CONVERSION_SAMPLES, capacitance_sensor
from ballscrew.plant.instruments.encoder import encoder
from ballscrew.solver.codegen import generate
from ballscrew.solver.kernel import Model


def course(component, values=None, **signals):
    """Outputs of a component that is sampled once at each of the inputs' values."""
    model = Model(generate(component), values)
    rows = []
    for k in range(len(next(iter(signals.values())))):
        for name, values in signals.items():
            model.set_input(name, values[k])
        if model.kernel.discrete:
            model.sample(k * SAMPLE_TIME)
        rows.append(model.outputs(k * SAMPLE_TIME, model.x))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_the_encoder_counts_512_to_the_millimetre():
    x = np.linspace(-2e-3, 2e-3, 40_001)
    read = course(encoder(), x=x)["x_counted"]
    counts = read * 512_000
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert set(np.unique(np.round(np.diff(counts)))) == {0.0, 1.0}
    assert np.abs(read - x).max() <= 0.5 / 512_000 * (1 + 1e-9)
    assert round(counts[-1] - counts[0]) == 4 * 512


def test_the_encoder_is_zero_where_it_was_turned_on():
    for phase in (0.0, 0.3, 0.999):
        assert course(encoder(), {"phase": phase}, x=[0.0])["x_counted"][0] == 0.0


def test_the_load_cell_gives_whole_steps_of_89_millinewtons_within_44_5_newtons():
    force = np.linspace(-60, 60, 20_001)
    read = course(load_cell(), force=force, noise=np.zeros_like(force))["force_read"]
    steps = read / 0.089
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    within = np.abs(force) < 44.5
    assert np.abs(read - force)[within].max() <= 0.0445 * (1 + 1e-9)
    assert read.max() == 44.5
    assert read.min() == -44.5
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
    component = low_pass("f", "N", "force", cutoff, "test")
    behind = (ramp - course(component, signal=ramp)["filtered"]) / 3.0
    assert behind[-1] == pytest.approx(filter_lag(cutoff), rel=1e-9)


@pytest.mark.parametrize("cutoff", [5.0, 60.0])
def test_the_filter_loses_three_decibels_at_its_cutoff_and_none_at_rest(cutoff):
    t = np.arange(4000) * SAMPLE_TIME
    component = low_pass("f", "N", "force", cutoff, "test")
    assert course(component, signal=np.ones(2000))["filtered"][-1] == pytest.approx(1, rel=1e-12)
    wave = np.exp(2j * math.pi * cutoff * t)
    parts = [course(component, signal=part)["filtered"] for part in (wave.real, wave.imag)]
    late = np.abs(parts[0] + 1j * parts[1])[2000:]
    np.testing.assert_allclose(late, 0.5**0.5, rtol=1e-9)


def plates(x, values=None, noise=None):
    separation = 150e-6
    at_rest = 8.854e-12 * 1e-4 / separation
    starts = {
        "count_start": CONVERSION_SAMPLES - 1,
        "total_start": (CONVERSION_SAMPLES - 1) * at_rest,
    }
    noise = np.zeros_like(x) if noise is None else noise
    found = course(capacitance_sensor(), starts | (values or {}), x=np.asarray(x), noise=noise)[
        "capacitance"
    ]
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
    changes = np.flatnonzero(np.diff(displacement))
    assert set(np.diff(changes)) == {CONVERSION_SAMPLES}

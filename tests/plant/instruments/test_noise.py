"""The noise of an instrument: L'Ecuyer's generator to the digit, normal, white, by its seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.plant.instruments.noise import MODULI, MULTIPLIERS, SEED, SPREAD, white_noise
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import Component, Output, Parameter, State, symbol
from ballscrew.solver.for_tangents import dithered_average, with_held_states
from ballscrew.solver.kernel import Model

PERIOD = Parameter("sample_time", 1e-3, "s", "sampling period", "test", minimum=1e-6)
SOURCE = Component(
    name="noise_source",
    description="Noise alone.",
    parameters=(SEED,),
    outputs=(Output("noise", "1", "noise", symbol("noise")),),
    discrete=white_noise(),
    sample_time=PERIOD,
)
KERNEL = generate(SOURCE)


def drawn(seed: float, count: int) -> np.ndarray:
    """Memory and value after each sample."""
    model = Model(KERNEL, {"seed": seed})
    rows = np.empty((count, 3))
    for k in range(count):
        model.sample(k * 1e-3)
        rows[k] = model.u
    return rows


def whole_numbers(seed: int):
    """L'Ecuyer's generator in whole numbers: its states, and its numbers from 1 to m1 - 1."""
    states = [1 + seed * s % (m - 1) for s, m in zip(SPREAD, MODULI, strict=True)]
    while True:
        states = [a * s % m for a, s, m in zip(MULTIPLIERS, states, MODULI, strict=True)]
        z = states[0] - states[1]
        yield list(states), z if z >= 1 else z + MODULI[0] - 1


@pytest.mark.parametrize("seed", [1, 2**31])
def test_it_is_l_ecuyer_s_generator_to_the_last_digit(seed):
    oracle = whole_numbers(seed)
    for row in drawn(seed, 200):
        (_, first), (states, second) = next(oracle), next(oracle)
        assert row[:2].tolist() == states
        radius = math.sqrt(-2 * math.log(first / MODULI[0]))
        value = radius * math.cos(2 * math.pi * second / MODULI[0])
        assert row[2] == pytest.approx(value, rel=1e-12, abs=1e-12)


def test_tangents_see_noise_as_given_from_outside():
    """A loop's exponents are its own, not the generator's, averaged quantizers or not."""
    noisy = Component(
        name="noisy",
        description="A lag with noise.",
        parameters=(SEED,),
        states=(State("x", "1", "state", symbol("noise") - symbol("x")),),
        discrete=white_noise(),
        sample_time=PERIOD,
    )
    assert dithered_average(noisy) is noisy
    update = [d.update for d in noisy.discrete]
    held = with_held_states(noisy)
    assert [e.reset[d.name] for e in held.modes[0].events for d in noisy.discrete] == update
    from ballscrew.solver.functions import slopes

    by = [symbol(d.name) for d in noisy.discrete]
    assert all(entry == 0 for entry in slopes(update, by))

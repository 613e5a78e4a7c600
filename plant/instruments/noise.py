"""Noise from a seed: the generator is part of the component, so every tool gets the same numbers.

The generator is the combined linear congruential one of P. L'Ecuyer, "Efficient and portable
combined random number generators", Communications of the ACM 31, 742 (1988). Its period is about
2.3e18. All its products stay below 2^53, so that doubles hold them exactly. G. E. P. Box and M. E.
Muller's method turns them into normal numbers (Annals of Mathematical Statistics 29, 610 (1958)).
"""

from __future__ import annotations

import sympy as sp

from ...solver.component import DiscreteState, Parameter, symbol

MODULI = (2147483563, 2147483399)
MULTIPLIERS = (40014, 40692)
SPREAD = (2021657, 1487629)
"""Factor of a seed, so that consecutive seeds begin far apart."""

_ANY = "any will do; give two instruments two numbers"
SEED = Parameter("seed", 1.0, "1", "which noise: a whole number", _ANY, 1.0, 2.0**31)


def white_noise() -> tuple[DiscreteState, ...]:
    """Standard normal noise `noise`, new at every sample instant, with its generator's states.

    Needs the parameter `SEED`. The generator's states are whole numbers; zero means that it has
    not started. They pass through `floor`, which does not change whole numbers but has the
    derivative zero: for tangents the noise is an external signal.
    """
    seed = symbol("seed")
    first, second = [], []
    for k, (modulus, factor, spread) in enumerate(zip(MODULI, MULTIPLIERS, SPREAD, strict=True)):
        kept = symbol(_memory(k))
        begin = 1 + sp.floor(sp.Mod(seed * spread, modulus - 1))
        begun = sp.Piecewise((begin, sp.Eq(kept, 0)), (kept, True))
        first.append(sp.floor(sp.Mod(factor * begun, modulus)))
        second.append(sp.floor(sp.Mod(factor * first[-1], modulus)))
    distance = sp.sqrt(-2 * sp.log(_uniform(first)))
    value = distance * sp.cos(2 * sp.pi * _uniform(second))
    return (
        *(
            DiscreteState(_memory(k), "1", f"memory of the noise, {k + 1} of 2", after, nominal=1e9)
            for k, after in enumerate(second)
        ),
        DiscreteState("noise", "1", "standard normal noise", value),
    )


def _memory(k: int) -> str:
    return f"noise_memory_{k + 1}"


def _uniform(states: list[sp.Expr]) -> sp.Expr:
    """A number between 0 and 1, both excluded, from the generator's two states."""
    period = MODULI[0] - 1
    return (sp.floor(sp.Mod(states[0] - states[1] - 1, period)) + 1) / sp.Integer(MODULI[0])

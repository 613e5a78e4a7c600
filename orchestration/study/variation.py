"""Differences of the plants of a study: draws for each plant, and their effect on parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..loop import toml_tables as toml

Vector = npt.NDArray[np.float64]

UNIFORM, NORMAL, LOGNORMAL, TEMPERATURE = "uniform", "normal", "lognormal", "temperature"
DISTRIBUTIONS = {
    UNIFORM: "[least, largest]",
    NORMAL: "[mean, standard deviation]",
    LOGNORMAL: "[median, standard deviation of the logarithm]",
    TEMPERATURE: "[least, largest]",
}
"""Meaning of the two numbers of each."""
OUTERMOST = 2.0**-53  # share of all draws: the smallest that doubles distinguish from zero


@dataclass(frozen=True)
class Variation:
    """A draw for each plant: a factor on nominal values of parameters, or a temperature."""

    # of the plant. All get the same factor, or the factors that follow from the temperature
    parameters: tuple[str, ...]
    # of the distribution, see `DISTRIBUTIONS`: factors, or kelvins above nominal
    numbers: tuple[float, float]
    distribution: str = UNIFORM  # a temperature is uniform
    # for a temperature: change of each parameter, relative to its nominal value, per kelvin
    coefficients: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of its column in tables."""
        kind = TEMPERATURE if self.distribution == TEMPERATURE else "factor"
        return "_".join((kind, *self.parameters))

    @property
    def nominal(self) -> float:
        """The draw of the nominal plant."""
        return 0.0 if self.distribution == TEMPERATURE else 1.0

    @property
    def ends(self) -> tuple[float, ...]:
        """The smallest and the largest draw; empty if the distribution has no ends."""
        return self.numbers if self.distribution in (UNIFORM, TEMPERATURE) else ()

    def quantiles(self, shares: Vector) -> Vector:
        """The draws below which these shares of all draws are."""
        from scipy import stats

        first, second = self.numbers
        if self.distribution == NORMAL:
            law = stats.norm(first, second)
        elif self.distribution == LOGNORMAL:
            law = stats.lognorm(second, scale=first)
        else:
            law = stats.uniform(first, second - first)
        return np.asarray(law.ppf(np.clip(shares, OUTERMOST, 1 - OUTERMOST)))

    def factors(self, draw: float) -> dict[str, float]:
        """Factors of the parameters."""
        if self.distribution == TEMPERATURE:
            return {n: 1 + per_kelvin * draw for n, per_kelvin in self.coefficients.items()}
        return dict.fromkeys(self.parameters, float(draw))


def read_variation(given: Any) -> Variation:
    """A ``[[vary]]`` of a study file; raises `toml.BadTable`."""
    given = toml.as_table("vary", given)
    toml.check_names("vary", given, ("parameters", "coefficients", *DISTRIBUTIONS))
    kinds = [kind for kind in DISTRIBUTIONS if kind in given]
    if len(kinds) != 1:
        found = " and ".join(kinds) or "no distribution"
        raise toml.BadTable(f"vary: has {found}, expected one of {', '.join(DISTRIBUTIONS)}")
    kind = kinds[0]
    names = "coefficients" if kind == TEMPERATURE else "parameters"
    for other in {"coefficients", "parameters"} - {names}:
        if other in given:
            raise toml.BadTable(f"vary: {kind} has {other}, expected {names} alone")
    if names == "coefficients":
        numbers = toml.as_numbers("vary.coefficients", given.get(names, {}))
        if not numbers:
            raise toml.BadTable(
                "vary: a temperature has no coefficients, such as {Fc = -0.01} per kelvin"
            )
        return Variation(tuple(numbers), toml.as_range("vary", kind, given[kind]), kind, numbers)
    parameters = tuple(map(str, toml.as_list("vary: parameters", given.get(names, []))))
    if not parameters or len(set(parameters)) < len(parameters):
        raise toml.BadTable(f"vary: parameters is {list(parameters)!r}, expected a list of names")
    return Variation(parameters, _numbers(kind, ", ".join(parameters), given[kind]), kind)


def _numbers(kind: str, of: str, given: Any) -> tuple[float, float]:
    """The two numbers of a distribution of factors."""
    if kind == UNIFORM:
        return toml.as_range("vary", of, given)
    pair = toml.as_list(f"vary: {kind} of {of}", given)
    found = [float(v) for v in pair if toml.is_number(v)]
    positive = found if kind == LOGNORMAL else found[1:]
    if len(pair) != 2 or len(found) != 2 or not min(positive) > 0:
        more = "both" if kind == LOGNORMAL else "the second"
        raise toml.BadTable(
            f"vary: {kind} of {of} is {given!r}, expected {DISTRIBUTIONS[kind]}, finite numbers, "
            f"{more} more than 0"
        )
    return found[0], found[1]

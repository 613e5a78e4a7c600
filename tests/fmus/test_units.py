"""Unit strings to base units."""

import pytest

from ballscrew.fmus.units import base_exponents


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("N*s/m", {"kg": 1, "s": -1}),
        ("V/(m/s)", {"kg": 1, "m": 1, "s": -2, "A": -1}),
        ("kg*m^2", {"kg": 1, "m": 2}),
        ("N*m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    ],
)
def test_known_units(unit, exponents):
    assert base_exponents(unit) == exponents


@pytest.mark.ci
@pytest.mark.parametrize("unit", ["", "furlong", "N*", "m/(s", "m^x", "m%", "m)"])
def test_other_strings_are_refused_with_the_string_in_the_message(unit):
    with pytest.raises(ValueError, match="unit"):
        base_exponents(unit)

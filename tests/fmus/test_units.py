"""Unit strings to base units."""

import pytest

from ballscrew.fmus.units import base_exponents
from ballscrew.solver.errors import FmuError


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
def test_other_strings_are_refused_with_the_string_in_the_message():
    wrong = "furlong N* m/(s m^x m% m) m^1234567 2*m m^2^2".split()
    for unit in ("", *wrong, 90 * "(", 200 * "m"):
        with pytest.raises(FmuError) as refused:
            base_exponents(unit)
        assert repr(unit) in str(refused.value)

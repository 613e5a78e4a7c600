"""Words for a body that turns."""

from __future__ import annotations

import pytest

from ballscrew.orchestration.parameter_file import TURNS
from ballscrew.orchestration.turning_words import in_turning_units, page_in_turning_units, words_for


@pytest.mark.parametrize(
    ("slides", "turns"),
    [
        ("0.02 N rms of 4.6 N rms; 1.2 mm rms", "0.02 N*m rms of 4.6 N*m rms; 1.2 mrad"),
        ("1.49 N from -0.042 to 0 m/s:", "1.49 N*m from -0.042 to 0 rad/s:"),
        ("force [N], rms (95 %)", "force [N*m], rms (95 %)"),
        ("position within 1 s [mm], rms", "position within 1 s [mrad], rms"),
        ("sigma2   1.49955  1.4877 .. 1.5115     N*s/m", "N*m*s/rad"),
        ("m        0.499   0.49 .. 0.5     kg", "J        0.499   0.49 .. 0.5     kg*m^2"),
        ("0.3 m/s^2, 12 um.", "0.3 rad/s^2, 12 urad."),
        ("1e+05 N/m", "1e+05 N*m/rad"),
    ],
)
def test_units_are_those_of_a_body_that_turns(slides, turns):
    assert turns in in_turning_units(slides)


@pytest.mark.parametrize(
    "text",
    [
        "the force comes later than the motion by 0.00709 ms (-0.55 .. 0.57)",
        "3 members of 17, no mass",
        "a record of 8 s, 1 kHz, 5 Nm.csv",
        "compare.json and compare.png in my N folder",
    ],
)
def test_all_else_stays_as_it_is(text):
    assert in_turning_units(text) == text


def test_of_a_page_only_what_is_shown_is_put_in_other_words():
    page = "<p title='1 N'>2 N</p><td>m</td><script>a = '3 N'; b[N]</script><style>x{4 mm}</style>"
    assert page_in_turning_units(page) == page.replace(">2 N<", ">2 N*m<").replace(">m<", ">J<")


def test_a_body_that_slides_keeps_its_words():
    assert words_for(())("1 N") == "1 N"
    assert words_for((TURNS,))("1 N") == "1 N*m"

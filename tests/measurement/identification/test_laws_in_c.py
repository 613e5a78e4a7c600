"""The compiled laws' equations are the plant's."""

from ballscrew.measurement.identification.laws_in_c import HEADER, header


def test_the_laws_in_c_are_made_from_the_plant_s_equations_as_they_are():
    kept = HEADER.read_text(encoding="utf-8")
    assert kept == header(), (
        "make it anew: python -m ballscrew.measurement.identification.laws_in_c"
    )

"""What is identified has to hold the true values, and what is said has to be true."""

import pytest
from cases import case

from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.identification.motion import motion_of
from ballscrew.measurement.records.reading import read_force_records

SI = {"time": "s", "x": "m", "force": "N"}


def hold(found, truth):
    for name, value in truth.items():
        interval = found.parameters[name]
        assert interval.low <= value <= interval.high, (name, interval)


@pytest.mark.ci
def test_instants_that_jitter_leave_the_mass_known(tmp_path):
    """Sampling instants known to 20 us are an error of 8 um at full speed, of counts of 1 um."""
    records = read_force_records([case("jitter_hides_the_mass", tmp_path) / "j.csv"], None, SI)
    found = identify(records, "classical", mass=True, offset=True)
    hold(found, {"m": 22.6, "sigma2": 30.0, "Fc": 31.8, "Fs": 49.3, "Vs": 0.0173, "offset": -1.77})
    assert found.parameters["m"].identified
    assert found.parameters["m"].high - found.parameters["m"].low < 0.6
    assert motion_of(records[0]).jitter == pytest.approx(2e-5, rel=0.1)
    assert found.trusted, found.warnings


def test_of_two_that_only_their_sum_shows_neither_is_identified(tmp_path):
    """A motion upwards at about 0.1 m/s shows the sum of 8 N of friction and 20 N of gravity."""
    records = read_force_records([case("oneway_offset_identified", tmp_path) / "up.csv"], None, SI)
    found = identify(records, "classical", fixed={"Vs": 0.01}, mass=True, offset=True)
    friction, offset = found.parameters["Fc"], found.parameters["offset"]
    at_speed = friction.value + offset.value + 0.1 * found.parameters["sigma2"].value
    assert at_speed == pytest.approx(8.0 + 20.0 + 4.0, abs=0.02)
    assert not friction.identified
    assert not offset.identified
    assert friction.high - friction.low > offset.high - offset.low > 50.0
    assert "one direction only" in friction.because
    assert "both directions" in offset.would_do
    hold(found, {"m": 5.0, "sigma2": 40.0, "Fc": 8.0, "offset": 20.0})
    assert found.parameters["m"].identified

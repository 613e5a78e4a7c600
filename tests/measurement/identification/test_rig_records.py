"""Records of the virtual rig, closed loop and all: what was put in comes out."""

from __future__ import annotations

import numpy as np
import pytest

from ballscrew.measurement.identification.identify import identify
from ballscrew.measurement.records.reading import read_force_records
from ballscrew.measurement.rig.bench import run_trial
from ballscrew.measurement.rig.trials import trials_named


@pytest.fixture(scope="module")
def force_steps(tmp_path_factory):
    """Table 2.8: presliding by the capacitance sensor, and its truth."""
    path = tmp_path_factory.mktemp("steps")
    made = [run_trial(t, "modified_lugre", {}, seed=2) for t in trials_named("2.8")]
    for one in made:
        one.save(path / one.trial.folder)
    return path, made


@pytest.mark.ci
def test_fine_positions_follow_the_plates_and_not_the_instrument_s_polynomial(force_steps):
    path, made = force_steps
    ours, instrument = [], []
    for one in made[:2]:  # to 0.5 N: over a small way, where the polynomial's slope is wrong
        (record,) = read_force_records([path / one.trial.folder])
        late = round(record.lags["x_fine"] / record.step)
        true = one.truth["x"][: len(record.position) - late]
        ours.append(np.polyfit(true, record.position[late:], 1)[0] - 1)
        instrument.append(np.polyfit(true, one.record["x_fine"][late:], 1)[0] - 1)
    assert abs(np.mean(ours)) < 0.01
    assert abs(np.mean(instrument)) > 0.03


@pytest.mark.ci
def test_from_presliding_alone_nothing_is_claimed_of_sliding(force_steps):
    path, made = force_steps
    result = identify(read_force_records([path]), "modified_lugre")
    truth = made[0].parameters
    for name in ("Fc", "Vs", "sigma2"):
        i = result.parameters[name]
        assert (i.identified, i.low, i.high) == (False, None, None)
        assert "hardly slides" in i.because
        assert "would be enough" in i.would_do
    stiffness = result.parameters["sigma0"]
    assert stiffness.identified
    assert stiffness.low <= truth["plant.sigma0"] <= stiffness.high

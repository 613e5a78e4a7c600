"""The trials are those of the thesis' tables, by every name that a user may give them."""

import numpy as np
import pytest

from ballscrew.measurement.rig.trials import TABLES, trials_named


def levels(table):
    return [t.level for t in trials_named(table)]


def test_every_table_has_its_number_of_trials():
    counts = {table: len(trials_named(table)) for table in TABLES}
    assert counts == {
        "2.2": 13,
        "2.3.1": 16,
        "2.4": 16,
        "2.6": 9,
        "2.8": 6,
        "2.10": 13,
        "2.11": 1,
        "viscous": 60,
        "loading-rate": 20,
        "presliding": 1,
    }


def test_force_steps_are_those_of_the_tables():
    steps = [0.3, 0.6, 1.0, 1.5, 1.8, 2.0, 2.1, 2.2, -0.3, -0.6, -2.1, -2.3, -2.4]
    assert levels("2.2") == levels("2.10") == steps
    assert levels("2.8") == [0.5, 0.5, 1.0, 1.0, 1.5, 1.5]
    for trial in trials_named("2.8"):
        assert trial.fine
        np.testing.assert_array_equal(trial.reference(), trial.level)


def test_velocities_are_those_of_the_tables():
    one = trials_named("2.4/7")[0]
    np.testing.assert_allclose(one.reference(), 1e-3 * np.sin(one.time / 6), atol=1e-18)
    assert one.time[-1] == pytest.approx(19.0)
    back = trials_named("2.4/15")[0]
    np.testing.assert_allclose(back.reference(), -one.reference(), atol=1e-18)
    six = trials_named("2.6/6")[0]
    np.testing.assert_allclose(six.reference(), 5e-3 * np.sin(2 * six.time / 3), atol=1e-18)
    assert six.duration == 18.85
    lag = trials_named("2.11")[0]
    np.testing.assert_allclose(lag.reference(), 1.5e-3 + 1e-3 * np.sin(3 * lag.time), atol=1e-18)
    assert sorted(levels("2.3.1"))[:2] == [-5.5e-3, -5e-3]
    assert min(abs(v) for v in levels("2.3.1")) == 2e-3
    assert sorted({abs(v) for v in levels("viscous")}) == [3e-3, 4e-3, 5e-3, 6e-3, 7e-3, 8e-3]


@pytest.mark.ci
@pytest.mark.parametrize("name", ["2.4/7", "table-2.4-7", "2.4-07"])
def test_a_trial_answers_to_all_its_names(name):
    assert [t.name for t in trials_named(name)] == ["2.4/7"]

"""How answers count in the worlds, and how many records a proof takes."""

from __future__ import annotations

import pytest
from worlds import WORLDS
from worlds_trials import FAULTLESS, plan_trials, right_names

from ballscrew.diagnosis.scores import OUTSIDE

pytestmark = pytest.mark.ci


def test_a_proof_takes_sixty_faultless_records_and_twice_as_many_with_effects_in_every_world():
    trials = plan_trials(0, 1, at_least=(60, 120))
    for world in WORLDS:
        here = [t for t in trials if t.world == world]
        assert sum(t.group == FAULTLESS for t in here) >= 60
        assert sum(t.group != FAULTLESS for t in here) >= 120
    assert len({t.key for t in trials}) == len(trials)
    assert {t.world for t in trials[: len(trials) // 20]} == set(WORLDS)


@pytest.mark.parametrize(
    ("effect", "shared", "right"),
    [
        ("backlash", [], {"backlash"}),
        ("backlash", ["compliance"], {"backlash", "compliance"}),
        ("detent_notch", [], {OUTSIDE}),
        ("load_bias", [], {"load_bias", "parameter_error"}),
        ("time_shift", [], {"time_shift", "input_delay"}),
    ],
)
def test_right_is_the_truth_and_what_has_its_shape_in_the_record(effect, shared, right):
    assert right_names(effect, shared) == right

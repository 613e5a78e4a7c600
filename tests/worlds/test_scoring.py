"""How answers count in the worlds, and how many records the proof takes."""

from __future__ import annotations

import pytest
from worlds import WORLDS
from worlds_trials import CAUSE, EACH, FAILED, FAULTLESS, FIRST_SEED, OUTSIDE, Row, plan_trials


def row(
    group, effect, named, *, shared=(), values=None, intervals=None, truth=None, **other
) -> Row:
    """A row with an answer."""
    said = {
        "key": "w:e:1",
        "world": "fast_screw",
        "form": "",
        "seed": 1,
        "ratio": 20.0,
        "conditions": {},
        "wrong_values": {},
        "verdict": "explained" if named else "none",
        "evidence": None,
        "kind": [],
        "seconds": 1.0,
        "message": "",
    } | other
    return Row(
        group=group,
        effect=effect,
        named=list(named),
        shared=list(shared),
        values=values or [{} for _ in named],
        intervals=intervals or [{} for _ in named],
        truth=truth or {},
        **said,
    )


def test_the_proof_takes_sixty_faultless_records_and_twice_as_many_with_effects_in_every_world():
    trials = plan_trials(EACH, FIRST_SEED, at_least=(60, 120))
    for world in WORLDS:
        here = [t for t in trials if t.world == world]
        assert sum(t.group == FAULTLESS for t in here) >= 60
        assert sum(t.group != FAULTLESS for t in here) >= 120
    assert len({t.key for t in trials}) == len(trials)
    assert {t.world for t in trials[: len(trials) // 20]} == set(WORLDS)


@pytest.mark.parametrize(
    ("answer", "wrong", "right_first"),
    [
        (row(FAULTLESS, "", []), False, False),
        (row(FAULTLESS, "", ["compliance"]), True, False),
        (row(CAUSE, "backlash", ["backlash"]), False, True),
        (row(CAUSE, "backlash", ["backlash", "load_bias"]), True, True),
        (row(CAUSE, "backlash", ["load_bias"]), True, False),
        (row(CAUSE, "backlash", []), False, False),
        (row(CAUSE, "backlash", [], verdict=FAILED), True, False),
        (row(CAUSE, "backlash", ["compliance", "backlash"], shared=["compliance"]), False, True),
        (row(CAUSE, "backlash", ["compliance"], shared=["compliance"]), True, False),
        (row(OUTSIDE, "detent_notch", ["load_bias"], shared=["load_bias"]), True, False),
        (row(OUTSIDE, "detent_notch", []), False, False),
        (row(CAUSE, "unmodelled_inertia", ["parameter_error"], values=[{"m": 3.0}]), False, True),
        (row(CAUSE, "load_bias", ["parameter_error"], values=[{"Fc": 3.0}]), True, False),
    ],
)
def test_a_name_that_is_printed_counts(answer, wrong, right_first):
    assert answer.wrong is wrong
    assert answer.right_first is right_first


def test_intervals_are_judged_where_the_right_name_has_a_counterpart():
    here = {"truth": {"gap": 2e-5}, "intervals": [{}, {"gap": (1e-5, 3e-5)}]}
    assert row(CAUSE, "backlash", ["load_bias", "backlash"], **here).held() == [True]
    here["intervals"] = [{"gap": (1e-5, 1.5e-5)}]
    assert row(CAUSE, "backlash", ["backlash"], **here).held() == [False]
    assert row(CAUSE, "backlash", ["load_bias"], **here).held() == []

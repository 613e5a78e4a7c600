"""The rule that finds and names, by hand: each number alone decides."""

from __future__ import annotations

import pytest

from ballscrew.measurement.diagnosis.causes.cause import Form
from ballscrew.measurement.diagnosis.rule import members_of
from ballscrew.measurement.diagnosis.scores import OUTSIDE, Gain, Hypothesis

RIPPLE, GAP, LOAD, LEAN = "torque_ripple", "backlash", "load_bias", "direction_asymmetry"


def hypothesis(name, score, share=0.9, low=0.1):
    gain = Gain(share, (low, 2 * share - low))
    return Hypothesis(Form((), name=name), None, None, score, gain)


@pytest.mark.parametrize(
    ("ranked", "members", "named"),
    [
        ([(RIPPLE, 101), (GAP, 80)], [RIPPLE], True),
        ([(RIPPLE, 499, 0.89)], [RIPPLE], False),
        ([(RIPPLE, 500, 0.89)], [RIPPLE], True),
        ([(RIPPLE, 99), (GAP, 10)], [], False),
        ([(RIPPLE, 200, 0.049, 0.01)], [], False),
        # the force on held-out data may not fall: it is no cause, but still a rival
        ([(RIPPLE, 200, 0.5, -0.01), (GAP, 190)], [GAP, RIPPLE], False),
        ([(RIPPLE, 200, 0.5, -0.01), (GAP, 159)], [], False),
        ([(RIPPLE, 200), (GAP, 161)], [RIPPLE, GAP], False),
        # of one entry
        ([(LEAN, 200), (LOAD, 161)], [LEAN, LOAD], True),
        ([("sign_of_u", 900), ("sign_of_x", 899)], ["sign_of_u", "sign_of_x"], True),
        ([(LEAN, 200), (LOAD, 199), (GAP, 161)], [LEAN, LOAD, GAP], False),
        ([(OUTSIDE, 249), (RIPPLE, 200)], [RIPPLE], True),  # a free curve has more parameters
        ([(OUTSIDE, 251), (RIPPLE, 200)], [OUTSIDE], False),
        ([(OUTSIDE, 101)], [OUTSIDE], False),
    ],
)
def test_what_is_found_and_what_is_named(ranked, members, named):
    found = members_of([hypothesis(*one) for one in ranked])
    assert [h.name for h in found] == members
    assert [h.certain for h in found] == [named] * len(found[:1]) + [False] * len(found[1:])


def test_the_lead_and_what_is_alike_are_told():
    first, second = members_of([hypothesis(LEAN, 200), hypothesis(LOAD, 195), hypothesis(GAP, 90)])
    assert (first.lead, first.alike, second.lead, second.alike) == (110.0, (LOAD,), 105.0, ())

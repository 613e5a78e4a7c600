"""The errors of exponents and the agreement of two verdicts, by hand from made-up runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ballscrew.solver.spectrum import Spectrum
from ballscrew.stability.attractor import Attractor, Kind, agree
from ballscrew.stability.lyapunov import LyapunovRun

BIT = math.log(2.0)
RUN = Spectrum(
    time=np.array([1.0, 2.0, 5.0]),
    states=np.zeros((3, 2)),
    growth=BIT * np.array([[0.0, 0.0], [1.0, -1.0], [2.0, 8.0]]),
    trace=BIT * np.array([0.0, 4.0, 9.0]),
    frame=np.eye(2),
    events=3,
    failure="",
    diverged=False,
)
TIGHTER = replace(RUN, growth=BIT * np.array([[0.0, 0.0], [1.0, -1.0], [3.0, 8.4]]))
STILL = Attractor(Kind.CYCLE, "it closes", limit=BIT * np.array([0.0, -3.0]))


def run(**changes) -> LyapunovRun:
    given = {"names": ["x", "v"], "spectrum": RUN, "tighter": TIGHTER, "motion": STILL}
    return LyapunovRun(**given | {"tolerance": 1e-8} | changes)


def test_what_is_not_known_is_said_by_none_or_no_number():
    assert np.isnan(run(tighter=None).error).all()
    fallen = replace(RUN, growth=np.array([[0.0, 0.0], [1.0, -1.0], [4.0, -np.inf]]))
    stuck = run(spectrum=fallen, tighter=fallen)
    assert stuck.error.tolist() == [1e-5, 0.0]  # the second is minus infinity in both
    assert stuck.sum_rule_error() is None
    assert run(names=["x", "v", "i"]).sum_rule_error() is None
    none = replace(RUN, growth=0.0 * RUN.growth, trace=0.0 * RUN.trace)
    assert run(spectrum=none).sum_rule_error() == 0.0
    start = replace(RUN, time=RUN.time[:1], growth=RUN.growth[:1], trace=RUN.trace[:1])
    assert run(spectrum=start).sum_rule_error() is None
    assert run(spectrum=start).figures()["mean_trace_bits_per_s"] is None


def test_the_error_of_limits_is_the_larger_of_their_own_and_of_three_times_the_difference_of_two():
    first = Attractor(Kind.FIXED_POINT, "", limit=np.array([-1.0, -2.0, -np.inf]))
    own = np.array([0.1, 0.1, 0.1])
    second = replace(first, limit=np.array([-1.3, -2.05, -np.inf]), limit_error=own)
    assert agree(first, second).limit_error == pytest.approx([0.9, 0.15, 0.1])
    chaos = [replace(a, kind=Kind.CHAOS) for a in (first, second)]
    assert agree(*chaos).limit_error is own
    assert agree(first, replace(second, limit_error=None)).limit_error is None
    found = agree(first, chaos[1])
    assert found.kind is Kind.UNDECIDED

"""Means over plants, and who can be told apart: figures of known laws.

And what a study says first, and what weakens it, of figures and tunings that are made up here.
"""

import numpy as np
import pytest

from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Tuning
from ballscrew.orchestration.study.result import compare, concluded, mean_over_plants
from ballscrew.orchestration.study.run import NAMES
from ballscrew.orchestration.study.tuning import Tuned
from ballscrew.study_results import SwapStudy


def drawn(random, ratio, seeds=3, plants=20):
    """Two controllers on the same plants, whose own spread of 30 % both share."""
    shared = random.normal(0, 0.3, plants)

    def side(level):
        of_seed = random.normal(0, 0.01, (seeds, 1))
        return np.exp(level + shared + of_seed + random.normal(0, 0.02, (seeds, plants)))

    return side(np.log(ratio)), side(0.0)


def rate(of, ratio) -> float:
    random = np.random.default_rng(1)
    return np.mean([of(compare(*drawn(random, ratio))) for _ in range(400)])


@pytest.mark.ci
def test_rates_at_which_two_controllers_are_told_apart_or_called_equal():
    assert rate(lambda d: d.told_apart, 1.0) <= 0.05  # one in ten is allowed
    assert rate(lambda d: d.told_apart, 1.1) >= 0.8
    assert rate(lambda d: d.alike, 1.12) <= 0.05  # a twelfth more is not less than a tenth
    assert rate(lambda d: d.low <= 1.3 <= d.high, 1.3) >= 0.88


def test_the_order_turns_the_ratio_over_and_nothing_is_equal_that_is_not_shown_to_be():
    """Two tunings of each, of which one failed: a ratio of a hundred, and nothing is known."""
    a, b = drawn(np.random.default_rng(3), 1.5)
    there, back = compare(a, b), compare(b, a)
    assert there.ratio == pytest.approx(1 / back.ratio)
    assert there.low == pytest.approx(1 / back.high)
    good, failed = np.full((2, 8), 6.78e-5), np.full((2, 8), 6.78e-5)
    failed[1] *= 1e4
    found = compare(failed, good)
    assert found.ratio == pytest.approx(100.0)
    assert found.words == "these runs cannot tell"
    assert compare(1.01 * good, good).words == "equal within 10 %"
    assert compare(1.03 * good, good).words == "different"


def test_tunings_on_a_plant_are_averaged_and_the_mean_is_that_of_all_runs():
    figure = np.array([[1.0, 4.0, 2.0], [9.0, 1.0, 2.0]])
    plain, geometric = (mean_over_plants(figure, kind) for kind in (False, True))
    assert plain.mean == pytest.approx(figure.mean())
    assert geometric.mean == pytest.approx(np.exp(np.log(figure).mean()))
    # plants 5, 2.5, 2: a deviation of 1.6073, and 2.92 of Student's table at 2 degrees
    assert plain.high - plain.mean == pytest.approx(2.91999 * 1.607275 / np.sqrt(3), rel=1e-5)
    assert np.isnan(mean_over_plants(np.array([[1.0, np.inf, 2.0]]), False).mean)
    steady = mean_over_plants(np.full((2, 4), 3.0), True)
    assert (steady.low, steady.high) == pytest.approx((3.0, 3.0))


PLANTS, SEEDS = 8, 2
FINE = [(0.1, 0.099), (0.101, 0.1)]
ERRORS = {
    "p_pi": {"move": 1e-6, "sine": 2e-6, "hold": 1e-6, "steps": 9e-5},
    "pid": {"move": 4e-6, "sine": 9e-6, "hold": 8e-6, "steps": 4e-5},
}


def study(costs=FINE, failed=(), second=1.0):
    """Of `ERRORS` by controller and duty [m], the second tuning of pid worse by a factor.

    `costs` are (cost, doubled) of pid by tuning.
    """
    names, duties = list(ERRORS), list(ERRORS["pid"])
    plan = Plan(
        plant="plant",
        entrants=tuple(Entrant(n, n, tune={"Kp": (1.0, 2.0)}) for n in names),
        duties=(
            Duty("t", "move:distance=0.01", 1.0, True),
            *(Duty(d, f"step:size=1e-{k + 3}", 1.0) for k, d in enumerate(duties)),
        ),
        tuning=Tuning(seeds=SEEDS),
        plants=PLANTS,
    )
    random = np.random.default_rng(1)
    figures = {n: np.ones((len(names), SEEDS, len(duties), PLANTS)) for n in NAMES}
    figures["failed"] *= 0.0
    errors = np.array([[[*ERRORS[n].values()]] * SEEDS for n in names])[..., None]
    figures["rms_error"] = errors * random.uniform(0.999, 1.001, figures["failed"].shape)
    figures["rms_error"][1, 1] *= second
    for name, duty in failed:
        figures["failed"][names.index(name), 0, duties.index(duty), 0] = 1.0
    tunings = {
        n: [Tuned({"Kp": 1.5}, cost, 1.0, doubled, 200) for cost, doubled in of]
        for n, of in {"p_pi": FINE, "pid": costs}.items()
    }
    return SwapStudy.of(concluded(plan, tunings, figures, {}, {}))


def test_who_wins_is_said_first_and_where_it_does_not():
    found = study()
    assert found.verdict == "p_pi wins 3 of 4 duties; it does not win steps (pid does)"
    assert found.headline() == f"{found.verdict}. 2 controllers, 4 duties, 128 runs"


def test_a_failed_tuning_is_said_with_its_cost_and_what_is_known_to_be_there():
    found = study([(0.444, 0.038), (0.05, 0.04)])
    said = "uning of pid FAILED in 1 of 2 tries: it ended at a cost of 0.444, but 0.038 was found"
    assert said in found.doubts()[0]
    assert said in found.headline()


def test_failed_runs_are_said_and_lose_the_duty():
    found = study(failed=[("p_pi", "move")])
    assert found.verdict.startswith("p_pi wins 2 of 4 duties; it does not win move and steps")
    assert found.doubts() == ["1 runs FAILED, of p_pi"]
    assert not found.trusted
    none = study(failed=[(n, d) for n in ERRORS for d in ERRORS[n]])
    assert none.verdict == "No controller completed any duty"


def test_two_tunings_of_which_one_failed_cannot_tell_and_the_words_say_so():
    found = study(second=1e4)
    assert (found.answers[0].best, found.answers[0].unclear) == (("p_pi",), ("pid",))
    assert "at 4 of them 2 tunings on 8 plants cannot tell whether" in found.verdict
    answers, *_ = found.tables()
    assert answers.columns[3] == "2 tunings on 8 plants cannot tell"
    assert answers.rows[0][3] == "pid"

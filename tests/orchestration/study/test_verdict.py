"""What a study says first, and what weakens it: of figures and tunings that are made up here."""

import numpy as np

from ballscrew.orchestration.study.figures import NAMES
from ballscrew.orchestration.study.plan import Duty, Entrant, Plan, Tuning
from ballscrew.orchestration.study.result import concluded, sentence, weaknesses
from ballscrew.orchestration.study.tuning import Tuned
from ballscrew.study_results import SwapStudy

GAINS = {"Kp": (1.0, 2.0)}
PLANTS, SEEDS = 8, 2


def study(errors, costs, failed=()):
    """Of errors by controller and duty [m], costs as (cost, doubled) by controller and seed."""
    names, duties = list(errors), list(next(iter(errors.values())))
    plan = Plan(
        plant="plant",
        entrants=tuple(Entrant(n, n, tune=GAINS) for n in names),
        duties=(
            Duty("t", "move:distance=0.01", 1.0, True),
            *(Duty(d, f"step:size=1e-{k + 3}", 1.0) for k, d in enumerate(duties)),
        ),
        tuning=Tuning(seeds=SEEDS),
        plants=PLANTS,
    )
    random = np.random.default_rng(1)
    shape = len(names), SEEDS, len(duties), PLANTS
    figures = {n: np.ones(shape) for n in NAMES}
    figures["failed"] = np.zeros(shape)
    for e, s, d, _ in np.ndindex(shape):
        scatter = random.uniform(0.999, 1.001, PLANTS)
        figures["rms_error"][e, s, d] = errors[names[e]][duties[d]] * scatter
    for name, duty in failed:
        figures["failed"][names.index(name), 0, duties.index(duty), 0] = 1.0
    tunings = {
        n: [Tuned({"Kp": 1.5}, cost, 1.0, doubled, 200) for cost, doubled in costs[n]]
        for n in names
    }
    return concluded(plan, tunings, figures, {}, {})


FINE = [(0.1, 0.099), (0.101, 0.1)]
ERRORS = {
    "p_pi": {"move": 1e-6, "sine": 2e-6, "hold": 1e-6, "steps": 9e-5},
    "pid": {"move": 4e-6, "sine": 9e-6, "hold": 8e-6, "steps": 4e-5},
}


def test_who_wins_is_said_first_and_where_it_does_not():
    found = study(ERRORS, {"p_pi": FINE, "pid": FINE})
    assert sentence(found) == "p_pi wins 3 of 4 duties; it does not win steps (pid does)"
    assert weaknesses(found) == []
    said = SwapStudy.of(found).headline()
    assert said.startswith(sentence(found))
    assert said.endswith("2 controllers, 4 duties, 128 runs")


def test_a_failed_tuning_is_said_with_its_cost_and_what_is_known_to_be_there():
    found = study(ERRORS, {"p_pi": FINE, "pid": [(0.444, 0.038), (0.05, 0.04)]})
    (first, *_) = weaknesses(found)
    assert first.startswith("tuning of pid FAILED in 1 of 2 tries: it ended at a cost of 0.444")
    assert "0.038 was found" in first
    assert first.replace("tuning", "Tuning") in SwapStudy.of(found).headline()


def test_failed_runs_are_said_and_lose_the_duty():
    found = study(ERRORS, {"p_pi": FINE, "pid": FINE}, failed=[("p_pi", "move")])
    assert sentence(found).startswith("p_pi wins 2 of 4 duties; it does not win move and steps")
    assert weaknesses(found) == ["1 runs FAILED, of p_pi"]
    none = study(ERRORS, {"p_pi": FINE, "pid": FINE}, [(n, d) for n in ERRORS for d in ERRORS[n]])
    assert sentence(none) == "No controller completed any duty"


def test_two_tunings_of_which_one_failed_cannot_tell_and_the_words_say_so():
    found = study(ERRORS, {"p_pi": FINE, "pid": FINE})
    figures = {n: f.copy() for n, f in found.figures.items()}
    figures["rms_error"][1, 1] *= 1e4  # the second tuning of pid
    found = concluded(found.plan, found.tunings, figures, {}, {})
    answer = next(a for a in found.answers if a.duty == "move")
    assert (answer.best, answer.unclear) == (("p_pi",), ("pid",))
    assert "at 4 of them 2 tunings on 8 plants cannot tell whether" in sentence(found)
    answers, *_ = SwapStudy.of(found).tables()
    assert answers.columns[3] == "2 tunings on 8 plants cannot tell"
    assert next(row for row in answers.rows if row[0] == "move")[3] == "pid"

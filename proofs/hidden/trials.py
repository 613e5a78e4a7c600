"""Hidden effects given to the diagnosis and scored: what the proof counts and the tests sample."""

from __future__ import annotations

import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hidden.cases import CATALOGUE, OUTSIDE, HiddenCase, draw_case, write_case

NOTHING, SHAPE = "none", "unexplained"  # what is found where no cause is named
FAILED = "failed"
FIRST_SEED = 9000  # those below were looked at while the diagnosis was made
SAMPLED = 30  # cases of every cause; the other groups' sizes go with it
CAUSE, NONE, OUT, PAIR = "cause", "none", "outside", "pair"


@dataclass(frozen=True)
class Trial:
    """What is hidden, and from which seed the rest is drawn."""

    group: str
    effects: tuple[str, ...]
    seed: int

    @property
    def key(self) -> str:
        """The trial in one word."""
        return f"{'+'.join(self.effects)}:{self.seed}"


@dataclass(frozen=True)
class Row:
    """One trial: the truth, what was found, and how it counts.

    Attributes
    ----------
    named : list of str
        The causes found, in their order.
    confused_with : list of list of str
        Pairs of causes between which the diagnosis cannot say.
    right : bool
    by : str
        What makes it right: ``name``, or the generator's ``same_force`` or ``out_of_reach``.
    wrong_name : bool
        A cause came first that is not there.
    failure : str
        The last line of what was raised instead of an answer.
    """

    key: str
    group: str
    effects: list[str]
    seed: int
    excitation: str
    with_current: bool
    exact: bool
    sizes: dict[str, dict[str, float | str]]
    target: list[float]
    snr: list[float]
    same_force: list[str]
    out_of_reach: bool
    verdict: str
    named: list[str]
    confused_with: list[list[str]]
    right: bool
    by: str
    wrong_name: bool
    seconds: float
    failure: str

    @property
    def first(self) -> str:
        """What came first, or that nothing did."""
        if self.named:
            return self.named[0]
        return self.verdict if self.verdict in (SHAPE, FAILED) else NOTHING


def plan_trials(each: int = SAMPLED, only: str | None = None) -> list[Trial]:
    """The trials of the proof, seeds fixed.

    Parameters
    ----------
    each : int
        Cases of every cause; 300 of none, 200 outside and 100 pairs come with 30.
    only : str, optional
        A cause, an outside effect, or a group.
    """
    first = FIRST_SEED
    trials = [
        Trial(CAUSE, (name,), seed) for seed in range(first, first + each) for name in CATALOGUE
    ]
    trials += [Trial(NONE, ("none",), seed) for seed in range(first, first + 10 * each)]
    outside = (20 * each + 2) // 3
    trials += [Trial(OUT, (OUTSIDE[k % 3],), first + k // 3) for k in range(outside)]
    for seed in range(first, first + (10 * each + 2) // 3):
        both = np.random.default_rng([seed, 2]).choice(CATALOGUE, 2, replace=False)
        trials.append(Trial(PAIR, tuple(str(n) for n in both), seed))
    if only is None:
        return trials
    return [t for t in trials if only == t.group or (t.group != PAIR and only in t.effects)]


def run_trial(trial: Trial) -> Row:
    """Draw, write, diagnose, score."""
    # here, so that the truth can be drawn where there is no estimator
    from ballscrew.diagnosis.diagnose import diagnose

    case = draw_case(trial.effects, trial.seed)
    verdict, named, confused, failure = FAILED, [], [], ""
    with tempfile.TemporaryDirectory() as folder:
        files = write_case(case, Path(folder))
        started = time.perf_counter()
        try:
            found = diagnose([files.record], params=files.parameters)
            verdict = str(found.verdict)
            named = [str(c.name) for c in found.causes]
            confused = [[n.name, n.like] for n in found.not_named if n.like]
        except Exception:  # counted as a wrong answer, and the others go on
            failure = traceback.format_exc().strip().splitlines()[-1]
        seconds = time.perf_counter() - started
    right, by = score(trial.group, case, verdict, named)
    return Row(
        key=trial.key,
        group=trial.group,
        effects=list(trial.effects),
        seed=trial.seed,
        excitation=case.excitation,
        with_current="i" in case.record,
        exact=case.exact,
        sizes=case.sizes,
        target=list(case.target),
        snr=list(case.snr),
        same_force=sorted(case.same_force),
        out_of_reach=case.out_of_reach,
        verdict=verdict,
        named=named,
        confused_with=confused,
        right=right,
        by=by,
        wrong_name=bool(named) and not right,
        seconds=seconds,
        failure=failure,
    )


def score(group: str, case: HiddenCase, verdict: str, named: list[str]) -> tuple[bool, str]:
    """Whether an answer is right, and by what.

    A cause is right if its name comes first; of a pair both have to be named, in either order;
    where there is nothing, or nothing of the catalogue, no cause may be named. The generator
    excuses a cause of the same force in this record, and silence about what is out of reach.
    """
    if verdict == FAILED:
        return False, ""
    if group == PAIR:
        right = set(case.effects) <= set(named)
    elif group == CAUSE:
        right = named[:1] == list(case.effects)
    else:
        right = not named
    if right:
        return True, "name"
    if named and group != PAIR and named[0] in case.same_force:
        return True, "same_force"
    if case.out_of_reach and set(named) <= set(case.effects):
        return True, "out_of_reach"
    return False, ""

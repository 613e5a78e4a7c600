"""Test sets of suspects on records that were not used for the shipped table, or fit the table.

Draws records of the worlds that are not held back, scores their suspects, and counts the contents
of the sets and the names. Writes ``docs/proof/diagnosis_sets.json``, with seeds, Wilson's bounds
and the worst world first::

    python proofs/calibrate_sets.py --faultless 20 --effects 40

``--fit`` fits the weights and thresholds of `ballscrew.measurement.diagnosis.sets` to the records
instead, and writes ``measurement/diagnosis/sets.json``. It prints the coverage of the sets on
held-out records, a fifth at a time. Use different seeds for the fit and the proof::

    python proofs/calibrate_sets.py --fit --first-seed 975000 --rows out/fitted.jsonl
"""

from __future__ import annotations

import os

from ballscrew.solver.errors import BadRecord

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "measurement" / "diagnosis" / "sets.json"
TARGET = ROOT / "docs" / "proof" / "diagnosis_sets.json"
ROWS = ROOT / "out" / "diagnosis_sets.jsonl"

from provenance import provenance  # noqa: E402
from worlds import HELD_BACK, WORLDS, Unusable  # noqa: E402
from worlds_trials import (  # noqa: E402
    VISIBLE,
    Trial,
    drawn,
    plan_trials,
    right_names,
    share,
    truth_of,
)

from ballscrew.measurement.diagnosis.scores import OUTSIDE, Catalogue, scored  # noqa: E402
from ballscrew.measurement.diagnosis.sets import NOTHING, STATISTICS, probabilities, statistics  # noqa: E402
from ballscrew.measurement.diagnosis.study import study_of  # noqa: E402
from ballscrew.options import add_worker_options, open_workers  # noqa: E402
from ballscrew.solver.files import write_json  # noqa: E402

COVERAGE = 0.95
OF_FAULTLESS = 0.03
"""Largest share of faultless records with a reported error."""
OF_NAMES = 0.02
"""Largest share of records, faultless or not, with a wrong name."""
FOLDS = 5
RIDGE, RIDGE_OF_OWN = 0.05, 0.5  # for standardised weights; for those of each name

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """One record: its truth and the statistics of its suspects."""

    world: str
    effect: str
    seed: int
    ratio: float
    shared: list[str]
    names: list[str]
    statistics: list[list[float]]
    seconds: float
    message: str = ""

    @property
    def truth(self) -> str:
        """The name that must be in the set."""
        return truth_of(self.effect) if self.effect else NOTHING

    @property
    def usable(self) -> bool:
        """Whether the record is used to test sets; one with an unclear effect is not."""
        return not self.message and (not self.effect or self.ratio > VISIBLE)

    @property
    def clear(self) -> bool:
        """Whether the truth shows a cause or a signal clearly."""
        return self.usable and self.truth not in (NOTHING, OUTSIDE)

    @property
    def allowed(self) -> set[str]:
        """The true cause, and causes with the same shape in this record."""
        return right_names(self.effect, self.shared) if self.effect else {NOTHING}


def row_of(trial: Trial) -> Row:
    """Draw a record and score its suspects."""
    told = (trial.world, trial.effect, trial.seed)
    try:
        case = drawn(trial)
    except Unusable as reason:
        return Row(*told, 0.0, [], [], [], 0.0, str(reason))
    began = time.process_time()
    try:
        names, rows = statistics(scored(Catalogue(study_of(*case.read()))))
    except BadRecord as reason:
        return Row(*told, case.ratio, case.shared, [], [], time.process_time() - began, str(reason))
    seconds = time.process_time() - began
    return Row(*told, case.ratio, case.shared, names, rows.round(5).tolist(), seconds)


@dataclass(frozen=True)
class Weights:
    """Weights of the statistics, and of each name."""

    weights: Vector
    own: dict[str, list[float]]

    def of(self, row: Row) -> dict[str, float]:
        """Probability of each name of a record."""
        found = probabilities(row.names, np.array(row.statistics), self.weights, self.own)
        return dict(zip(row.names, found.tolist(), strict=True))


def fitted(rows: list[Row], names: list[str]) -> Weights:
    """Weights with the largest likelihood, with a ridge; every world has the same weight."""
    place = {n: k for k, n in enumerate(names)}
    sizes = np.sqrt(np.mean(np.vstack([r.statistics for r in rows]) ** 2, axis=0)) + 1e-9
    in_world = {w: sum(r.world == w for r in rows) for w in {r.world for r in rows}}
    each = len(rows) / len(in_world)
    items = [
        (
            np.array(r.statistics) / sizes,
            np.array([place[n] for n in r.names]),
            r.names.index(r.truth),
            each / in_world[r.world],
        )
        for r in rows
        if r.truth in r.names
    ]

    def cost(both: Vector) -> tuple[float, Vector]:
        weights, own = both[:STATISTICS], both[STATISTICS:].reshape(-1, 3)
        value = RIDGE * float(weights @ weights) + RIDGE_OF_OWN * float(np.sum(own**2))
        slope, of_own = 2 * RIDGE * weights, 2 * RIDGE_OF_OWN * own
        for matrix, places, truth, counts in items:
            known = np.column_stack([np.ones(len(matrix)), matrix[:, -2:] * sizes[-2:]])
            utility = matrix @ weights + np.sum(known * own[places], axis=1)
            odds = np.exp(utility - utility.max())
            odds /= odds.sum()
            value -= counts * math.log(odds[truth] + 1e-300)
            odds[truth] -= 1.0
            slope = slope + counts * (matrix.T @ odds)
            np.add.at(of_own, places, counts * odds[:, None] * known)
        return value, np.append(slope, of_own)

    start = np.zeros(STATISTICS + 3 * len(names))
    best = minimize(cost, start, jac=True, method="L-BFGS-B", options={"maxiter": 500}).x
    own = best[STATISTICS:].reshape(-1, 3)
    return Weights(best[:STATISTICS] / sizes, dict(zip(names, own.tolist(), strict=True)))


def left_out(rows: list[Row], also: list[Row], names: list[str]) -> list[dict[str, float]]:
    """Probabilities of each record, by weights fitted without it."""
    fold = np.random.default_rng(0).integers(0, FOLDS, len(rows))
    found: list[dict[str, float]] = [{} for _ in rows]
    for k in range(FOLDS):
        seen = [r for r, f in zip(rows, fold, strict=True) if f != k]
        weights = fitted([*seen, *also], names)
        for j in np.flatnonzero(fold == k):
            found[j] = weights.of(rows[j])
    return found


def beyond_nothing(found: dict[str, float], of_none: float) -> dict[str, float]:
    """Reported probabilities: if an error is certain, they are conditional on an error."""
    if found[NOTHING] >= of_none:
        return found
    rest = 1.0 - found[NOTHING]
    return {n: 0.0 if n == NOTHING else p / rest for n, p in found.items()}


def threshold(truths: Iterable[float], share: float) -> float:
    """Probability below which the truth of this share of records lies (conformal quantile)."""
    ordered = sorted(truths)
    return ordered[max(int(np.floor(share * (len(ordered) + 1))) - 1, 0)]


def thresholds_of_members(rows: list[Row], told: list[dict[str, float]]) -> tuple[float, float]:
    """Smallest probabilities of members of a set: with a reported error, and without.

    Each group has its own threshold (Mondrian conformal prediction; V. Vovk, A. Gammerman and G.
    Shafer, "Algorithmic Learning in a Random World", 2005), so that records with weak effects do
    not enlarge the sets of records with clear effects. Faultless records with a reported error are
    missed for any first threshold; the second compensates for them.
    """
    truth = [max(t.get(n, 0.0) for n in r.allowed) for r, t in zip(rows, told, strict=True)]
    wrong = [t[NOTHING] == 0.0 for t in told]
    here = [p for p, w, r in zip(truth, wrong, rows, strict=True) if w and r.effect]
    something = threshold(here, 1 - COVERAGE)
    missed = sum(w and p < something for p, w in zip(truth, wrong, strict=True))
    rest = [p for p, w in zip(truth, wrong, strict=True) if not w]
    left = max((1 - COVERAGE) * len(rows) - missed, 1.0)
    return something, threshold(rest, left / len(rest))


def threshold_of_name(rows: list[Row], found: list[dict[str, float]]) -> float:
    """Smallest probability at which the most probable cause is named (conformal risk control).

    Few records get a wrong name, both with effects and faultless.
    """
    wrong: dict[bool, list[float]] = {True: [], False: []}
    for r, f in zip(rows, found, strict=True):
        first = max(f, key=lambda n: f[n])
        counts = first not in (NOTHING, OUTSIDE) and first not in r.allowed
        wrong[bool(r.effect)].append(f[first] if counts else 0.0)
    return max(_beyond(each) for each in wrong.values())


def _beyond(values: list[float]) -> float:
    ordered = sorted(values, reverse=True)
    allowed = int(np.floor(OF_NAMES * (len(ordered) + 1))) - 1
    return ordered[max(allowed, 0)] + 1e-9


def set_of(found: dict[str, float], least: float) -> list[str]:
    """Names of a set, the most probable first."""
    ordered = sorted(found, key=lambda n: -found[n])
    return [n for k, n in enumerate(ordered) if k == 0 or found[n] >= least]


def measured(
    rows: list[Row], sets: list[list[str]], ruled_out: list[bool], names: list[str]
) -> dict[str, Any]:
    """Coverage of sets, and share of right names; a name may be empty."""
    both = list(zip(rows, sets, ruled_out, strict=True))

    def of(which: Callable[[Row], bool], hit: Callable[[Row, list[str]], bool]) -> dict[str, Any]:
        return share([hit(r, s) for r, s, _ in both if which(r)])

    def named(which: Callable[[Row], bool], right: bool) -> dict[str, Any]:
        some = [(r, n) for r, n in zip(rows, names, strict=True) if which(r)]
        return share([bool(n) and (n in r.allowed) == right for r, n in some])

    sizes = [len(s) for r, s, _ in both if r.clear]
    return {
        "truth in the set": of(lambda r: True, lambda r, s: bool(r.allowed & set(s))),
        "truth in the set, clear effects": of(
            lambda r: r.clear, lambda r, s: bool(r.allowed & set(s))
        ),
        "mean number of suspects, clear effects": float(np.mean(sizes)) if sizes else None,
        "named rightly, clear effects": named(lambda r: r.clear, True),
        "named wrongly, of records with effects": named(lambda r: bool(r.effect), False),
        "named wrongly, faultless": named(lambda r: not r.effect, False),
        "at most two with the truth, clear effects": of(
            lambda r: r.clear, lambda r, s: len(s) <= 2 and bool(r.allowed & set(s))
        ),
        "the likeliest is right, clear effects": of(
            lambda r: r.clear, lambda r, s: s[0] in r.allowed
        ),
        "faultless, nothing is ruled out": share([out for r, _, out in both if not r.effect]),
        "clear effects, nothing is ruled out": share([out for r, _, out in both if r.clear]),
    }


def held(
    rows: list[Row], found: list[dict[str, float]], thresholds: dict[str, float]
) -> dict[str, Any]:
    """Coverage of sets with these thresholds, for records with these probabilities."""
    told = [beyond_nothing(f, thresholds["of_none"]) for f in found]
    out = [t[NOTHING] == 0.0 for t in told]
    sets = [
        set_of(t, thresholds["of_something" if wrong else "of_members"])
        for t, wrong in zip(told, out, strict=True)
    ]
    said = [
        s[0] if s[0] not in (NOTHING, OUTSIDE) and t[s[0]] >= thresholds["of_name"] else ""
        for s, t in zip(sets, told, strict=True)
    ]
    worlds = {}
    for world in sorted({r.world for r in rows}):
        here = [k for k, r in enumerate(rows) if r.world == world]
        worlds[world] = measured(*([part[k] for k in here] for part in (rows, sets, out, said)))
    order = sorted(worlds, key=lambda w: worlds[w]["truth in the set"]["share"])
    return {
        "records": len(rows),
        "seconds, median": float(np.median([r.seconds for r in rows])),
        "all worlds": measured(rows, sets, out, said),
        "worlds, the worst first": {w: worlds[w] for w in order},
        "rows": [
            {
                "world": r.world,
                "effect": r.effect,
                "seed": r.seed,
                "ratio": r.ratio,
                "named": n,
                "set": s,
            }
            for r, s, n in zip(rows, sets, said, strict=True)
        ],
    }


def report(rows: list[Row], also: list[Row]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The table, and the proof."""
    refused = sum(bool(r.message) for r in rows)
    rows, also = [r for r in rows if r.usable], [r for r in also if r.usable]
    names = sorted({n for r in [*rows, *also] for n in (*r.names, r.truth)})
    found = left_out(rows, also, names)
    of_none = threshold(
        (f[NOTHING] for r, f in zip(rows, found, strict=True) if not r.effect), OF_FAULTLESS
    )
    told = [beyond_nothing(f, of_none) for f in found]
    of_something, of_members = thresholds_of_members(rows, told)
    thresholds = {
        "of_none": of_none,
        "of_name": threshold_of_name(rows, told),
        "of_something": of_something,
        "of_members": of_members,
    }
    weights = fitted([*rows, *also], names)
    table = {
        "weights": [round(float(w), 6) for w in weights.weights],
        "own": {n: [round(w, 6) for w in own] for n, own in weights.own.items()},
        "thresholds": thresholds,
        "records": len(rows) + len(also),
    }
    proof = {
        "records that helped to fit the weights only": len(also),
        "refused or unusable": refused,
        **held(rows, found, thresholds),
    }
    return table, proof


def by_stored_table(rows: list[Row]) -> dict[str, Any]:
    """The proof for records that were not used for the stored table."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    refused = sum(bool(r.message) for r in rows)
    rows = [r for r in rows if r.usable]
    weights = Weights(np.array(table["weights"]), table["own"])
    found = [weights.of(r) for r in rows]
    return {"refused or unusable": refused, **held(rows, found, table["thresholds"])}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faultless", type=int, default=20, help="records of every world")
    parser.add_argument("--effects", type=int, default=40, help="records of every world")
    parser.add_argument("--first-seed", type=int, default=1_000_000)
    add_worker_options(parser)
    parser.add_argument(
        "--rows", type=Path, default=ROWS, help="kept rows; those there are not drawn again"
    )
    parser.add_argument("--fit", action="store_true", help="fit the table, and write it")
    parser.add_argument(
        "--also",
        type=Path,
        help="rows of other seeds, for the weights and not for what is measured",
    )
    parser.add_argument("--held-back", action="store_true", help="the worlds never calibrated with")
    options = parser.parse_args()
    if options.fit and options.held_back:
        parser.error("the worlds that are held back are not for the fit")
    worlds = tuple(w for w in WORLDS if (w in HELD_BACK) == options.held_back)
    rows = []
    if options.rows.exists():
        rows = [Row(**json.loads(line)) for line in options.rows.read_text().splitlines()]
    have = {(r.world, r.effect, r.seed) for r in rows}
    plan = plan_trials(0, options.first_seed, worlds, (options.faultless, options.effects))
    trials = [t for t in plan if (t.world, t.effect, t.seed) not in have]
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    jobs = iter([(t.key, (t,)) for t in trials])
    workers = open_workers(options)
    with options.rows.open("a", encoding="utf-8") as kept:
        for done, (_, row) in enumerate(workers.map(row_of, jobs), 1):
            rows.append(row)
            kept.write(json.dumps(asdict(row)) + "\n")
            kept.flush()
            print(f"\r{done} of {len(trials)}", end="", file=sys.stderr)
    if options.fit:
        also = []
        if options.also:
            also = [Row(**json.loads(line)) for line in options.also.read_text().splitlines()]
        table, told = report(rows, also)
        write_json(TABLE, table)
    else:
        told = by_stored_table(rows)
        name = "diagnosis_held_back" if options.held_back else "diagnosis_sets"
        seeds = sorted({r.seed for r in rows})
        write_json(
            TARGET.with_name(f"{name}.json"),
            {
                **provenance(name),
                "seeds": [seeds[0], seeds[-1]],
                "coverage_asked": COVERAGE,
                **told,
            },
        )
    print(json.dumps(told["all worlds"], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

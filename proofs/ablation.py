"""Contribution of each piece of the scores: the same records with one piece left out at a time.

The records are a random sample of those of a calibration. For each piece, the results are how often
a clearly visible true cause has the best score, how well the best score distinguishes faultless
records from such records (area under the receiver operating characteristic), and the time. Prints a
table, and writes ``docs/proof/ablation.json``::

    python proofs/ablation.py --first-seed 976000 --records 90
"""

from __future__ import annotations

import os

from ballscrew.solver.errors import BadRecord

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import json
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "ablation.json"

from provenance import provenance  # noqa: E402
from worlds import HELD_BACK, WORLDS, Unusable  # noqa: E402
from worlds_trials import VISIBLE, Trial, drawn, plan_trials, right_names, share  # noqa: E402

from ballscrew.measurement.diagnosis import bands, modelled_record, scores, study  # noqa: E402
from ballscrew.options import add_worker_options, open_workers  # noqa: E402
from ballscrew.solver.files import write_json  # noqa: E402


def _in_sample(fit: Callable[..., study.Fit]) -> Callable[..., study.Fit]:
    """A fit in which each block is evaluated with values fitted to all blocks."""

    def fitted(products: Any, cut: Any, prior: Any, exact: float) -> study.Fit:
        found = fit(products, cut, prior, exact)
        counts = cut.counts[:, cut.used]
        left = study._left(products, found.amplitude).transpose(1, 0, 2)
        known = np.hypot(left, counts * exact**2)
        variance = known.sum(axis=1) / counts.sum(axis=0)
        each = counts * np.log(variance)[:, None]
        each = each + (study.FREEDOM + counts) * np.log1p(
            known / (study.FREEDOM * variance[:, None])
        )
        return study.Fit(
            np.sum(-0.5 * study.trusted(counts) * each, axis=2),
            left,
            found.amplitude,
            found.error,
            found.ways,
            found.cost,
        )

    return fitted


PIECES: dict[str, list[tuple[Any, str, Any]]] = {
    "all pieces": [],
    "bands": [
        (bands, "EDGES", (0.0, np.inf)),
        (scores, "EDGES", (0.0, np.inf)),
    ],
    "blocks held out": [(module, "fitted", _in_sample(study.fitted)) for module in (scores, study)],
    "heavy tails": [(study, "FREEDOM", 1e6)],
    "a limit to what many numbers tell": [(study, "COARSE", 1e12)],
    "taking out the noise of instruments": [
        (scores, "noise_products", lambda s, c, own: np.zeros_like(own)),
        (study, "noise_products", lambda s, c, own: np.zeros_like(own)),
    ],
    "noise that is always there": [(study, "EXACT", 1e-6), (study, "COMMANDED", 0.0)],
    "a speed that follows within an interval": [(modelled_record, "_ANSWERS", np.inf)],
    "sizes between the points of grids": [(scores, "_REFINED", 0)],
}


@contextmanager
def without(piece: str) -> Iterator[None]:
    """Leave out a piece."""
    changes = [patch.object(*change) for change in PIECES[piece]]
    for change in changes:
        change.start()
    try:
        yield
    finally:
        for change in changes:
            change.stop()


@dataclass(frozen=True)
class Answer:
    """Result of the scores of one record without a piece."""

    first: str
    best: float
    seconds: float


def answers_of(trial: Trial) -> dict[str, Any] | None:
    """The truth of one record, and an answer without each piece; None without a record."""
    try:
        case = drawn(trial)
    except Unusable:
        return None
    if trial.effect and case.ratio <= VISIBLE:
        return None
    records, model = case.read()
    found: dict[str, Any] = {}
    for piece in PIECES:
        with without(piece):
            began = time.process_time()
            try:
                laid = study.study_of(records, model)
                suspects = scores.scored(scores.Catalogue(laid)).suspects
            except BadRecord:
                continue
            first = suspects[0] if suspects else None
            found[piece] = Answer(
                first.name if first else "",
                first.score if first else 0.0,
                time.process_time() - began,
            )
    right = sorted(right_names(trial.effect, case.shared)) if trial.effect else []
    return {"effect": trial.effect, "right": right, "answers": found}


def told_apart(faultless: list[float], clear: list[float]) -> float:
    """Probability that a clear effect has a better score than a faultless record."""
    pairs = np.subtract.outer(np.array(clear), np.array(faultless))
    return float(np.mean((pairs > 0) + 0.5 * (pairs == 0)))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faultless", type=int, default=12, help="records of every world")
    parser.add_argument("--effects", type=int, default=24, help="records of every world")
    parser.add_argument("--first-seed", type=int, default=976000)
    parser.add_argument("--records", type=int, default=90, help="of all of these")
    add_worker_options(parser)
    options = parser.parse_args()
    worlds = tuple(w for w in WORLDS if w not in HELD_BACK)
    plan = plan_trials(0, options.first_seed, worlds, (options.faultless, options.effects))
    trials = random.Random(0).sample(plan, options.records)
    jobs = iter([(t.key, (t,)) for t in trials])
    workers = open_workers(options)
    rows = []
    for done, (_, row) in enumerate(workers.map(answers_of, jobs), 1):
        if row is not None:
            rows.append(row)
        print(f"\r{done} of {len(trials)}", end="", file=sys.stderr)
    table = {}
    for piece in PIECES:
        known = [r for r in rows if piece in r["answers"]]
        clear = [r for r in known if r["effect"]]
        best = {
            bool(side): [r["answers"][piece].best for r in known if bool(r["effect"]) == side]
            for side in (True, False)
        }
        table[piece] = {
            "clear effects, the truth has the best score": share(
                [r["answers"][piece].first in r["right"] for r in clear]
            ),
            "clear and faultless told apart by the best score": told_apart(best[False], best[True]),
            "best score of 90 % of faultless records, at most": float(
                np.quantile(best[False], 0.9)
            ),
            "seconds, median": float(np.median([r["answers"][piece].seconds for r in known])),
        }
    write_json(
        TARGET,
        {
            **provenance("ablation"),
            "seeds": [options.first_seed, max(t.seed for t in trials)],
            "faultless records": sum(not r["effect"] for r in rows),
            "clear effects": sum(bool(r["effect"]) for r in rows),
            "without": table,
        },
    )
    print(json.dumps(table, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

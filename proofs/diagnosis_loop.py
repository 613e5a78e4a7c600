"""Proof: complete diagnoses of records of the worlds, before and after the proposed experiment.

Each record is diagnosed. The same machine of the world runs the proposed motion, and both records
are diagnosed together. Writes ``docs/proof/diagnosis_loop.json``: which causes are included, named
and in the set before and after, by world, and whether intervals contain the truth::

    python proofs/diagnosis_loop.py --effects 6 --faultless 3 --first-seed 960000
"""

from __future__ import annotations

import os

from ballscrew.solver.errors import BadParameters, BadRecord

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from provenance import provenance
from worlds import HELD_BACK, WORLDS, Case, Unusable, draw_case, more_of, write_case
from worlds import OUTSIDE as NOT_IN_CATALOGUE
from worlds.cases import write_record
from worlds_trials import VISIBLE, Trial, plan_trials, right_names, share

from ballscrew.measurement.diagnosis.diagnose import diagnose
from ballscrew.measurement.diagnosis.diagnosis import Diagnosis
from ballscrew.options import add_worker_options, open_workers
from ballscrew.solver.files import write_json

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "diagnosis_loop.json"
ROWS = ROOT / "out" / "diagnosis_loop.jsonl"


@dataclass(frozen=True)
class Answer:
    """Summary of a diagnosis."""

    verdict: str
    built: list[str]
    certain: list[str]
    suspects: list[str]
    asked: str
    holds: list[bool]
    seconds: float


@dataclass(frozen=True)
class Row:
    """One machine: its truth, and the answers without and with the experiment."""

    world: str
    effect: str
    seed: int
    ratio: float = 0.0
    shared: list[str] = field(default_factory=list)
    before: Answer | None = None
    after: Answer | None = None
    message: str = ""

    @property
    def allowed(self) -> set[str]:
        """The true cause, and causes with the same shape in this record."""
        return right_names(self.effect, self.shared)

    @property
    def clear(self) -> bool:
        """Whether the truth shows a cause or a signal clearly."""
        known = bool(self.effect) and self.effect not in NOT_IN_CATALOGUE
        return self.before is not None and known and self.ratio > VISIBLE


def row_of(trial: Trial) -> Row:
    """Draw a machine, diagnose its record, run the experiment, diagnose both records."""
    told = (trial.world, trial.effect, trial.seed)
    try:
        case = draw_case(trial.world, (trial.effect,) if trial.effect else (), trial.seed)
    except Unusable as reason:
        return Row(*told, message=str(reason))
    sight = case.sights[0] if case.sights else None
    seen = (sight.ratio, list(sight.shared)) if sight else (0.0, [])
    with tempfile.TemporaryDirectory() as folder:
        paths, believed = write_case(case, Path(folder))
        try:
            first, before = _answer(case, paths, believed)
            if first.next_experiment is None:
                return Row(*told, *seen, before, before)
            motion = first.next_experiment.motion
            more = more_of(case, {"time": motion.time, motion.reference: motion.values})
            paths = [*paths, write_record(more, Path(folder) / "more.csv")]
            return Row(*told, *seen, before, _answer(case, paths, believed)[1])
        except (BadRecord, BadParameters, Unusable) as reason:
            return Row(*told, *seen, message=str(reason).replace(folder, "").strip())


def _answer(case: Case, paths: list[Path], believed: Path) -> tuple[Diagnosis, Answer]:
    began = time.process_time()
    found = diagnose(paths, params=believed)
    truth = case.effects[0].truth if case.effects else {}
    holds = [
        bool(low <= truth[n] <= high)
        for c in found.causes
        if case.effects and c.name == _name(case)
        for n, (low, high) in c.intervals.items()
        if n in truth
    ]
    asked = found.next_experiment
    return found, Answer(
        found.verdict,
        [c.name for c in found.causes],
        [c.name for c in found.causes if c.certain],
        [s.name for s in found.suspects],
        asked.motion.kind if asked else "",
        holds,
        time.process_time() - began,
    )


def _name(case: Case) -> str:
    return str(case.effects[0].name)


def measured(rows: list[Row], when: str) -> dict[str, Any]:
    """Statistics of the answers ``before`` or ``after`` the experiment."""
    usable = [(r, getattr(r, when)) for r in rows if getattr(r, when) is not None]

    def of(which: Callable[[Row], bool], hit: Callable[[Row, Answer], bool]) -> dict[str, Any]:
        return share([hit(r, a) for r, a in usable if which(r)])

    def in_answer(r: Row, a: Answer) -> bool:
        return bool(r.allowed & {*a.built, *a.suspects})

    sizes = [len(a.built) + len(a.suspects) for r, a in usable if r.clear]
    return {
        "clear effects, first built in is right": of(
            lambda r: r.clear, lambda r, a: bool(a.built) and a.built[0] in r.allowed
        ),
        "clear effects, named rightly": of(
            lambda r: r.clear, lambda r, a: bool(r.allowed & set(a.certain))
        ),
        "clear effects, truth in the answer": of(lambda r: r.clear, in_answer),
        "clear effects, truth among at most two": of(
            lambda r: r.clear,
            lambda r, a: in_answer(r, a) and len(a.built) + len(a.suspects) <= 2,
        ),
        "clear effects, mean number of names and suspects": float(np.mean(sizes or [0])),
        "effects, a wrong name": of(
            lambda r: bool(r.effect), lambda r, a: bool(set(a.certain) - r.allowed)
        ),
        "faultless, a name": of(lambda r: not r.effect, lambda r, a: bool(a.certain)),
        "faultless, anything but none": of(
            lambda r: not r.effect, lambda r, a: a.verdict not in ("none", "undecided")
        ),
        "intervals of right causes that hold the truth": share(
            [h for _, a in usable for h in a.holds]
        ),
        "processor seconds, median": float(np.median([a.seconds for _, a in usable] or [0])),
    }


def report(rows: list[Row]) -> dict[str, Any]:
    """Content of the proof file."""
    worlds = sorted({r.world for r in rows})
    return {
        "records": len(rows),
        "refused or unusable": [
            f"{r.world}:{r.effect or 'faultless'}:{r.seed}: {r.message}" for r in rows if r.message
        ],
        "before": measured(rows, "before"),
        "after": measured(rows, "after"),
        "worlds": {
            w: {k: measured([r for r in rows if r.world == w], k) for k in ("before", "after")}
            for w in worlds
        },
        "rows": [asdict(r) for r in rows],
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faultless", type=int, default=60, help="records of every world")
    parser.add_argument("--effects", type=int, default=120, help="records of every world")
    parser.add_argument("--first-seed", type=int, default=960000)
    parser.add_argument("--held-back", action="store_true", help="the worlds never calibrated with")
    add_worker_options(parser)
    parser.add_argument("--rows", type=Path, default=ROWS, help="kept rows, not drawn again")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    worlds = tuple(w for w in WORLDS if (w in HELD_BACK) == options.held_back)
    rows = []
    if options.rows.exists():
        rows = [_read(line) for line in options.rows.read_text().splitlines()]
    have = {(r.world, r.effect, r.seed) for r in rows}
    plan = plan_trials(0, options.first_seed, worlds, (options.faultless, options.effects))
    trials = [t for t in plan if (t.world, t.effect, t.seed) not in have]
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    with options.rows.open("a", encoding="utf-8") as kept:
        jobs = iter([(t.key, (t,)) for t in trials])
        workers = open_workers(options)
        for done, (_, row) in enumerate(workers.map(row_of, jobs), 1):
            rows.append(row)
            kept.write(json.dumps(asdict(row)) + "\n")
            kept.flush()
            print(f"\r{done} of {len(trials)}", end="", file=sys.stderr)
    told = report(rows)
    seeds = sorted({r.seed for r in rows})
    write_json(
        options.out, {**provenance("diagnosis_loop"), "seeds": [seeds[0], seeds[-1]], **told}
    )
    print(json.dumps({k: told[k] for k in ("records", "before", "after")}, indent=1))
    return 0


def _read(line: str) -> Row:
    told = json.loads(line)
    for when in ("before", "after"):
        told[when] = Answer(**told[when]) if told[when] else None
    return Row(**told)


if __name__ == "__main__":
    sys.exit(main())

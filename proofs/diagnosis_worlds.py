"""Proof: the diagnosis is right, or says nothing, in worlds that another hand has made.

Writes ``docs/proof/diagnosis_worlds.json`` (commit, date, code, seeds, what is required and what
was found with Wilson's bounds, the matrices, the worst world first, every trial) and a confusion
matrix of each world. Trials go one by one into ``out/diagnosis_worlds``; ``--resume`` keeps
those of the same code. A small sample of every world::

    python proofs/diagnosis_worlds.py --each 1 --first-seed 1 --out out/sample.json
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; the workers are the threads

import argparse
import hashlib
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, kstest

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "diagnosis_worlds.json"
ROWS = ROOT / "out" / "diagnosis_worlds"

from provenance import git  # noqa: E402
from worlds import CATALOGUE, SIGNALS, WORLDS, draw_case  # noqa: E402
from worlds import OUTSIDE as NOT_IN_CATALOGUE  # noqa: E402
from worlds_trials import (  # noqa: E402
    CAUSE,
    EACH,
    FAILED,
    FAULTLESS,
    FIRST_SEED,
    OUTSIDE,
    REFUSED,
    SIGNAL,
    UNUSABLE,
    VISIBLE,
    Row,
    Trial,
    plan_trials,
    run_trial,
)

import ballscrew  # noqa: E402
from ballscrew.diagnosis.faultless import RecordKind, share_alike  # noqa: E402
from ballscrew.orchestration.kept_parts import KeptParts  # noqa: E402
from ballscrew.orchestration.pictures import STYLE, new_figure, write_figure  # noqa: E402
from ballscrew.orchestration.workers import Processes  # noqa: E402
from ballscrew.solver.files import write_json  # noqa: E402

OFTEN = 20  # trials after which the file is written anew
_LEVELS = (0.01, 0.05, 0.2, 0.5)  # of p-values
INTERVALS = 100  # at least so many have to be judged


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """Wilson's interval of a share, 95 %."""
    interval = binomtest(hits, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Requirement:
    """A share of hits in some trials, and how large or small it has to be."""

    text: str
    hits: Callable[[Iterable[Row]], list[bool]]
    least: float | None = None
    most: float | None = None
    at_least_trials: int = 1

    def judge(self, rows: Iterable[Row]) -> dict[str, object]:
        """The share, its bounds, and whether it is met."""
        found = self.hits(rows)
        count = len(found)
        share = sum(found) / count if count else None
        met = share is not None and count >= self.at_least_trials
        if share is not None and self.least is not None:
            met = met and share >= self.least
        if share is not None and self.most is not None:
            met = met and share <= self.most
        return {
            "requirement": self.text,
            **({"least": self.least} if self.least is not None else {"most": self.most}),
            "trials": count,
            "at_least_trials": self.at_least_trials,
            "hits": sum(found),
            "share": share,
            "wilson_95": list(wilson(sum(found), count)) if count else None,
            "met": met,
        }


def of_world(name: str) -> Iterator[Requirement]:
    """What is asked in every world."""

    def here(rows: Iterable[Row]) -> list[Row]:
        return [r for r in rows if r.world == name and r.verdict != UNUSABLE]

    def faultless(rows: Iterable[Row]) -> list[bool]:
        return [r.wrong for r in here(rows) if r.group == FAULTLESS]

    def wrong(rows: Iterable[Row]) -> list[bool]:
        return [r.wrong for r in here(rows) if r.group != FAULTLESS]

    def answered(rows: Iterable[Row]) -> list[bool]:
        return [bool(r.said) for r in here(rows) if r.visible]

    def right(rows: Iterable[Row]) -> list[bool]:
        return [r.right_first for r in here(rows) if r.visible and r.said]

    yield Requirement(f"{name}: faultless records with a name", faultless, most=2 / 60)
    yield Requirement(f"{name}: records with effects given a wrong name", wrong, most=0.04)
    yield Requirement(f"{name}: of visible effects, answered", answered, least=0.5)
    yield Requirement(f"{name}: of those answers, right name first", right, least=0.9)


def of_all() -> Iterator[Requirement]:
    """What is asked of all worlds together."""

    def faultless(rows: Iterable[Row]) -> list[bool]:
        return [r.wrong for r in rows if r.group == FAULTLESS and r.verdict != UNUSABLE]

    def held(rows: Iterable[Row]) -> list[bool]:
        return [hit for r in rows for hit in r.held()]

    yield Requirement("all worlds: faultless records with a name", faultless, most=0.02)
    yield Requirement(
        "all worlds: 95 % intervals of right names hold the truth",
        held,
        least=0.9,
        at_least_trials=INTERVALS,
    )


def requirements(worlds: Iterable[str]) -> list[Requirement]:
    """All that is asked."""
    return [*of_all(), *(r for name in worlds for r in of_world(name))]


def badness(rows: Iterable[Row]) -> float:
    """How bad a world is: the share of its records with a wrong name."""
    usable = [r for r in rows if r.verdict != UNUSABLE]
    return sum(r.wrong for r in usable) / max(len(usable), 1)


def worst_first(rows: list[Row]) -> list[str]:
    """The worlds that have trials, the worst one first."""
    worlds = [w for w in WORLDS if any(r.world == w for r in rows)]
    return sorted(worlds, key=lambda w: -badness(r for r in rows if r.world == w))


def p_values(rows: list[Row], world: str, third_party: bool) -> list[float]:
    """Of a world's faultless records, each told by all others, or by those of other worlds only."""
    faultless = [r for r in rows if r.group == FAULTLESS and r.evidence is not None]
    known = np.array([[r.evidence, *r.kind] for r in faultless])
    found = []
    for k, row in enumerate(faultless):
        if row.world != world:
            continue
        others = [
            j for j, r in enumerate(faultless) if (r.world != world if third_party else j != k)
        ]
        if others:
            found.append(share_alike(known[k, 0], RecordKind(*row.kind), known[others]))
    return found


def uniformity(found: list[float]) -> dict[str, object]:
    """How even p-values are: shares below levels, and Kolmogorov's test."""
    if not found:
        return {"records": 0}
    test = kstest(found, "uniform")
    return {
        "records": len(found),
        "share_at_most": {f"{a:g}": float(np.mean(np.array(found) <= a)) for a in _LEVELS},
        "kolmogorov_distance": float(test.statistic),
        "kolmogorov_p": float(test.pvalue),
    }


def matrix_of(rows: list[Row], world: str) -> dict[str, dict[str, int]]:
    """First answers by truth, of one world."""
    here = [r for r in rows if r.world == world and r.verdict != UNUSABLE]
    known = ("", *CATALOGUE, *NOT_IN_CATALOGUE, *SIGNALS)
    truths = [n for n in known if any(r.effect == n for r in here)]
    return {n or FAULTLESS: dict(Counter(r.first for r in here if r.effect == n)) for n in truths}


def by_condition(rows: list[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """Wrong names by what else is in the records: where the trouble lives."""
    table: dict[str, dict[str, dict[str, float]]] = {}
    for what in ("law", "loop", "excitation", "command", "encoder", "current", "noise", "sampling"):
        groups: dict[str, list[Row]] = {}
        for row in rows:
            if row.conditions:
                groups.setdefault(str(row.conditions[what]), []).append(row)
        table[what] = {
            value: {"trials": len(group), "wrong": sum(r.wrong for r in group)}
            for value, group in sorted(groups.items())
        }
    return table


def excused(rows: list[Row]) -> dict[str, int]:
    """What is counted as wrong though the truth finds the named cause's shape in the record."""
    return {
        group: sum(r.group == group and bool(r.said) and set(r.said) <= {r.effect, *r.shared}
                   and r.wrong for r in rows)
        for group in (CAUSE, OUTSIDE, SIGNAL)
    }  # fmt: skip


def code_digest() -> str:
    """One number for all code that an answer or a record depends on."""
    digest = hashlib.sha256()
    package, proofs = Path(ballscrew.__file__).parent, ROOT / "proofs"
    files = [(package, f) for f in sorted(package.rglob("*.py"))]
    files += [(proofs, f) for f in sorted((proofs / "worlds").glob("*.py"))]
    files.append((proofs, proofs / "worlds_trials.py"))
    for base, path in files:
        digest.update(str(path.relative_to(base)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def fields_of(trial: Trial) -> dict[str, object]:
    return asdict(run_trial(trial))


def report_of(rows: list[Row], code: str, first_seed: int) -> dict[str, object]:
    """All that is written."""
    rows = sorted(rows, key=lambda r: r.key)
    order = worst_first(rows)
    judged = [r.judge(rows) for r in requirements(order)]
    seconds = [r.seconds for r in rows if r.verdict != UNUSABLE]
    return {
        "commit": git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"),
        "committed": git("show", "-s", "--format=%cI", "HEAD"),
        "worlds_commit": git("log", "-1", "--format=%H", "--", "proofs/worlds"),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "code": code,
        "first_seed": first_seed,
        "trials": len(rows),
        "all_met": all(j["met"] for j in judged),
        "requirements": judged,
        "worst_world_first": {
            world: {
                "wrong": badness(r for r in rows if r.world == world),
                "first_answers": matrix_of(rows, world),
            }
            for world in order
        },
        **{
            title: {
                "all worlds": uniformity(
                    [p for w in order for p in p_values(rows, w, third_party)]
                ),
                **{world: uniformity(p_values(rows, world, third_party)) for world in order},
            }
            for title, third_party in (
                ("p_values_of_faultless_records", False),
                ("p_values_told_by_other_worlds", True),
            )
        },
        "wrong_by_condition": by_condition(rows),
        "wrong_though_of_the_same_shape_by_the_truth": excused(rows),
        "processor_seconds": {
            "median": float(np.median(seconds)) if seconds else None,
            "longest": max(seconds, default=None),
        },
        **{
            verdict: [r.key for r in rows if r.verdict == verdict]
            for verdict in (FAILED, REFUSED, UNUSABLE)
        },
        "rows": [asdict(r) for r in rows],
    }


def save_matrices(rows: list[Row], target: Path) -> None:
    """A picture of each world's matrix beside the report."""
    for world in worst_first(rows):
        matrix = matrix_of(rows, world)
        answers = [*CATALOGUE, "none", "unexplained"]
        answers += sorted({a for row in matrix.values() for a in row} - set(answers))
        counts = np.array([[row.get(a, 0) for a in answers] for row in matrix.values()])
        draw_confusion(list(matrix), answers, counts, target.with_name(f"{target.stem}_{world}"))


def draw_confusion(
    truths: list[str], answers: list[str], counts: NDArray[np.int_], target: Path
) -> None:
    """Write a picture of counts, shape (truths, answers), in per cent of each row."""
    import matplotlib as mpl

    share = 100 * counts / counts.sum(1, keepdims=True)
    with mpl.rc_context(STYLE):
        figure, ((axes,),) = new_figure(1, 1, (13, 1.6 + 0.42 * len(truths) + 2.2))
        axes.imshow(share, cmap="Blues", vmin=0, vmax=100, aspect="auto")
        axes.grid(False)
        for (row, column), value in np.ndenumerate(share):
            if value > 0:
                colour = "white" if value > 60 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", color=colour)
        words = ["nothing" if a == "none" else a.replace("_", " ") for a in answers]
        axes.set_xticks(range(len(answers)), words, rotation=55, ha="right")
        labels = [
            f"{t.replace('_', ' ')}  ({n})" for t, n in zip(truths, counts.sum(1), strict=True)
        ]
        axes.set_yticks(range(len(truths)), labels)
        axes.set_xlabel("named first")
        axes.set_ylabel("hidden (trials)")
        axes.set_title("What the diagnosis names first, in per cent of the trials of each effect")
        write_figure(figure, target.parent, target.name)


def tell(rows: list[Row]) -> bool:
    """Print what is required and what was found, worst world first; whether all of it is met."""
    judged = [r.judge(rows) for r in requirements(worst_first(rows))]
    for j in judged:
        bound = f"at least {j['least']:.1%}" if "least" in j else f"at most {j['most']:.1%}"
        between = ""
        if j["wilson_95"]:
            low, high = wilson(int(str(j["hits"])), int(str(j["trials"])))
            between = f" ({low:.1%} to {high:.1%})"
        print(
            f"{'met  ' if j['met'] else 'SHORT'} {j['requirement']}: {j['hits']} of {j['trials']}"
            f"{between}, {bound}"
        )
    for verdict in (REFUSED, FAILED, UNUSABLE):
        count = sum(r.verdict == verdict for r in rows)
        print(f"{verdict}: {count} of {len(rows)} records")
    return all(bool(j["met"]) for j in judged)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", choices=list(WORLDS), help="only this one")
    parser.add_argument("--each", type=int, default=EACH, help="records of every cause and world")
    parser.add_argument(
        "--at-least",
        type=int,
        nargs=2,
        default=(0, 0),
        metavar=("FAULTLESS", "EFFECTS"),
        help="records of every world",
    )
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--resume", action="store_true", help="keep the trials done before")
    parser.add_argument("--rows", type=Path, default=ROWS, help="folder of trials, each a file")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    if options.each < 1:
        parser.error(f"--each is {options.each}, expected at least 1")
    worlds = (options.world,) if options.world else tuple(WORLDS)
    at_least = (options.at_least[0], options.at_least[1])
    trials = plan_trials(options.each, options.first_seed, worlds, at_least)
    code = code_digest()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    parts = KeptParts(options.rows, code)
    draw_case("fast_screw", ("load_bias",), 0)  # compiled once, before there are several processes
    jobs = {f"{t.key}.json": (t,) for t in trials}
    if not options.resume:
        for name in jobs:
            (options.rows / name).unlink(missing_ok=True)
    rows: list[Row] = []
    for _, found in parts.results(jobs, fields_of, Processes(options.workers)):
        row = Row(**found)
        rows.append(row)
        mark = "WRONG" if row.wrong else "right" if row.right_first else "silent"
        answer = ", ".join(row.said) or row.message or row.verdict
        print(
            f"{len(rows)} of {len(trials)}: {row.key} (ratio {row.ratio:.1f}) {mark}: {answer}",
            file=sys.stderr,
            flush=True,
        )
        if len(rows) % OFTEN == 0:
            write_json(options.out, report_of(rows, code, options.first_seed))
    write_json(options.out, report_of(rows, code, options.first_seed))
    save_matrices(rows, options.out)
    print(f"ratio from which an answer is asked for: {VISIBLE:g}")
    return 0 if tell(rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())

"""Proof: the diagnosis finds effects that an independent generator hides, and names no others.

Writes ``docs/proof/diagnosis.json`` (commit, the generator's commit, seeds, shares with Wilson's
bounds against what is required, every trial) and the confusion matrix beside it. The trials go one
by one into ``out/diagnosis.jsonl``; ``--resume`` takes those that are there. Trials of other code,
of the diagnosis or of the generator, are not taken.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; the workers are the threads

import argparse
import hashlib
import math
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from hidden.cases import CATALOGUE, OUTSIDE, draw_case
from hidden.trials import (
    CAUSE,
    NONE,
    NOTHING,
    OUT,
    PAIR,
    SAMPLED,
    SHAPE,
    Row,
    Trial,
    plan_trials,
    run_trial,
)
from numpy.typing import NDArray
from provenance import git, provenance
from resumed_trials import read_rows, run_all
from scipy.stats import binomtest

from ballscrew.orchestration.pictures import STYLE, new_figure, write_figure
from ballscrew.solver.files import write_json

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "proof" / "diagnosis.json"
ROWS = ROOT / "out" / "diagnosis.jsonl"
GENERATOR = [f"proofs/hidden/{n}.py" for n in ("effects", "signal", "excitations", "cases")]
OFTEN = 20  # trials after which the file is written anew
EXCUSED_AT_MOST = 0.10


@dataclass(frozen=True)
class Requirement:
    """A share of some trials, and how large or small it has to be."""

    text: str
    trials: Callable[[Row], bool]
    hit: Callable[[Row], bool]
    least: float | None = None
    most: float | None = None

    def judge(self, rows: Iterable[Row]) -> dict[str, object]:
        """The share, its bounds, and whether it is met."""
        of = [r for r in rows if self.trials(r)]
        hits = sum(self.hit(r) for r in of)
        share = hits / len(of) if of else math.nan
        met = bool(of) and (
            share >= self.least if self.least is not None else share <= (self.most or 0.0)
        )
        return {
            "requirement": self.text,
            "least" if self.least is not None else "most": self.least or self.most,
            "trials": len(of),
            "hits": hits,
            "share": share if of else None,
            "wilson_95": list(wilson(hits, len(of))) if of else None,
            "met": met,
        }


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """Wilson's interval of a share, 95 %."""
    interval = binomtest(hits, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def _right(row: Row) -> bool:
    return row.right


def _wrongly_named(row: Row) -> bool:
    return row.wrong_name or bool(row.failure)


def requirements() -> Iterator[Requirement]:
    """What is asked of the diagnosis."""

    def of_group(group: str) -> Callable[[Row], bool]:
        return lambda row: row.group == group

    for name in CATALOGUE:
        yield Requirement(
            f"{name}: right cause first",
            lambda row, name=name: row.group == CAUSE and row.effects == [name],
            _right,
            least=0.85,
        )
    yield Requirement("every cause: right cause first", of_group(CAUSE), _right, least=0.95)
    yield Requirement("nothing hidden: called something", of_group(NONE), _wrongly_named, most=0.02)
    yield Requirement(
        "effects outside the catalogue: given a wrong name",
        of_group(OUT),
        _wrongly_named,
        most=0.05,
    )
    yield Requirement("two effects: both found", of_group(PAIR), _right, least=0.80)
    yield Requirement(
        "scored by what the generator computes (same force, out of reach)",
        lambda row: True,
        lambda row: row.by in ("same_force", "out_of_reach"),
        most=EXCUSED_AT_MOST,
    )


def code_digest() -> str:
    """One number for this project's code that an answer depends on: all that is loaded for it."""
    ask = (
        "import sys, hidden.trials, ballscrew.diagnosis.diagnose\n"
        "ours = ('ballscrew.', 'hidden.')\n"
        "print(*(m.__file__ for n, m in sys.modules.items() if n.startswith(ours) and m.__file__))"
    )
    proofs = ROOT / "proofs"
    told = subprocess.run(
        [sys.executable, "-c", ask], capture_output=True, text=True, check=True, cwd=proofs
    )
    digest = hashlib.sha256()
    for path in sorted(map(Path, told.stdout.split()), key=lambda p: p.parts[-2:]):
        digest.update("/".join(path.parts[-2:]).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def report_of(rows: list[Row]) -> dict[str, object]:
    """All that is written."""
    rows = sorted(rows, key=lambda r: ((CAUSE, NONE, OUT, PAIR).index(r.group), r.effects, r.seed))
    judged = [r.judge(rows) for r in requirements()]
    seconds = np.array([r.seconds for r in rows])
    return {
        **provenance("diagnosis"),
        "code": code_digest(),
        "generator_commit": git("log", "-1", "--format=%H", "--", *GENERATOR),
        "trials": len(rows),
        "all_met": all(j["met"] for j in judged),
        "requirements": judged,
        "two_effects_found_or_said_to_be_confused": _pairs_told(rows),
        "generator_could_have_excused": {
            name: _share(
                [bool(r.same_force or r.out_of_reach) for r in rows if r.effects == [name]]
            )
            for name in (*CATALOGUE, *OUTSIDE)
        },
        "generator_excused": {
            by: sum(r.by == by for r in rows) for by in ("same_force", "out_of_reach")
        },
        "outside_named_and_called_explained": sum(
            r.group == OUT and bool(r.named) and r.verdict == "explained" for r in rows
        ),
        "nothing_hidden_called_unexplained": sum(
            r.group == NONE and r.first == SHAPE for r in rows
        ),
        "right_by_condition": {
            "with_current": _share([r.right for r in rows if r.with_current]),
            "without_current": _share([r.right for r in rows if not r.with_current]),
            "exact_parameters": _share([r.right for r in rows if r.exact]),
            "parameters_off": _share([r.right for r in rows if not r.exact]),
            **{
                excitation: _share([r.right for r in rows if r.excitation == excitation])
                for excitation in sorted({r.excitation for r in rows})
            },
        },
        "seconds_of_one_diagnosis": {
            "median": float(np.median(seconds)),
            "longest": float(seconds.max()),
        },
        "failures": [r.key for r in rows if r.failure],
        "rows": [asdict(r) for r in rows],
    }


def _pairs_told(rows: list[Row]) -> dict[str, object]:
    """Pairs of which both are named, or in the answer's words cannot be told from what is named.

    Nothing is required of it: the share of pairs about which the answer says nothing wrong.
    """

    def told(row: Row) -> bool:
        said = {*row.named, *(name for others in row.confused_with for name in others)}
        return set(row.effects) <= said

    pairs = [r for r in rows if r.group == PAIR]
    hits = sum(told(r) for r in pairs)
    bounds = list(wilson(hits, len(pairs))) if pairs else None
    return {"trials": len(pairs), "hits": hits, "wilson_95": bounds}


def _share(hits: list[bool]) -> float | None:
    return sum(hits) / len(hits) if hits else None


def save_confusion(rows: list[Row], folder: Path) -> None:
    """The first answer against the truth, in per cent of each truth's trials."""
    single = [r for r in rows if r.group != PAIR]
    truths = [n for n in (*CATALOGUE, "none", *OUTSIDE) if any(r.effects == [n] for r in single)]
    answers = [*CATALOGUE, NOTHING, SHAPE]
    answers += sorted({r.first for r in single} - set(answers))
    counts = np.array(
        [[sum(r.effects == [t] and r.first == a for r in single) for a in answers] for t in truths]
    )
    draw_confusion(truths, answers, counts, folder / "diagnosis_confusion")


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
        axes.set_xticks(range(len(answers)), [_words(a) for a in answers], rotation=55, ha="right")
        labels = [f"{_words(t)}  ({n})" for t, n in zip(truths, counts.sum(1), strict=True)]
        axes.set_yticks(range(len(truths)), labels)
        axes.set_xlabel("named first")
        axes.set_ylabel("hidden (trials)")
        axes.set_title("What the diagnosis names first, in per cent of the trials of each effect")
        write_figure(figure, target.parent, target.name)


def _words(name: str) -> str:
    return {NOTHING: "nothing"}.get(name, name.replace("_", " "))


def in_turn(trials: list[Trial]) -> list[Trial]:
    """All groups and causes side by side, so that what is done first is a sample of all."""
    kinds: dict[tuple[str, str], list[Trial]] = {}
    for t in trials:
        kinds.setdefault((t.group, t.effects[0] if t.group == CAUSE else ""), []).append(t)
    places = [(k / len(kind), t) for kind in kinds.values() for k, t in enumerate(kind)]
    return [t for _, t in sorted(places, key=lambda p: p[0])]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=SAMPLED, help="of every cause")
    parser.add_argument("--only", help="a cause, an effect outside the catalogue, or a group")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--resume", action="store_true", help="keep the trials done before")
    parser.add_argument("--rows", type=Path, default=ROWS, help="trials, one a line")
    parser.add_argument("--out", type=Path, default=TARGET)
    options = parser.parse_args()
    trials = plan_trials(options.cases, options.only)
    if not trials:
        parser.error(
            f"--only is {options.only!r}, expected one of {', '.join(CATALOGUE)}, "
            f"{', '.join(OUTSIDE)}, {CAUSE}, {NONE}, {OUT} or {PAIR}"
        )
    code = code_digest()
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    keys = {t.key for t in trials}
    rows = read_rows(options.rows, code, keys, Row) if options.resume else []
    if not options.resume:
        options.rows.unlink(missing_ok=True)
    done = {r.key for r in rows}
    left = [t for t in in_turn(trials) if t.key not in done]
    draw_case(("none",), 0)  # compiled once, before there are several processes
    coming = run_all(left, run_trial, options.workers, options.rows, code)
    for count, row in enumerate(coming, start=1):
        rows.append(row)
        answer = ", ".join(row.named) or row.failure or row.verdict
        mark = "right" if row.right else "WRONG"
        print(f"{len(rows)} of {len(trials)}: {row.key} {mark}: {answer}", file=sys.stderr)
        if count % OFTEN == 0:
            write_json(options.out, report_of(rows))
    report = report_of(rows)
    write_json(options.out, report)
    save_confusion(rows, options.out.parent)
    return 0 if tell(rows) else 1


def tell(rows: list[Row]) -> bool:
    """Print what is required and what was found; whether all of it is met."""
    met = True
    for requirement in requirements():
        judged = requirement.judge(rows)
        if not judged["trials"]:
            continue
        low, high = wilson(int(str(judged["hits"])), int(str(judged["trials"])))
        sign = "at least" if requirement.least is not None else "at most"
        print(
            f"{'met ' if judged['met'] else 'SHORT'} {requirement.text}: {judged['hits']} of "
            f"{judged['trials']} ({low:.1%} to {high:.1%}), {sign} "
            f"{requirement.least or requirement.most:.0%}"
        )
        met &= bool(judged["met"])
    return met


if __name__ == "__main__":
    raise SystemExit(main())

"""Run a proof and store its result: ``python proofs/runner.py NAME``.

A proof is a module with four functions. `tasks(asked)` gives the arguments of each task by its
name, `trial` computes one, `report` sums up the results of all (``holds`` says whether the claim
does), and `says` is its sentence. A run that was interrupted goes on from ``out/proofs``, if the
commit is the same and no file differs from it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy; workers run in parallel

import argparse
import importlib
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ballscrew.options import add_worker_options, open_workers
from ballscrew.solver.errors import UserError
from ballscrew.solver.files import finite_or_null, write_atomically

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "support"))
FOLDER, PARTIAL = ROOT / "docs" / "proof", ROOT / "out" / "proofs"
WIDTH = 100  # of a line of a stored file
PROOFS = {  # name: module, whose first line is the claim, and minutes on two cores
    "trusted_loops": ("verdict.loops", 30),
    "networks": ("verdict.networks", 15),
    "identification": ("identification.intervals", 60),
    "variational": ("verdict.exponents", 15),
    "diagnosis_rule": ("diagnosis.rule", 60),
    "emps": ("diagnosis.emps", 5),
    "tro2021": ("identification.tro2021", 5),
    "own_records": ("diagnosis.own_records", 30),
    "practice": ("verdict.practice", 30),
    "swap_study": ("verdict.swap_study", 20),
    "exchange": ("verdict.exchange", 10),
    "fuzz": ("fuzz", 30),
    "interrupts": ("interrupts", 60),
    "thesis": ("thesis", 30),
    "tools": ("interoperability.tools", 30),
    "made_by_others": ("interoperability.made_by_others", 10),
    "modelica": ("interoperability.modelica", 10),
}

Row = dict[str, Any]


def git(*arguments: str) -> str:
    """Output of git; an empty string outside a checkout."""
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, cwd=ROOT)
    return done.stdout.strip()


def provenance(arguments: Sequence[str]) -> dict[str, str]:
    """Where a result comes from; `commit` ends in ``-dirty`` if files outside docs/ differ."""
    commit = git("rev-parse", "HEAD")
    if git("status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude)docs"):
        commit += "-dirty"
    committed = git("show", "-s", "--format=%cI", "HEAD")
    command = " ".join(["python proofs/runner.py", *arguments])
    return {"commit": commit, "committed": committed, "command": command}


def stored(name: str) -> Row:
    report: Row = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return report


def upper(found: int, trials: int, confidence: float = 0.95) -> float:
    """One-sided Clopper-Pearson upper bound of a rate."""
    from scipy.stats import beta

    return float(beta.ppf(confidence, found + 1, trials - found)) if found < trials else 1.0


def lower(found: int, trials: int, confidence: float = 0.95) -> float:
    """One-sided Clopper-Pearson lower bound of a rate."""
    return 1.0 - upper(trials - found, trials, confidence)


def share(hits: Sequence[bool]) -> Row:
    """A share with Wilson's bounds."""
    from scipy.stats import binomtest

    if not hits:
        return {"records": 0}
    interval = binomtest(sum(hits), len(hits)).proportion_ci(method="wilson")
    bounds = [float(interval.low), float(interval.high)]
    return {"records": len(hits), "share": sum(hits) / len(hits), "wilson_95": bounds}


def seeds(asked: argparse.Namespace, draws: int, first: int) -> range:
    """The seeds asked for, or else `draws` from `first` on."""
    start = first if asked.first is None else asked.first
    return range(start, start + (asked.draws or draws))


def spelled(data: Any, indent: int = 0) -> str:
    """JSON with each list and object on one line, where it fits."""
    flat = json.dumps(data)
    if indent + len(flat) <= WIDTH or not isinstance(data, dict | list):
        return flat
    keys = [f"{json.dumps(k)}: " for k in data] if isinstance(data, dict) else [""] * len(data)
    values = data.values() if isinstance(data, dict) else data
    inside = [f"{k}{spelled(v, indent + 1)}" for k, v in zip(keys, values, strict=True)]
    margin = "\n" + " " * (indent + 1)
    return flat[0] + margin + f",{margin}".join(inside) + "\n" + " " * indent + flat[-1]


def write(path: Path, report: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, (spelled(finite_or_null(report)) + "\n").encode())


def resumed(path: Path, commit: str) -> dict[str, Any]:
    """Results by task of a run of this commit that did not end; an empty file if there is none."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    if not lines or lines[0] != commit or commit.endswith("-dirty"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{commit}\n", encoding="utf-8")
        return {}
    return dict(json.loads(line) for line in lines[1:])


def results(name: str, asked: argparse.Namespace, commit: str) -> Iterator[Any]:
    """What the trials of a proof give, in the order of its tasks."""
    module = importlib.import_module(PROOFS[name][0])
    tasks = module.tasks(asked)
    tasks = {k: a for k, a in tasks.items() if not asked.only or any(w in k for w in asked.only)}
    partial = PARTIAL / f"{name}.jsonl"
    have = resumed(partial, commit)
    missing = iter([(key, given) for key, given in tasks.items() if key not in have])
    with partial.open("a", encoding="utf-8") as file:
        for key, found in open_workers(asked).map(module.trial, missing):
            line = json.dumps([key, finite_or_null(found)])
            have[key] = json.loads(line)[1]
            print(line, file=file, flush=True)
            print(f"{name}, {len(have)} of {len(tasks)}: {key}", file=sys.stderr, flush=True)
    return (have[key] for key in tasks)


def prove(name: str, asked: argparse.Namespace, arguments: Sequence[str]) -> bool:
    """Run a proof, store and print what it found; whether the claim holds."""
    made = provenance(arguments)  # of the running code, even if files change meanwhile
    module = importlib.import_module(PROOFS[name][0])
    report = made | module.report([*results(name, asked, made["commit"])])
    claim = (module.__doc__ or "").partition("\n")[0]
    report |= {"claim": claim, "says": module.says(report)}
    part = asked.only or asked.quick or asked.draws or asked.first is not None
    holds = bool(report.get("holds", True))
    if asked.out or not part:
        write(asked.out or FOLDER / f"{name}.json", report)
    elif not holds:
        print(spelled(finite_or_null(report)))
    (PARTIAL / f"{name}.jsonl").unlink()
    print(f"{name}: {report['says']}")
    return holds


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = {"choices": list(PROOFS), "metavar": "NAME", "help": ", ".join(PROOFS)}
    parser.add_argument("names", nargs="+", **names)
    parser.add_argument("--draws", type=int, help="draws of each kind")
    parser.add_argument("--first", type=int, help="first seed")
    parser.add_argument("--only", nargs="+", metavar="WORD", help="tasks with one of these words")
    parser.add_argument("--quick", action="store_true", help="what is quick enough for CI")
    add_worker_options(parser)
    parser.add_argument("--out", type=Path, help="default: docs/proof/NAME.json, if all is run")
    asked = parser.parse_args()
    codes = [0]
    for name in asked.names:
        try:
            codes.append(0 if prove(name, asked, sys.argv[1:]) else 1)
        except UserError as reason:  # data that we may not distribute
            print(f"{name}: nothing proven: {reason}", file=sys.stderr)
            codes.append(2)
    return max(codes)


if __name__ == "__main__":
    raise SystemExit(main())

"""Changes of one constant, sign, comparison or branch in core files, and whether the tests notice.

From each file of `PARTS` fifteen changes are drawn with a fixed seed, in turn from `KINDS`. The
installed package is copied with one change in it, the copy is put first on PYTHONPATH, and the
tests of that part run until one fails::

    python proofs/mutants.py --workers 2 --out out/mutants.json

A change is killed by a test that fails or by time, survives, or does not build. Whether one that
survives can change a result at all is for the reader. The tests of a part must pass without a
change, and within a quarter of the time `LIMIT`. Each run has its own copy of a cache that holds
the unchanged equations. The result is written after each run, and the next call continues it.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import json
import os
import random
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import accumulate, zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 240  # s
EACH = 15
KINDS = ("constant", "one", "sign", "comparison", "branch", "logic")
REMADE = ("fmus", "references")  # folders of the cache
OUTCOMES = ("killed", "killed by time", "survived", "does not build")
BYTES = "latin-1"  # each byte is a letter, so that the columns of `ast` are places in the text

# the tests of each file below tests/, cheap ones first, as pytest takes them
PARTS = {
    "solver/c/stepper.c": "solver/test_stepper.py solver/test_events_and_delays.py",
    "solver/c/events.c": "solver/test_events_and_delays.py solver/test_tangents.py",
    "solver/c/crossings.c": "solver/test_tangents.py stability/test_motions.py "
    "stability/test_known_answers.py",
    "solver/c/tangents.c": "solver/test_tangents.py solver/test_for_tangents.py "
    "stability/test_motions.py stability/test_known_answers.py",
    "orchestration/master/c/controller.c": "orchestration/master/test_couplings.py",
    "orchestration/master/c/coupling.c": "orchestration/master/test_couplings.py",
    "orchestration/master/c/master.c": "orchestration/master/test_couplings.py",
    **dict.fromkeys(
        (f"fmus/native/c/{part}.h" for part in ("component", "events", "exchange")),
        "fmus/test_events_and_delays.py fmus/test_model_exchange.py fmus/test_limits.py "
        "fmus/test_loop_export.py fmus/test_every_kind.py -k 'not (readable or native-3 or cvode "
        "or iol or maxwell or encoder or million or thousand or courses or feedback or valid)'",
    ),
    "controllers/adaptive_friction.py": "controllers/test_every_controller.py "
    "controllers/test_commands.py controllers/test_observers.py",
    "controllers/nctf.py": "controllers/test_every_controller.py controllers/test_thesis_laws.py",
    "plant/lugre.py": "plant/test_ball_screw.py plant/test_exact_solutions.py plant/test_laws.py "
    "-k 'lugre or printed or modified or each_direction or by_side'",
    "measurement/diagnosis/experiment.py": "measurement/diagnosis/test_experiment.py -k 'not own'",
    "measurement/diagnosis/scores.py": "measurement/diagnosis/test_scores.py -k 'not noisy'",
    "measurement/records/record.py": "measurement/records/test_examine.py "
    "measurement/records/test_wraps.py measurement/identification/test_rig_records.py",
    "measurement/records/table.py": "measurement/records/test_table.py "
    "measurement/records/test_formats.py measurement/records/test_reading.py",
    "orchestration/fmu/isolated.py": "orchestration/fmu/test_isolated.py -k 'not called'",
    "orchestration/master/verdict.py": "orchestration/master/test_verdict.py -k 'not results_of'",
    "orchestration/master/master.py": "orchestration/loop/test_pair.py "
    "orchestration/master/test_step_choice.py orchestration/master/test_verdict.py "
    "-k 'not results_of'",
    "fmus/system_reading.py": "fmus/test_system_reading.py",
    "solver/codegen.py": "solver/test_codegen.py solver/test_events_and_delays.py",
    "solver/interconnect.py": "solver/test_interconnect.py controllers/test_every_controller.py "
    "stability/test_sampled_and_delayed_loops.py -k 'not (cycles or circle or quantized)'",
    "stability/lyapunov.py": "stability/test_motions.py stability/test_known_answers.py "
    "ballscrew/test_lyapunov_command.py -k 'not (torus or map or disk) or agree'",
    "measurement/identification/fit.py": "measurement/identification/test_fit.py",
}

Row = dict[str, Any]


@dataclass(frozen=True)
class Mutant:
    """A file with the text from `start` to `end` replaced by `new`; `change` says it in words."""

    file: str
    kind: str
    start: int
    end: int
    new: str
    change: str


def mutants(file: str, text: str) -> Iterator[Mutant]:
    """All changes of a file that can be drawn."""
    for kind, start, end, new in changes(text, file.endswith(".py")):
        first, last = text.rfind("\n", 0, start) + 1, text.find("\n", end)
        words = f"{text[first:start]}[{text[start:end]} -> {new}]{text[end:last]}".split()
        yield Mutant(file, kind, start, end, new, " ".join(words))


def drawn(file: str, text: str, count: int = EACH) -> list[Mutant]:
    """Changes of a file, in turn from each kind, at most one at each place."""
    every = [*mutants(file, text)]
    random.Random(file).shuffle(every)
    turns = zip_longest(*([m for m in every if m.kind == kind] for kind in KINDS))
    found: dict[int, Mutant] = {}
    for mutant in (m for turn in turns for m in turn if m):
        found.setdefault(mutant.start, mutant)
    return [*found.values()][:count]


# -- what can be changed: tokens, and the conditions of branches ---------------------------------

Span = tuple[int, int]
Branch = tuple[int, int, str]

COMPARED = {"<": ">", "<=": "<", ">": "<", ">=": ">", "==": "!=", "!=": "=="}
COMPARED_WORDS = {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
LOGIC = {"&&": "||", "||": "&&", "!": ""}
LOGIC_WORDS = {"and": "or", "or": "and", "not ": "", "True": "False", "False": "True"}
NO_VALUES = "return case in and or not if elif else is lambda yield while".split()
NUMBER = r"(?<![\w.])(?:\d[\d_]*\.\d*|\.?\d[\d_]*)(?:[eE][+-]?\d+)?(?![\w.])"
TOKEN = re.compile(
    rf"{NUMBER}|is not\b|not in\b|not |\w+|->|\+\+|--|<<|>>|&&|\|\||[-+<>=!*/&|:]=|[^\s\w]"
)


def changes(text: str, python: bool) -> Iterator[tuple[str, int, int, str]]:
    """Kind, start, end and new text of each change."""
    alone, branches = parts_of_python(text) if python else parts_of_c(text)
    code = [*text]
    for start, end in alone:
        code[start:end] = " " * (end - start)
    compared, logic = COMPARED, LOGIC
    if python:
        compared, logic = COMPARED | COMPARED_WORDS, LOGIC_WORDS
    yield from (("branch", *branch) for branch in branches)
    before = ""
    for found in TOKEN.finditer("".join(code)):
        token, place = found[0], found.span()
        binary = re.match(r"[\w)\]}]", before) and before.strip() not in NO_VALUES
        if re.fullmatch(r"[\d_]*\d", token):
            yield "one", *place, another(int(token))
        elif re.fullmatch(NUMBER, token):
            yield "constant", *place, another(float(token))
        elif token in ("+", "-", "+=", "-=") and binary:
            yield "sign", *place, token.translate(str.maketrans("+-", "-+"))
        elif token == "-":
            yield "sign", *place, ""
        elif token in compared:
            yield "comparison", *place, compared[token]
        elif token in logic:
            yield "logic", *place, logic[token]
        before = token


def another(number: float) -> str:
    """One more than an integer; twice any other number; a hundred times a tolerance."""
    if isinstance(number, int):
        return str(number + 1)
    return repr(1.0 if number == 0 else (100 if abs(number) <= 1e-3 else 2) * number)


def parts_of_python(text: str) -> tuple[list[Span], list[Branch]]:
    """What is left alone: texts, errors, annotations, decorators; and the branches."""
    starts = [0, *accumulate(len(line) + 1 for line in text.split("\n"))]

    def span(node: Any) -> Span:
        first, last = starts[node.lineno - 1], starts[node.end_lineno - 1]
        return first + node.col_offset, last + node.end_col_offset

    alone, branches = [m.span() for m in re.finditer(r"^\s*#.*|  # .*", text, re.M)], []
    waiting: list[Any] = [ast.parse(text.encode(BYTES))]
    while waiting:
        node = waiting.pop()
        if is_left_alone(node):
            alone.append(span(node))
            continue
        waiting += ast.iter_child_nodes(node)
        said = [getattr(node, name, None) for name in ("annotation", "returns")]
        alone += [span(n) for n in [*said, *getattr(node, "decorator_list", ())] if n]
        match node:
            case ast.BinOp(left=left, right=right) | ast.AugAssign(target=left, value=right):
                if any(is_text(n) for n in (left, right)):
                    alone.append((span(left)[1], span(right)[0]))
            case ast.If() | ast.IfExp() if ast.unparse(node.test) != "TYPE_CHECKING":
                branches += [(*span(node.test), word) for word in ("True", "False")]
            case ast.While():
                branches.append((*span(node.test), "False"))
            case ast.For() | ast.comprehension():
                alone.append((span(node.target)[1], span(node.iter)[0]))
                branches += [(*span(test), "True") for test in getattr(node, "ifs", ())]
    return alone, branches


def is_left_alone(node: ast.AST) -> bool:
    text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    strict = isinstance(node, ast.keyword) and node.arg == "strict"
    return text or strict or isinstance(node, ast.JoinedStr | ast.Raise | ast.Assert)


def is_text(node: ast.AST) -> bool:
    """Whether a part of an addition shows that texts or lists are joined."""
    text = isinstance(node, ast.Constant) and isinstance(node.value, str)
    return text or isinstance(node, ast.JoinedStr | ast.List | ast.ListComp | ast.Tuple)


OF_C = re.compile(  # comments, texts, directives without a tolerance, enums, and sizes
    r"/\*(?s:.*?)\*/|//.*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])+'|enum \{[^}]*\}"
    r"|^[ \t]*#(?!define \w+ (?:\d+\.\d*|\d*\.?\d+e-?\d+)\s*(?:/|$))(?:\\\n|.)*"
    r"|^[ \t]*(?:(?:static|const|unsigned) )*[A-Za-z_]\w* [*\w]+(?:\[[^\]\n]*\])+",
    re.M,
)


def parts_of_c(text: str) -> tuple[list[Span], list[Branch]]:
    """What is left alone, see above, and the branches."""
    alone = [m.span() for m in OF_C.finditer(text)]
    within = {k for span in alone for k in range(*span)}
    branches = []
    for found in re.finditer(r"\b(if|while) \(", text):
        if found.start() not in within:
            inside = found.end(), found.end() + closed_after(text[found.end() :])
            branches += [(*inside, n) for n in "01" if found[1] == "if" or n == "0"]
    return alone, branches


def closed_after(text: str) -> int:
    """Place of the bracket that closes one opened before this text."""
    depth = 1
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if not depth:
            return k
    raise ValueError("a bracket is not closed")


# -- what the tests say --------------------------------------------------------------------------


def judged(mutant: Mutant | None, tests: str, package: Path, cache: Path) -> Row:
    """Outcome, time [s] and last words of the tests with a change, or without one."""
    with tempfile.TemporaryDirectory(prefix="mutant-", ignore_cleanup_errors=True) as place:
        folder = Path(place) / "ballscrew"
        shutil.copytree(package, folder, copy_function=os.link)
        if mutant:
            file = folder / mutant.file
            text = file.read_text(BYTES)
            file.unlink()  # it is the installed package's, too
            file.write_text(text[: mutant.start] + mutant.new + text[mutant.end :], BYTES)
            for compiled in file.parent.glob(f"__pycache__/{file.stem}.*"):
                compiled.unlink()
            kept = Path(place) / "cache"
            shutil.copytree(cache, kept, ignore=shutil.ignore_patterns(*REMADE))
            cache = kept
            if mutant.file.endswith(".c") and not built(folder, Path(mutant.file).parent):
                return {"outcome": "does not build", "seconds": 0.0, "said": ""}
        scratch = Path(place) / "tmp"
        scratch.mkdir()
        asked = [f"tests/{word}" if ".py" in word else word for word in shlex.split(tests)]
        given = {"PYTHONPATH": place, "BALLSCREW_CACHE": str(cache), "TMPDIR": str(scratch)}
        return ran([*asked, "-m", "not prove"], os.environ | given)


def built(folder: Path, part: Path) -> bool:
    """Compile the library of a folder of C, fast; whether it compiles."""
    name = {"solver": "core", "orchestration": "master"}[part.parts[0]]
    flags = runpy.run_path(str(folder / "solver" / "compilers.py"))["FLAGS"]
    source = folder / part / f"{name}.c"
    made = source.with_name(f"lib{name}.so")
    made.unlink()
    command = ["cc", *flags, "-O1", "-w", "-o", str(made), str(source), "-fPIC", "-lm"]
    return subprocess.run(command, capture_output=True).returncode == 0


def ran(arguments: list[str], environment: dict[str, str]) -> Row:
    """The outcome of pytest; all its processes end with it."""
    pytest = str(Path(sys.executable).with_name("pytest"))  # not `-m`: it finds this folder first
    command = [pytest, "-x", "-q", "-p", "no:cacheprovider", *arguments]
    began = time.monotonic()
    command = ["timeout", "--kill-after=5", str(LIMIT), *command]
    how = {"cwd": ROOT, "env": environment, "capture_output": True}
    done = subprocess.run(command, text=True, errors="replace", **how)
    said, code = done.stdout + done.stderr, done.returncode
    failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
    outcome = "killed" if code else "survived"
    if "does not compile" in said:
        outcome = "does not build"
    elif code in (124, 137, -9):
        outcome = "killed by time"
    seconds = round(time.monotonic() - began, 1)
    return {"outcome": outcome, "seconds": seconds, "said": (failed or [said[-500:]])[-1]}


def passes_unchanged(tests: str, package: Path, cache: Path) -> bool:
    """Whether tests pass in time without a change, at the latest when the cache is filled."""
    row = judged(None, tests, package, cache)
    if row["seconds"] >= LIMIT / 4:
        row = judged(None, tests, package, cache)
    good = row["outcome"] == "survived" and row["seconds"] < LIMIT / 4
    print(f"{'unchanged' if good else 'left out':15}{row['seconds']:6.1f} s  {tests}", flush=True)
    return bool(good)


def main() -> None:
    """Judge the changes that have no row yet; print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", nargs="*", default=list(PARTS), help="only these files")
    parser.add_argument("--draw", type=int, default=EACH, help="changes of each file")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/mutants.json"))
    given = parser.parse_args()
    package = Path(importlib.util.find_spec("ballscrew").origin).parent
    rows: list[Row] = json.loads(given.out.read_text("utf-8")) if given.out.is_file() else []
    known = {(r["file"], r["start"], r["new"]) for r in rows}
    cache = given.out.with_suffix(".cache").absolute()
    cache.mkdir(parents=True, exist_ok=True)
    chosen = [drawn(f, (package / f).read_text(BYTES), given.draw) for f in given.files]
    wanted = [m for some in zip_longest(*chosen) for m in some if m]
    wanted = [m for m in wanted if (m.file, m.start, m.new) not in known]
    good = {t for t in {PARTS[m.file] for m in wanted} if passes_unchanged(t, package, cache)}
    wanted = [m for m in wanted if PARTS[m.file] in good]
    with ThreadPoolExecutor(given.workers) as pool:
        results = pool.map(lambda m: judged(m, PARTS[m.file], package, cache), wanted)
        for m, row in zip(wanted, results, strict=True):
            rows.append(asdict(m) | row)
            given.out.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", "utf-8")
            print(f"{row['outcome']:15}{row['seconds']:6.1f} s  {m.file}: {m.change}", flush=True)
    print_table([r for r in rows if r["file"] in given.files])


def print_table(rows: list[Row]) -> None:
    """A line for each file, and the share that survives of those that build."""
    print(f"{'file':36}{'drawn':>7}" + "".join(f"{name:>16}" for name in OUTCOMES))
    for file in [*dict.fromkeys(r["file"] for r in rows), "all"]:
        own = Counter(r["outcome"] for r in rows if file in (r["file"], "all"))
        print(f"{file:36}{own.total():7}" + "".join(f"{own[name]:16}" for name in OUTCOMES))
    tried = own.total() - own["does not build"]
    print(f"survived: {100 * own['survived'] / max(tried, 1):.1f} %")


if __name__ == "__main__":
    main()

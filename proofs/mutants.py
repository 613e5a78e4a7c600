"""Changes of one constant, sign, comparison or branch in core files, and whether the tests notice.

From each file of `PARTS` fifteen changes are drawn with a fixed seed, in turn from `KINDS`. The
installed package is copied with one change in it, the copy is put first on PYTHONPATH, and the
tests of that part run until one fails::

    python proofs/mutants.py --workers 2 --out out/mutants.json

A change is killed by a test that fails or by time, survives, or does not build. Whether one that
survives can change a result at all is for the reader. The tests of a part must pass without a
change, and within a quarter of the time `LIMIT`, so that a run that is too slow is the effect of
its change. Each run has its own copy of a cache that holds the unchanged equations; a changed
source derives its equations again. The result is written after each run, and the next call
continues it.
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
import tokenize
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from io import StringIO
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 240  # s
EACH = 15
KINDS = ("constant", "one", "sign", "comparison", "branch", "logic")
REMADE = ("fmus", "references")  # folders of the cache
OUTCOMES = ("killed", "killed by time", "survived", "does not build")

# the tests of each file below tests/, cheap ones first, as pytest takes them
PARTS = {
    "solver/c/stepper.c": "solver/test_stepper.py solver/test_events_and_delays.py",
    "solver/c/events.c": "solver/test_events_and_delays.py solver/test_tangents.py",
    "solver/c/crossings.c": "solver/test_tangents.py stability/test_motions.py "
    "stability/test_known_answers.py",
    "solver/c/tangents.c": "solver/test_tangents.py stability/test_motions.py "
    "stability/test_known_answers.py",
    "orchestration/master/c/controller.c": "orchestration/master/test_couplings.py",
    "orchestration/master/c/coupling.c": "orchestration/master/test_couplings.py",
    "orchestration/master/c/master.c": "orchestration/master/test_couplings.py",
    **dict.fromkeys(
        (f"fmus/native/c/{part}.h" for part in ("component", "events", "exchange")),
        "fmus/test_events_and_delays.py fmus/test_model_exchange.py "
        "fmus/test_every_kind.py -k '(native-2 and (plant_classical or pid_sampled or nctf or "
        "states_set or be_set or no_ or failure or bound or limit or words or events) or margin or "
        "either_way or bounces) and not (loop or cvode or tangents or maxwell or observed)'",
    ),
    "controllers/adaptive_friction.py": "controllers/test_commands.py "
    "controllers/test_observers.py",
    "controllers/nctf.py": "controllers/test_thesis_laws.py",
    "plant/lugre.py": "plant/test_ball_screw.py plant/test_exact_solutions.py plant/test_laws.py "
    "-k 'lugre or printed or modified or each_direction or by_side'",
    "measurement/diagnosis/experiment.py": "measurement/diagnosis/"
    "test_experiment.py -k 'motion or lasts'",
    "measurement/diagnosis/scores.py": "measurement/diagnosis/test_scores.py -k "
    "'not (far or gap or noisy or follows or swing)'",
    "measurement/records/record.py": "measurement/records/test_examine.py "
    "measurement/records/test_wraps.py",
    "measurement/records/table.py": "measurement/records/test_table.py "
    "measurement/records/test_formats.py",
    "orchestration/fmu/isolated.py": "orchestration/fmu/test_isolated.py -k 'not called'",
    "orchestration/master/verdict.py": "orchestration/master/test_verdict.py -k "
    "'allowed or halvings or parts or flag or closer'",
    "orchestration/master/master.py": "orchestration/master/test_step_choice.py -k "
    "'not left_to and not which_step'",
    "fmus/system_reading.py": "fmus/test_system_reading.py",
    "solver/codegen.py": "solver/test_codegen.py solver/test_events_and_delays.py",
    "solver/interconnect.py": "solver/test_interconnect.py",
    "stability/lyapunov.py": "stability/test_motions.py "
    "stability/test_known_answers.py -k 'not torus or agree'",
    "measurement/identification/fit.py": "measurement/identification/test_fit.py",
}

Row = dict[str, Any]
Place = tuple[str, int, int, str]  # kind, start, end, new text


@dataclass(frozen=True)
class Mutant:
    """A file with the text from `start` to `end` replaced by `new`; `change` says it in words."""

    file: str
    kind: str
    start: int
    end: int
    new: str
    change: str

    @property
    def key(self) -> tuple[str, int, str]:
        return self.file, self.start, self.new


def mutants(file: str, text: str) -> list[Mutant]:
    """All changes of a file that can be drawn."""
    found = []
    for kind, start, end, new in in_python(text) if file.endswith(".py") else in_c(text):
        first, last = text.rfind("\n", 0, start) + 1, text.find("\n", end)
        words = f"{text[first:start]}[{text[start:end]} -> {new}]{text[end:last]}".split()
        found.append(Mutant(file, kind, start, end, new, " ".join(words)))
    return found


def drawn(file: str, text: str, count: int = EACH) -> list[Mutant]:
    """Changes of a file, in turn from each kind, at most one at each place."""
    chance, every = random.Random(file), mutants(file, text)
    chance.shuffle(every)
    waiting = {kind: [m for m in every if m.kind == kind] for kind in KINDS}
    found: dict[int, Mutant] = {}
    while len(found) < count and any(waiting.values()):
        for kind in KINDS:
            while waiting[kind]:
                mutant = waiting[kind].pop()
                if mutant.start not in found:
                    found[mutant.start] = mutant
                    break
    return list(found.values())[:count]


def another(number: float) -> str:
    """One more than an integer; twice any other number; a hundred times a tolerance."""
    if isinstance(number, int):
        return str(number + 1)
    return repr(1.0 if number == 0 else (100 if abs(number) <= 1e-3 else 2) * number)


COMPARED = {"<": ">", "<=": "<", ">": "<", ">=": ">", "==": ">=", "!=": "=="}
COMPARED |= {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
WORDS = {"Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">=", "Eq": "==", "NotEq": "!="}
WORDS |= {"Is": "is", "IsNot": "is not", "In": "in", "NotIn": "not in"}


class Places:
    """Where the expressions and operators of a Python text stand."""

    def __init__(self, text: str) -> None:
        self._lines = text.splitlines(keepends=True)
        self._starts = [sum(map(len, self._lines[:k])) for k in range(len(self._lines))]
        self._words = [
            (self._starts[t.start[0] - 1] + t.start[1], t.string)
            for t in tokenize.generate_tokens(StringIO(text).readline)
            if t.string.strip()
        ]

    def of(self, node: ast.AST) -> tuple[int, int]:
        """Start and end of an expression."""
        ends = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
        first, last = (
            self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())
            for line, column in ends
        )
        return first, last

    def between(self, left: ast.AST, word: str, right: ast.AST) -> tuple[int, int]:
        """Start and end of an operator between two expressions."""
        begin, end, first = self.of(left)[1], self.of(right)[0], word.split()[0]
        start = next(k for k, found in self._words if begin <= k < end and found == first)
        return start, start + len(word)


def in_python(text: str) -> Iterator[Place]:
    """Changes of the code: not of annotations, decorators, assertions, errors and their texts."""
    places = Places(text)
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.JoinedStr, ast.Raise, ast.Assert)):
            continue
        if isinstance(node, ast.keyword) and node.arg == "strict":
            continue
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list"):
                below = value if isinstance(value, list) else [value]
                waiting += [n for n in below if isinstance(n, ast.AST)]
        yield from of_numbers_and_signs(node, places)
        yield from of_conditions(node, places)


def of_numbers_and_signs(node: ast.AST, places: Places) -> Iterator[Place]:
    """Changes of the kinds `constant`, `one`, `sign`, and of True and False."""
    match node:
        case ast.Constant(value=bool()):
            yield "logic", *places.of(node), str(not node.value)
        case ast.Constant(value=int()):
            yield "one", *places.of(node), another(node.value)
        case ast.Constant(value=float()):
            yield "constant", *places.of(node), another(node.value)
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", places.of(node)[0], places.of(node)[0] + 1, ""
        case ast.BinOp(op=ast.Add() | ast.Sub()) if not is_text(node):
            old, new = "+-" if isinstance(node.op, ast.Add) else "-+"
            yield "sign", *places.between(node.left, old, node.right), new
        case ast.AugAssign(op=ast.Add() | ast.Sub()) if not is_text(node):
            old, new = ("+=", "-=") if isinstance(node.op, ast.Add) else ("-=", "+=")
            yield "sign", *places.between(node.target, old, node.value), new


def of_conditions(node: ast.AST, places: Places) -> Iterator[Place]:
    """Changes of the kinds `comparison`, `branch` and `logic`."""
    match node:
        case ast.UnaryOp(op=ast.Not()):
            yield "logic", places.of(node)[0], places.of(node)[0] + len("not "), ""
        case ast.BoolOp():
            old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in pairwise(node.values):
                yield "logic", *places.between(left, old, right), new
        case ast.Compare():
            for (left, right), op in zip(
                pairwise([node.left, *node.comparators]), node.ops, strict=True
            ):
                old = WORDS[type(op).__name__]
                counted = isinstance(right, ast.Constant) and isinstance(right.value, int)
                new = "!=" if old == "==" and not counted else COMPARED[old]
                yield "comparison", *places.between(left, old, right), new
        case ast.If() | ast.IfExp() if ast.unparse(node.test) != "TYPE_CHECKING":
            yield from (("branch", *places.of(node.test), word) for word in ("True", "False"))
        case ast.While():
            yield "branch", *places.of(node.test), "False"
        case ast.comprehension():
            yield from (("branch", *places.of(test), "True") for test in node.ifs)


def is_text(node: ast.AST) -> bool:
    """Whether an addition joins texts or lists."""
    parts = (ast.JoinedStr, ast.List, ast.ListComp, ast.Tuple)
    return any(
        isinstance(n, parts) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for n in ast.iter_child_nodes(node)
    )


_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.S)
_TEXT = re.compile(r'"(?:\\.|[^"\\\n])*"|' + r"'(?:\\.|[^'\\\n])+'")
_DIRECTIVE = re.compile(r"^[ \t]*#(?:\\\n|[^\n])*", re.M)
_TOLERANCE = re.compile(r"#define \w+ (\d+\.\d*|\d*\.?\d+e-?\d+)\s*")
_SIZES = re.compile(
    r"^\s*(?:(?:static|const|unsigned) )*[A-Za-z_]\w* [*\w]+(?:\[[^\]\n]*\])+", re.M
)
_ENUMS = re.compile(r"enum \{[^}]*\}")
_NUMBER = r"(?<![\w.])(?:\d+\.\d*|\.?\d+)(?:[eE][+-]?\d+)?(?![\w.])"
_TOKEN = re.compile(rf"{_NUMBER}|\w+|->|\+\+|--|<<|>>|&&|\|\||[-+<>=!*/&|]=|[^\s\w]")
_AFTER_VALUE = re.compile(r"[\w)\]]")


def in_c(text: str) -> Iterator[Place]:
    """Changes of C: not of comments, texts, the preprocessor, sizes in declarations, and enums."""

    def blank(found: re.Match[str]) -> str:
        return found[0] if _TOLERANCE.fullmatch(found[0]) else re.sub(r"[^\n]", " ", found[0])

    code = text
    for left_alone in (_COMMENT, _TEXT, _DIRECTIVE, _ENUMS):
        code = left_alone.sub(blank, code)
    sizes = {k for m in _SIZES.finditer(code) for k in range(*m.span())}
    tokens = [(m.start(), m[0]) for m in _TOKEN.finditer(code)]
    for (_, before), (k, token) in zip([(0, ""), *tokens], tokens, strict=False):
        end, binary = (
            k + len(token),
            bool(_AFTER_VALUE.match(before)) and before != "return",
        )
        if re.fullmatch(_NUMBER, token) and k not in sizes:
            kind, value = ("one", int(token)) if token.isdigit() else ("constant", float(token))
            yield kind, k, end, another(value)
        elif token in ("+", "-", "+=", "-=") and binary:
            yield "sign", k, end, token.translate(str.maketrans("+-", "-+"))
        elif token == "-":
            yield "sign", k, end, ""
        elif token in COMPARED:
            yield "comparison", k, end, COMPARED[token]
        elif token in ("&&", "||", "!"):
            yield "logic", k, end, {"&&": "||", "||": "&&", "!": ""}[token]
        elif token in ("if", "while"):
            start = code.index("(", k)
            inside = start + 1 + closed_after(code[start + 1 :])
            yield from (("branch", start + 1, inside, n) for n in "01" if token == "if" or n == "0")


def closed_after(text: str) -> int:
    """Place of the bracket that closes one opened before this text."""
    depth = 1
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if not depth:
            return k
    raise ValueError("a bracket is not closed")


def judged(mutant: Mutant | None, tests: str, package: Path, cache: Path, markers: str) -> Row:
    """Outcome, time [s] and last words of the tests with a change, or without one."""
    with tempfile.TemporaryDirectory(prefix="mutant-", ignore_cleanup_errors=True) as place:
        folder = Path(place) / "ballscrew"
        shutil.copytree(package, folder, copy_function=os.link)
        if mutant:
            file = folder / mutant.file
            text = file.read_text("utf-8")
            file.unlink()  # it is the installed package's, too
            file.write_text(text[: mutant.start] + mutant.new + text[mutant.end :], "utf-8")
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
        return ran([*asked, "-m", markers], os.environ | given)


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
    done = subprocess.run(
        ["timeout", "--kill-after=5", str(LIMIT), *command],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
    )
    said, code = done.stdout + done.stderr, done.returncode
    failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
    outcome = "killed" if code else "survived"
    if "does not compile" in said:
        outcome = "does not build"
    elif code in (124, 137, -9):
        outcome = "killed by time"
    seconds = round(time.monotonic() - began, 1)
    return {"outcome": outcome, "seconds": seconds, "said": (failed or [said[-500:]])[-1]}


def main() -> None:
    """Judge the changes that have no row yet; print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", nargs="*", default=list(PARTS), help="only these files")
    parser.add_argument("--draw", type=int, default=EACH, help="changes of each file")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--markers", default="not prove", help="which tests, as pytest takes it")
    parser.add_argument("--again", action="store_true", help="try those that survived once more")
    parser.add_argument("--out", type=Path, default=Path("out/mutants.json"))
    given = parser.parse_args()
    found = importlib.util.find_spec("ballscrew")
    assert found
    assert found.origin
    package = Path(found.origin).parent
    rows: list[Row] = json.loads(given.out.read_text("utf-8")) if given.out.is_file() else []
    if given.again:
        rows = [r for r in rows if r["outcome"] != "survived" or r["file"] not in given.files]
    known = {(r["file"], r["start"], r["new"]) for r in rows}
    cache = given.out.with_suffix(".cache").absolute()
    cache.mkdir(parents=True, exist_ok=True)
    chosen = [drawn(f, (package / f).read_text("utf-8"), given.draw) for f in given.files]
    wanted = [m for some in zip_longest(*chosen) for m in some if m and m.key not in known]

    def alone(file: str) -> bool:
        """Whether the tests of a file pass in time without a change; first they fill the cache."""
        judged(None, PARTS[file], package, cache, given.markers)
        row = judged(None, PARTS[file], package, cache, given.markers)
        good = row["outcome"] == "survived" and row["seconds"] < LIMIT / 4
        print(
            f"{'unchanged' if good else 'left out':15}{row['seconds']:6.1f} s  {file}", flush=True
        )
        return good

    files = {m.file for m in wanted}
    files = {file for file in PARTS if file in files and alone(file)}
    wanted = [m for m in wanted if m.file in files]
    with ThreadPoolExecutor(given.workers) as pool:
        results = pool.map(
            lambda m: judged(m, PARTS[m.file], package, cache, given.markers), wanted
        )
        for mutant, row in zip(wanted, results, strict=True):
            rows.append(asdict(mutant) | row)
            given.out.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", "utf-8")
            seconds = f"{row['seconds']:6.1f} s"
            print(f"{row['outcome']:15}{seconds}  {mutant.file}: {mutant.change}", flush=True)
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

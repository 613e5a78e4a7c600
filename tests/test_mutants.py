"""Changes of code that its tests must notice: what is changed, and how a change is judged."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mutants
import pytest

pytestmark = pytest.mark.ci

PYTHON = '''"""1 < 2."""
def f(x: int = 1) -> bool:
    assert x > 0
    if not x < 2.5 and x == -1:
        raise ValueError(f"{x + 1}")
    return x in (True, 1e-9)  # 3
'''
C = """#define NEAR 1e-9 /* 1 < 2 */
#define MOST 7
double room[3];
int f(double x) { return !(x < 2.5) && x == -1 ? 0 : g("3"); } // 4
"""


def changes(name, text):
    return sorted(m.change.split("[", 1)[1].split("]")[0] for m in mutants.mutants(name, text))


def test_numbers_signs_comparisons_branches_and_words_are_changed_and_texts_are_not():
    common = ["2.5 -> 5.0", "< -> >", "- -> ", "1 -> 2", "1e-9 -> 1.0000000000000001e-07"]
    words = ["and -> or", "== -> !=", "not -> ", "in -> not in", "True -> False", "1 -> 2"]
    branches = [f"not x < 2.5 and x == -1 -> {word}" for word in ("True", "False")]
    assert changes("f.py", PYTHON) == sorted(common + words + branches)
    words = ["&& -> ||", "== -> >=", "! -> ", "0 -> 1"]
    assert changes("f.c", C) == sorted(common + words)


PROGRAM = """
import json, sys
from pathlib import Path
from mutants import Mutant, importlib, judged
package, cache = Path(importlib.util.find_spec("ballscrew").origin).parent, Path(sys.argv[1])
file = "records/resolution.py"
start = (package / file).read_text("utf-8").index("0.4")
told = "records/test_resolution.py -k four_tenths"
found = [
    judged(Mutant(file, "constant", start, start + 3, new, ""), told, package, cache, "not prove")
    for new in ("0.8", "0.40")
]
print(json.dumps([f["outcome"] for f in found]))
"""


def test_a_change_of_a_limit_is_killed_and_another_spelling_survives(tmp_path):
    (tmp_path / "cache").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path / "cache")],
        cwd=Path(mutants.__file__).parent,
        capture_output=True,
        text=True,
    )
    assert json.loads(done.stdout or done.stderr) == ["killed", "survived"]

"""The package's types as a user's type checker sees them, outside of the package."""

import subprocess
import sys

import pytest

import ballscrew

PROGRAM = """
import numpy as np
import numpy.typing as npt

import ballscrew
from ballscrew import Component, Input, Output, Parameter, symbol


def spring() -> Component:
    return Component(
        "spring",
        "u = K (x_d - x)",
        parameters=(Parameter("K", 500.0, "V/m", "gain", "chosen"),),
        inputs=(Input("x", "m", "position"), Input("x_d", "m", "set-point")),
        outputs=(Output("u", "V", "command", symbol("K") * (symbol("x_d") - symbol("x"))),),
    )


result = ballscrew.run(spring(), stop=1.0)
position: npt.NDArray[np.float64] = result.run.outputs["x"]
trusted: bool = result.run.verdict.trusted
word: str = result.run.verdict.word
result.save("out")
version: str = ballscrew.__version__
"""


def checked(folder, text):
    # mypy takes a file of the same size and second for the same file: texts differ in length
    (folder / "program.py").write_text(text, encoding="utf-8")
    return subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", folder / "cache", "program.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.mark.ci
def test_a_users_program_passes_mypy_strict_and_its_mistakes_are_found(tmp_path):
    right = checked(tmp_path, PROGRAM)
    assert right.returncode == 0, right.stdout
    typed = [name for name in ballscrew.__all__ if name != "TIME"]  # SymPy's; it has no types
    every = "\n".join(f"reveal_type(ballscrew.{name})" for name in typed)
    seen = checked(tmp_path, f"import ballscrew\n{every}\n")
    assert seen.returncode == 0, seen.stdout  # a name that is missing is an error
    assert 'is "Any"' not in seen.stdout, seen.stdout
    wrong = checked(tmp_path, PROGRAM.replace("stop=1.0", 'stop="1"').replace("run(", "runs(", 1))
    assert "runs" in wrong.stdout
    wrong = checked(tmp_path, PROGRAM.replace("stop=1.0", 'stop="1"'))
    assert 'incompatible type "str"' in wrong.stdout

"""Compiled equations on disk, and which of them a process takes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import ballscrew

PLACE = "from ballscrew.solver.kernel_cache import compiled_path; print(compiled_path('equations'))"


def test_equations_that_another_version_compiled_are_not_taken(tmp_path):
    """Their struct may be another one: what holds it is not to be called."""
    package = tmp_path / "ballscrew"
    shutil.copytree(Path(ballscrew.__file__).parent, package)

    def place():
        environment = os.environ | {"PYTHONPATH": str(tmp_path), "BALLSCREW_CACHE": str(tmp_path)}
        told = [sys.executable, "-c", PLACE]
        done = subprocess.run(
            told, env=environment, cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return done.stdout

    before = place()
    assert place() == before
    with (package / "solver" / "c" / "system.h").open("a") as header:
        header.write("/* another version */\n")
    assert place() != before

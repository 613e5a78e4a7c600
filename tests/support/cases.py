"""Small inputs from public reports that once failed: each folder lies beside the project.

Each folder has a README with the command, what is expected and what came.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("BALLSCREW_CASES", ROOT.parent / "shared" / "cases"))
_BALLSCREW = Path(sys.executable).with_name("ballscrew")


def case(name: str, folder: Path) -> Path:
    """A copy of a case's files, that a test may write into."""
    if not (CASES / name).is_dir():
        pytest.skip(f"the case {name} is not here; set BALLSCREW_CASES to the folder of all cases")
    copy = folder / name
    copy.mkdir()
    for source in sorted((CASES / name).iterdir()):
        shutil.copyfile(source, copy / source.name)  # the sources may be read-only
    return copy


def ballscrew(folder: Path, words: str, seconds: float = 120.0) -> subprocess.CompletedProcess[str]:
    """The command as a user would give it inside a folder: its exit code and what it printed."""
    return subprocess.run(
        [_BALLSCREW, *words.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )

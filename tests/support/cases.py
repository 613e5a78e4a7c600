"""Small inputs from public reports that once failed, in folders next to the project.

Each folder has a README with the command, the expected result and the actual result.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

ROOT = Path(__file__).resolve().parents[2]
CASES = Path(os.environ.get("BALLSCREW_CASES", ROOT.parent / "shared" / "cases"))
_BALLSCREW = Path(sys.executable).with_name("ballscrew")


def case(name: str, folder: Path) -> Path:
    """A copy of a case's files, into which a test may write."""
    if not (CASES / name).is_dir():
        pytest.skip(f"the case {name} is not here; set BALLSCREW_CASES to the folder of all cases")
    copy = folder / name
    copy.mkdir()
    for source in sorted((CASES / name).iterdir()):
        shutil.copyfile(source, copy / source.name)  # the sources may be read-only
    return copy


def maker() -> ModuleType:
    """The module that made the cases' FMUs, to make more of them."""
    if not (CASES / "mk.py").is_file():
        pytest.skip(
            "mk.py of the cases is not here; set BALLSCREW_CASES to the folder of all cases"
        )
    spec = importlib.util.spec_from_file_location("mk", CASES / "mk.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    build = module.build

    def quiet(*words: Any, **named: Any) -> None:
        with warnings.catch_warnings():  # it does not close its files
            warnings.simplefilter("ignore", ResourceWarning)
            build(*words, **named)

    module.build = quiet  # type: ignore[attr-defined]
    return module


def ballscrew(folder: Path, words: str, seconds: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder like a user; return exit code and output."""
    return subprocess.run(
        [_BALLSCREW, *words.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


def cart_position(t: float, setpoint: float = 0.1) -> float:
    """Position [m] of the cases' cart under their PD controller: the exact solution.

    x'' = u - 2 x', u = 25 (setpoint - x) - 8 x', from rest at 0.
    """
    moved = expm(np.array([[0.0, 1.0], [-25.0, -10.0]]) * t) @ np.array([-setpoint, 0.0])
    return float(setpoint + moved[0])


def last_row(folder: Path) -> dict[str, float]:
    """The last row of a run's trajectory."""
    lines = (folder / "trajectory.csv").read_text().splitlines()
    return dict(zip(lines[0].split(","), map(float, lines[-1].split(",")), strict=True))

"""The command ``diagnose`` in this process, its results, and the believed model."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from axis_records import NOMINAL

from ballscrew.diagnosis.drive import Drive


def nominal() -> Drive:
    """The axis of `axis_records` as believed without errors, with 3 % tolerance for each value."""
    tolerance = {n: 0.03 for n in NOMINAL if n not in ("p", "Kv", "L")}
    return Drive("ball_screw", "modified_lugre", dict(NOMINAL), tolerance)


@dataclass(frozen=True)
class Diagnosed:
    """Input, files and output of ``ballscrew diagnose``."""

    record: Path
    parameters: Path
    folder: Path
    code: int
    printed: str
    said: str

    @property
    def result(self) -> dict[str, Any]:
        told: dict[str, Any] = json.loads((self.folder / "diagnosis.json").read_text())
        return told


def run(*arguments: object) -> tuple[int, str, str]:
    """The command's exit code, standard output and standard error."""
    from ballscrew.cli import main

    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        code = main([str(a) for a in arguments])
    return code, printed.getvalue(), said.getvalue()

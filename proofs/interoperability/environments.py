"""Environments of other tools: made by pip once, and what is run in them."""

from __future__ import annotations

import json
import subprocess
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FOLDER = ROOT / "out" / "tools"


class NotMade(RuntimeError):
    """pip could not fill an environment, or a run in it failed; the message is the last line."""


def python_of(tool: str, packages: Sequence[str], folder: Path = FOLDER) -> Path:
    """The interpreter of a tool's environment, which is made if it does not exist."""
    home = folder.resolve() / tool
    if not (home / "ready").is_file():
        venv.create(home, with_pip=True, clear=True)
        pip = [home / "bin" / "python", "-m", "pip", "install", "--quiet"]
        called([*pip, "--disable-pip-version-check", *packages])
        (home / "ready").touch()
    return home / "bin" / "python"


def called(command: Sequence[Path | str], folder: str | None = None) -> None:
    """Run a command; `NotMade` with its last line if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotMade(((done.stderr or done.stdout).strip().splitlines() or ["no word"])[-1])


def by_host(tool: str, python: Path, job: dict[str, Any]) -> dict[str, Any]:
    """The result of a job by one of the tools of `hosts.py`."""
    with tempfile.TemporaryDirectory() as place:
        given, got = Path(place) / "job.json", Path(place) / "result.json"
        given.write_text(json.dumps(job), encoding="utf-8")
        called([python, HERE / "hosts.py", tool, given, got], place)
        return dict(json.loads(got.read_text(encoding="utf-8")))

"""The command ``diagnose`` in this process, its results, and the believed model."""

from __future__ import annotations

import contextlib
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ballscrew.measurement.diagnosis.model import Drive
from ballscrew.orchestration.loop.catalogue import component

# the thesis' axis as believed by its user
NOMINAL = {
    "m": 1.0,
    "Jm": 4.2e-7,
    "kt": 37.4e-3,
    "ke": 60 / (255 * 2 * math.pi),
    "R": 21.4,
    "L": 0.953e-3,
    "p": 1000.0,
    "sigma0": 66967.231,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.13975e-3,
    "Kv": 1e8,
}


def nominal() -> Drive:
    """That axis without errors, with 3 % tolerance for each value."""
    tolerance = {n: 0.03 for n in NOMINAL if n not in ("p", "Kv", "L")}
    return Drive("ball_screw", "modified_lugre", dict(NOMINAL), tolerance)


def whole(plant: str = "plant", **own: float) -> str:
    """The table ``[plant]`` of a plant of the catalogue, with some values of its own."""
    values = {p.name: float(p.default) for p in component(plant).all_parameters} | own
    return "[plant]\n" + "".join(f"{n} = {v!r}\n" for n, v in values.items())


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

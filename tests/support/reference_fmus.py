"""The official Reference FMUs, packed from their sources, which are not part of this project."""

from __future__ import annotations

import csv
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = Path(
    os.environ.get("BALLSCREW_REFERENCE_FMUS", ROOT.parent / "shared" / "Reference-FMUs")
)
ALL_C = '#include "fmi2Functions.c"\n#include "model.c"\n#include "cosimulation.c"\n'


def _model(name: str) -> Path:
    if not (SOURCES / name).is_dir():
        pytest.skip(
            "the Reference FMUs are not here: get modelica/Reference-FMUs from GitHub, "
            "and set BALLSCREW_REFERENCE_FMUS to its folder"
        )
    return SOURCES / name


def reference_fmu(
    folder: Path,
    name: str,
    fmi: int,
    *,
    exchanges: bool = False,
    change: tuple[bytes, bytes] = (b"", b""),
) -> Path:
    """An FMU of sources only; with `exchanges`, for model exchange only.

    `change` has the replacements in its equations.
    """
    model = _model(name)
    description = (model / f"FMI{fmi}.xml").read_text(encoding="utf-8")
    if exchanges:
        element = r"<CoSimulation[^>]*/>|<CoSimulation.*?</CoSimulation>"
        description = re.sub(element, "", description, flags=re.DOTALL)
    files = {"modelDescription.xml": description.encode()}
    own = [model / "config.h", model / "model.c"]
    shared = [SOURCES / "include" / n for n in ("model.h", "cosimulation.h")]
    code = [SOURCES / "src" / n for n in (f"fmi{fmi}Functions.c", "cosimulation.c")]
    files |= {f"sources/{p.name}": p.read_bytes() for p in (*own, *shared, *code)}
    if fmi == 2:
        files["sources/all.c"] = f"#define FMI_VERSION 2\n{ALL_C}".encode()
    else:
        files["sources/buildDescription.xml"] = (model / "buildDescription.xml").read_bytes()
    if name == "Resource":
        files["resources/y.txt"] = (model / "y.txt").read_bytes()
    assert change[0] in files["sources/model.c"]
    files["sources/model.c"] = files["sources/model.c"].replace(*change)
    path = folder / f"{name}{fmi}{'_me' if exchanges else ''}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for place, data in files.items():
            archive.writestr(place, data)
    return path


def reference_result(name: str) -> dict[str, np.ndarray]:
    """The numeric columns of the result published with a model."""
    with (_model(name) / f"{name}_out.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    truth = {"false": 0.0, "true": 1.0}
    return {
        column: np.array([float(truth.get(row[column], row[column])) for row in rows])
        for column in rows[0]
        if not column.startswith(("String", "Binary"))
    }

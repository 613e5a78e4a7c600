"""The official Reference FMUs of the Modelica Association, made from their sources.

What the tests need of modelica/Reference-FMUs, commit 1258711, is packed with its licence (BSD,
two clauses) in ``tests/data/reference_fmus.tar.xz``.
"""

from __future__ import annotations

import csv
import re
import tarfile
import zipfile
from functools import cache
from pathlib import Path

import numpy as np

ALL_C = '#include "fmi2Functions.c"\n#include "model.c"\n#include "cosimulation.c"\n'


@cache
def _files() -> dict[str, bytes]:
    packed = Path(__file__).parents[1] / "data" / "reference_fmus.tar.xz"
    with tarfile.open(packed) as archive:
        return {member.name: archive.extractfile(member).read() for member in archive}


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
    packed = _files()
    description = packed[f"{name}/FMI{fmi}.xml"].decode()
    if exchanges:
        element = r"<CoSimulation[^>]*/>|<CoSimulation.*?</CoSimulation>"
        description = re.sub(element, "", description, flags=re.DOTALL)
    files = {"modelDescription.xml": description.encode()}
    own = [f"{name}/config.h", f"{name}/model.c", "include/model.h", "include/cosimulation.h"]
    own += [f"src/fmi{fmi}Functions.c", "src/cosimulation.c"]
    files |= {f"sources/{Path(n).name}": packed[n] for n in own}
    if fmi == 2:
        files["sources/all.c"] = f"#define FMI_VERSION 2\n{ALL_C}".encode()
    else:
        files["sources/buildDescription.xml"] = packed[f"{name}/buildDescription.xml"]
    if name == "Resource":
        files["resources/y.txt"] = packed["Resource/y.txt"]
    assert change[0] in files["sources/model.c"]
    files["sources/model.c"] = files["sources/model.c"].replace(*change)
    path = folder / f"{name}{fmi}{'_me' if exchanges else ''}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for place, data in files.items():
            archive.writestr(place, data)
    return path


def reference_result(name: str) -> dict[str, np.ndarray]:
    """The numeric columns of the result published with a model."""
    rows = list(csv.DictReader(_files()[f"{name}/{name}_out.csv"].decode().splitlines()))
    truth = {"false": 0.0, "true": 1.0}
    return {
        column: np.array([float(truth.get(row[column], row[column])) for row in rows])
        for column in rows[0]
        if not column.startswith(("String", "Binary"))
    }

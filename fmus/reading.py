"""Open an FMU that may be anybody's: check it first, unpack it into a folder of its own."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any


class FmuError(ValueError):
    """The file is no FMU that can run here; the message says what is wrong with it."""


@dataclass(frozen=True)
class UnpackedFmu:
    """An FMU's description and the folder it was unpacked to; `remove` deletes the folder."""

    path: Path
    description: Any
    folder: Path

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def unpack(path: Path | str) -> UnpackedFmu:
    """Check and unpack an FMI 2.0 co-simulation FMU.

    Raises
    ------
    FmuError
        If the file is missing, is no FMU, climbs out of its folder, or cannot run here.
    """
    from fmpy import platform, read_model_description

    path = Path(path)
    if not path.is_file():
        raise FmuError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            _check_names(path, names)
            if "modelDescription.xml" not in names:
                raise FmuError(f"{path}: holds no modelDescription.xml, so it is no FMU")
            try:
                description = read_model_description(str(path), validate=False)
            except Exception as error:  # the parser raises many kinds
                raise FmuError(f"{path}: modelDescription.xml cannot be read: {error}") from error
            if description.fmiVersion != "2.0":
                raise FmuError(f"{path}: is FMI {description.fmiVersion}, expected FMI 2.0")
            if description.coSimulation is None:
                raise FmuError(f"{path}: is for model exchange only, expected co-simulation")
            binaries = f"binaries/{platform}/"
            if not any(name.startswith(binaries) for name in names):
                raise FmuError(f"{path}: has no binary for this platform ({platform})")
            folder = Path(tempfile.mkdtemp(prefix="ballscrew-fmu-"))
            try:
                archive.extractall(folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
    except zipfile.BadZipFile as error:
        raise FmuError(f"{path}: is not a zip file, so it is no FMU") from error
    return UnpackedFmu(path, description, folder)


def _check_names(path: Path, names: list[str]) -> None:
    for name in names:
        parts = PurePosixPath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name:
            raise FmuError(f"{path}: refuses to unpack {name!r}, which climbs out of its folder")

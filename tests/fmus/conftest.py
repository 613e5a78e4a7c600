"""FMUs of every kind: of components of the catalogue, and of those that a test makes."""

from collections.abc import Callable
from pathlib import Path

import pytest

from ballscrew import Component
from ballscrew.fmus.export import export
from ballscrew.fmus.native.export import export_native


@pytest.fixture(scope="session")
def made(request) -> Callable[[str, str], Path]:
    """``made(name, kind)`` is the path of the FMU of a component; a kind is one of `KINDS`."""

    def get(name: str, kind: str) -> Path:
        if kind == "readable":
            return request.getfixturevalue("fmus")[name]
        return request.getfixturevalue("native")(name, int(kind[-1]))

    return get


@pytest.fixture(scope="session")
def written(tmp_path_factory) -> Callable[[Component, str], Path]:
    """``written(component, kind)`` is the FMU of a component that a test has made, written once."""
    folder, paths = tmp_path_factory.mktemp("written"), {}

    def get(component: Component, kind: str) -> Path:
        key = component.digest, kind
        if key not in paths:
            path = folder / f"{component.name}-{len(paths)}.fmu"
            if kind == "readable":
                paths[key] = Path(export(component, path))
            else:
                paths[key] = export_native(component, path, fmi=int(kind[-1])).path
        return paths[key]

    return get

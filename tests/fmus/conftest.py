"""FMUs of components of the catalogue, of every kind."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def made(request) -> Callable[[str, str], Path]:
    """``made(name, kind)`` is the path of the FMU of a component; a kind is one of `KINDS`."""

    def get(name: str, kind: str) -> Path:
        if kind == "readable":
            return request.getfixturevalue("fmus")[name]
        return request.getfixturevalue("native")(name, int(kind[-1]))

    return get

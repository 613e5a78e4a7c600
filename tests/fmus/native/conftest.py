"""Native FMUs made once a session, when they are first asked for."""

from collections.abc import Callable
from pathlib import Path

import pytest

from ballscrew.solver.compilers import compiler_for, own_platform


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Callable[..., Path]:
    """``native(name, fmi=2)`` is the path of the native FMU of a component of the catalogue."""
    from ballscrew.fmus.native.export import write_native
    from ballscrew.fmus.native.sources import catalogued_model

    if not own_platform() or not compiler_for(own_platform()):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
    folder = tmp_path_factory.mktemp("native")
    made: dict[tuple[str, int], Path] = {}

    def get(name: str, fmi: int = 2) -> Path:
        if (name, fmi) not in made:
            path = folder / f"{name}-{fmi}.fmu"
            made[name, fmi] = write_native(catalogued_model(name), path, fmi).path
        return made[name, fmi]

    return get

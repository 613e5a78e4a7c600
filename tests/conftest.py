"""Shared parts: a cache folder of the test run's own, FMUs made once, reference courses."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

# What tests derive goes to a folder of their own that outlives a run: warm runs are fast, and
# nothing of the user's is touched. Set before anything of the package is imported.
# The worlds that proofs are made in are compiled by numba, and run for a moment each.
os.environ.setdefault("NUMBA_OPT", "1")
# Matrices are small here, and each worker is a thread already: more cost three times as much.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault(
    "BALLSCREW_CACHE", str(Path(tempfile.gettempdir()) / f"ballscrew-tests-{os.getuid()}")
)


@pytest.fixture(scope="session", autouse=True)
def temporary_files_go_with_the_run() -> Iterator[None]:
    """What hosts unpack, and killed commands leave, is removed at the end."""
    with (
        tempfile.TemporaryDirectory(prefix="tests-", ignore_cleanup_errors=True) as folder,
        pytest.MonkeyPatch.context() as patch,
    ):
        Path(folder).chmod(0o711)  # some tests run commands as another user
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", None)
        yield


@pytest.fixture(scope="session")
def fmus() -> dict[str, Path]:
    """Paths of all exported FMUs by name."""
    from ballscrew.fmus.catalogue import NAMES, fmu

    return {name: fmu(name) for name in NAMES}


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Callable[..., Path]:
    """``native(name, fmi=2)`` is the path of the native FMU of a component of the catalogue.

    All workers take the one that is made first: each is compiled once.
    """
    from ballscrew.fmus.native.export import write_native
    from ballscrew.fmus.native.sources import catalogued_model
    from ballscrew.solver.compilers import compiler_for, own_platform

    if not own_platform() or not compiler_for(own_platform()):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "native"
    folder.mkdir(exist_ok=True)

    def get(name: str, fmi: int = 2) -> Path:
        path = folder / f"{name}-{fmi}.fmu"  # written whole or not at all
        return path if path.is_file() else write_native(catalogued_model(name), path, fmi).path

    return get

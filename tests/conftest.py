"""Shared parts: a cache folder of the test run's own, FMUs made once, reference courses."""

from __future__ import annotations

import os
import tempfile
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


@pytest.fixture(scope="session")
def fmus() -> dict[str, Path]:
    """Paths of all exported FMUs by name."""
    from ballscrew.fmus.catalogue import NAMES, fmu

    return {name: fmu(name) for name in NAMES}

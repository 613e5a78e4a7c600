"""Compiler of the worlds' functions, and folder of the compiled code.

numba reuses a compiled function until its own file changes, and does not notice changes in
functions that it calls. So the folder changes with any file of the worlds. Without numba the
functions are as they are: the same results, some hundred times slower.
"""

from __future__ import annotations

import getpass
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

try:
    import numba
except ModuleNotFoundError:
    numba = None  # type: ignore[assignment]


def compiled(function: Callable[..., Any]) -> Any:
    """The function, compiled where numba is installed."""
    return function if numba is None else _compile(function)


if numba is not None:
    _content = hashlib.sha256(f"{numba.__version__} {os.environ.get('NUMBA_OPT')}".encode())
    for _file in sorted(Path(__file__).parent.glob("*.py")):
        _content.update(_file.read_bytes())
    FOLDER = Path(tempfile.gettempdir()) / f"worlds-{getpass.getuser()}-{_content.hexdigest()[:16]}"
    numba.config.CACHE_DIR = str(FOLDER)
    _compile = numba.njit(cache=True, error_model="numpy")

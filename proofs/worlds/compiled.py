"""Compiler of the worlds' functions, and folder of the compiled code.

numba reuses a compiled function until its own file changes, and does not notice changes in
functions that it calls. So the folder changes with any file of the worlds.
"""

from __future__ import annotations

import getpass
import hashlib
import os
import tempfile
from pathlib import Path

import numba

_CONTENT = hashlib.sha256(f"{numba.__version__} {os.environ.get('NUMBA_OPT')}".encode())
for _file in sorted(Path(__file__).parent.glob("*.py")):
    _CONTENT.update(_file.read_bytes())
FOLDER = Path(tempfile.gettempdir()) / f"worlds-{getpass.getuser()}-{_CONTENT.hexdigest()[:16]}"

numba.config.CACHE_DIR = str(FOLDER)
compiled = numba.njit(cache=True, error_model="numpy")

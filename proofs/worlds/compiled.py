"""What the worlds' functions are compiled by, and where they are kept between processes.

numba keeps a function while its own file stays as it is, and does not notice that something it
calls has changed. So the folder is another one whenever any file of the worlds is.
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

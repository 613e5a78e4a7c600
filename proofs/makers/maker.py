"""Common part of the makers: read gains, write an FMU of the same PID."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path


def answer(make: Callable[[dict[str, float], Path, Path], None]) -> None:
    """Make the FMU of the second argument from the gains of the first; scratch files next to it."""
    gains = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    target = Path(sys.argv[2])
    scratch = target.parent / f"{target.stem}_scratch"
    scratch.mkdir()
    make(gains, scratch, target)


def held(gains: dict[str, float]) -> str:
    """The body of a `do_step` with inputs that are held over the step, as Python."""
    return (
        "        error = self.x_d - self.x\n"
        "        self.w += step_size * error\n"
        f"        self.u = {gains['Kp']!r} * error + {gains['Ki']!r} * self.w"
        f" - {gains['Kd']!r} * self.v\n"
        "        return True\n"
    )


def beside() -> str:
    """Lines with which an FMU's Python finds this environment's packages, after its own."""
    places = [p for p in sys.path if p.endswith("site-packages")]
    return f"import sys\nsys.path += {places!r}\n"

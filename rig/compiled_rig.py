"""The rig's compiled parts: what moves, and the sampled program."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ..plant import LAWS
from ..solver.kernel import Kernel
from ..solver.stored import stored_kernel
from .wiring import WIRINGS

if TYPE_CHECKING:
    from ..solver.component import Component


@cache
def _sources() -> str:
    """Hash of this folder's sources: what is compiled from them is kept under it."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


@cache
def plant_kernel(law: str) -> Kernel:
    """The compiled moving part with a friction law.

    Raises
    ------
    UnknownLaw
    """
    from ..plant import law as laws

    if law not in LAWS:
        raise laws.UnknownLaw(f"no friction law {law!r}; there are {', '.join(LAWS)}")

    def make() -> Component:
        from .plant import rig_plant

        return rig_plant(laws.law(law), f"rig_plant_{law}")

    return stored_kernel(f"rig_plant_{law}_{_sources()}", make)


@cache
def program_kernel(control: str) -> Kernel:
    """The compiled instruments and controller for one kind of trial."""

    def make() -> Component:
        from .program import program

        return program(WIRINGS[control], f"rig_{control}_program")

    return stored_kernel(f"rig_{control}_program_{_sources()}", make)

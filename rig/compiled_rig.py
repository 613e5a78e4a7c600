"""The rig's compiled parts: what moves, and the sampled program."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from ..plant import LAWS
from ..solver.kernel import Kernel
from ..solver.stored import stored_kernel
from .rig_wiring import WIRINGS, program

if TYPE_CHECKING:
    from ..solver.component import Component


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

    return stored_kernel(
        f"rig_plant_{law}", make, "ballscrew.rig.plant", LAWS[law].partition(":")[0]
    )


@cache
def program_kernel(control: str) -> Kernel:
    """The compiled instruments and controller for one kind of trial."""

    def make() -> Component:
        return program(WIRINGS[control], f"rig_{control}_program")

    return stored_kernel(f"rig_{control}_program", make, "ballscrew.rig.rig_wiring")

"""The rig's compiled parts: the plant, and the sampled program."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from ...plant import LAWS
from ...solver.errors import UnknownName
from ...solver.kernel import Kernel
from ...solver.stored import stored_kernel
from .rig_wiring import program, wirings

if TYPE_CHECKING:
    from ...solver.component import Component


@cache
def plant_kernel(law: str, kind: str = "ball_screw") -> Kernel:
    """The compiled plant of this kind with a friction law; `u` is in volts.

    Raises
    ------
    UnknownName
    """
    if law not in LAWS:
        raise UnknownName(f"no friction law {law!r}; there are {', '.join(LAWS)}")

    name = f"rig_plant_{law}" if kind == "ball_screw" else f"rig_{kind}_{law}"

    def make() -> Component:
        from ...plant import law as laws
        from .plant import rig_plant

        return rig_plant(laws.law(law), name, kind)

    return stored_kernel(name, make, "ballscrew.measurement.rig.plant", LAWS[law].partition(":")[0])


@cache
def program_kernel(control: str, plates: bool = True) -> Kernel:
    """The compiled instruments and controller for one kind of trial."""
    wiring, plain = wirings(plates)[control], wirings()[control]
    name = f"rig_{control}_program" if wiring is plain else f"rig_{control}_program_no_plates"

    def make() -> Component:
        return program(wiring, name)

    return stored_kernel(name, make, "ballscrew.measurement.rig.rig_wiring")

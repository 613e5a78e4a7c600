"""The components that are exported by name, and their FMUs kept ready on disk."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, cast

from ..controllers import CONTROLLERS
from ..plant import PLANTS
from ..solver import kernel_cache
from ..solver.kernel import Kernel
from ..solver.stored import fingerprint, stored_kernel

if TYPE_CHECKING:
    from ..solver.component import Component

NAMES = {**PLANTS, **CONTROLLERS}


class UnknownComponent(KeyError):
    """A name that is not exported; the message lists those that are."""

    def __str__(self) -> str:
        return str(self.args[0])


def component(name: str) -> Component:
    """Build the component of this name.

    Raises
    ------
    UnknownComponent
    """
    if name not in NAMES:
        raise UnknownComponent(f"no component {name!r}; there are {', '.join(NAMES)}")
    module, function = NAMES[name].split(":")
    return cast("Component", getattr(importlib.import_module(module), function)())


def fmu_kernel(name: str) -> Kernel:
    """The compiled component of this name, with the feedback law's ports, from disk if there."""

    def make() -> Component:
        from .export import with_law_ports

        return with_law_ports(component(name))

    return stored_kernel(f"fmu_{name}", make)


def fmu(name: str) -> Path:
    """Path of the FMU of this name in the user's cache, exported if it is not there yet."""
    path = kernel_cache.folder() / "fmus" / f"{name}-{fingerprint()}.fmu"
    if not path.is_file():
        from .export import export_kernel

        export_kernel(fmu_kernel(name), path)
    return path


def variational_kernel(name: str, tangents: int) -> Kernel:
    """The compiled component of this name with tangents, from disk if there."""

    def make() -> Component:
        from .variational import variational

        return variational(component(name), tangents)

    return stored_kernel(f"fmu_{name}_variational_{tangents}", make)


def variational_fmu(name: str, tangents: int) -> Path:
    """Path of the FMU of this name with tangents, as `fmu`."""
    stem = f"{name}_variational_{tangents}"
    path = kernel_cache.folder() / "fmus" / f"{stem}-{fingerprint()}.fmu"
    if not path.is_file():
        from .export import export_kernel

        export_kernel(variational_kernel(name, tangents), path)
    return path


SETPOINT = 0.08  # [m] where a loop goes by itself, so that its default run shows the nominal step


def loop(controller: str, plant: str = "plant") -> Component:
    """The whole closed loop of a plant and a controller of these names, as one component.

    It is called ``<controller>_loop``, and its set-point starts at `SETPOINT`.

    Raises
    ------
    UnknownComponent
    ContractError
        If the two cannot be connected.
    """
    from dataclasses import replace

    from ..solver.connect import connect

    whole = connect(component(plant), component(controller))
    inputs = tuple(replace(i, start=SETPOINT) if i.role == "reference" else i for i in whole.inputs)
    return replace(whole, name=f"{controller}_loop", inputs=inputs)


def loop_fmu_kernel(controller: str, plant: str = "plant") -> Kernel:
    """The compiled closed loop with this controller, from disk if there; raises as `loop` does."""
    return stored_kernel(f"fmu_loop_{plant}_{controller}", lambda: loop(controller, plant))


def loop_fmu(controller: str) -> Path:
    """Path of the FMU of the closed loop with this controller, as `fmu`; raises as `loop` does."""
    path = kernel_cache.folder() / "fmus" / f"{controller}_loop-{fingerprint()}.fmu"
    if not path.is_file():
        from .export import export_kernel

        export_kernel(loop_fmu_kernel(controller), path)
    return path

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
from .carried_runtime import carried_runtime

if TYPE_CHECKING:
    from ..solver.component import Component

NAMES = {**PLANTS, **CONTROLLERS}
# what makes equations or files of components; named, since it is imported when it is needed
_EXPORT, _VARIATIONAL = "ballscrew.fmus.export", "ballscrew.fmus.variational"
_CONNECT = "ballscrew.solver.connect"


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
    module = importlib.import_module(module_of(name))
    return cast("Component", getattr(module, NAMES[name].partition(":")[2])())


def module_of(name: str) -> str:
    """The module that makes the component of this name; raises as `component` does."""
    if name not in NAMES:
        raise UnknownComponent(f"no component {name!r}; there are {', '.join(NAMES)}")
    return NAMES[name].partition(":")[0]


def fmu_kernel(name: str) -> Kernel:
    """The compiled component of this name, with the feedback law's ports, from disk if there."""

    def make() -> Component:
        from .export import with_law_ports

        return with_law_ports(component(name))

    return stored_kernel(f"fmu_{name}", make, module_of(name), _EXPORT)


def fmu(name: str) -> Path:
    """Path of the FMU of this name in the user's cache, exported if it is not there yet."""
    return _stored_fmu(fmu_kernel(name))


def _stored_fmu(kernel: Kernel) -> Path:
    """Path of a kernel's FMU, kept under a hash of all that goes into it."""
    package, _ = carried_runtime()
    content = kernel.to_json() + package + fingerprint(_EXPORT)
    path = kernel_cache.folder() / "fmus" / f"{kernel_cache.hashed_name(kernel.name, content)}.fmu"
    if not path.is_file():
        from .export import export_kernel

        export_kernel(kernel, path)
    return path


def fmu_of(made: Component) -> Path:
    """Path of a component's FMU in the user's cache, as `fmu`; raises as `export` does."""
    from ..solver.codegen import generate
    from .export import with_law_ports

    return _stored_fmu(generate(with_law_ports(made)))


def variational_kernel(name: str, tangents: int) -> Kernel:
    """The compiled component of this name with tangents, from disk if there."""

    def make() -> Component:
        from .variational import variational

        return variational(component(name), tangents)

    return stored_kernel(f"fmu_{name}_variational_{tangents}", make, module_of(name), _VARIATIONAL)


def variational_fmu(name: str, tangents: int) -> Path:
    """Path of the FMU of this name with tangents, as `fmu`."""
    return _stored_fmu(variational_kernel(name, tangents))


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
    parts = module_of(plant), module_of(controller), _CONNECT
    return stored_kernel(f"fmu_loop_{plant}_{controller}", lambda: loop(controller, plant), *parts)


def loop_fmu(controller: str) -> Path:
    """Path of the FMU of the closed loop with this controller, as `fmu`; raises as `loop` does."""
    return _stored_fmu(loop_fmu_kernel(controller))

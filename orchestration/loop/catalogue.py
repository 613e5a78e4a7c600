"""Components by their names for users, and their FMUs in a cache on disk.

A part is a name of the catalogue, a function of a user's file (``mine.py:pi``), either of them
with feed-forward (``nctf+feed_forward``), sampled (``nctf+sampled``) and with
its instruments (``nctf+sampled+position_encoder``), or a component made in the program;
all others are paths of FMUs. The name may end with the units of a drive, as in
``pid+sampled+force``.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, cast

from ... import fmus, solver
from ...controllers import ALONE, CONTROLLERS
from ...fmus.carried_runtime import carried_runtime
from ...fmus.made_here import is_kept, keep
from ...plant import PLANTS
from ...plant.instruments import INSTRUMENTS, PartName, in_units
from ...solver import kernel_cache
from ...solver.component_file import load_component, names_file
from ...solver.errors import UnknownName, did_you_mean
from ...solver.kernel import Kernel
from ...solver.signals import START_VALUE
from ...solver.stored import fingerprint, stored_kernel

if TYPE_CHECKING:
    from ...fmus.native.sources import NativeModel
    from ...solver.component import Component

NAMES = {**PLANTS, **CONTROLLERS, **INSTRUMENTS}
# modules that make equations or files of components; by name, since they are imported when needed
_EXPORT, _VARIATIONAL = "ballscrew.fmus.export", "ballscrew.fmus.variational"
_NATIVE = "ballscrew.fmus.native.export"
_CONNECT = "ballscrew.solver.interconnect"
_ADDED = (
    "ballscrew.controllers.feed_forward",
    "ballscrew.plant.instruments",
    "ballscrew.plant.instruments.measured_through",
    "ballscrew.plant.instruments.sample_and_hold",
)


def component(part: str | Component) -> Component:
    """The component of a part; it is made if the part is a name of the catalogue."""
    if not isinstance(part, str):
        return part
    named = PartName.of(part)
    if named.units:
        return in_units(component(named.plain), named.units)
    if named.sampled or named.instruments:
        from ...plant.instruments.measured_through import in_practice

        law = component(str(PartName(named.bare, named.feed_forward)))
        return in_practice(law, named.sampled, [component(name) for name in named.instruments])
    if named.feed_forward:
        from ...controllers.feed_forward import with_feed_forward

        return with_feed_forward(component(named.bare))
    if names_file(part):
        return load_component(part)
    module, _, function = _place_of(part).partition(":")
    return cast("Component", getattr(importlib.import_module(module), function)())


def name_of(part: str | Component) -> str:
    """Name of a part in tables and files; raises as `component` does."""
    if not isinstance(part, str):
        return part.name
    named = PartName.of(part)
    own = component(named.bare).name if names_file(named.bare) else named.bare
    return replace(named, bare=own).plain


def kept_as(part: str | Component) -> tuple[str, tuple[str, ...]]:
    """Key of a part's kernels on disk: a name, for others' parts with a hash, and its modules."""
    if not isinstance(part, str) or names_file(PartName.of(part).bare):
        made = component(part)
        return f"{made.name}_{made.digest}", ()
    named = PartName.of(part)
    modules = [_place_of(n).partition(":")[0] for n in (named.bare, *named.instruments)]
    return part.replace("+", "_with_"), (*modules, *_ADDED)


def _place_of(name: str) -> str:
    """``module:function`` of a name of the catalogue."""
    if name not in NAMES | ALONE:
        hint = did_you_mean(name, NAMES)
        raise UnknownName(f"no component {name!r}{hint}; there are {', '.join(NAMES)}")
    return (NAMES | ALONE)[name]


def fmu_component(part: str | Component, plant: str = "", tangents: int = 0) -> Component:
    """Content of a part's FMU: see `fmu_kernel`; raises as `fmu` does."""
    if tangents:
        from ...fmus.variational import variational

        return variational(component(part), tangents)
    if plant:
        return loop(part, plant)
    from ...fmus.feedback_law import with_law_ports

    return with_law_ports(component(part))


def fmu_kernel(part: str | Component, plant: str = "", tangents: int = 0) -> Kernel:
    """The compiled part; with a `plant` its whole loop, with `tangents` no ports of a law."""
    (name, modules), by = kept_as(part), _EXPORT
    if tangents:
        name, by = f"{name}_variational_{tangents}", _VARIATIONAL
    elif plant:
        of, others = kept_as(plant)
        name, modules, by = f"loop_{of}_{name}", (*others, *modules), _CONNECT
    return stored_kernel(f"fmu_{name}", lambda: fmu_component(part, plant, tangents), *modules, by)


def partials_kernel(part: str) -> Kernel:
    """The partial derivatives of a part; of a sampled one, of the next values of its states."""

    def make() -> Component:
        from ...fmus.native.partials import partials
        from ...solver.component import State
        from ...solver.for_tangents import dithered_average

        own = dithered_average(component(part))
        if (period := own.sample_time) is None:
            return partials(own)
        new = (State(d.name, d.unit, d.meaning, d.update, d.start, d.nominal) for d in own.discrete)
        states, known = (*own.states, *new), (*own.parameters, period)
        own = replace(own, states=states, discrete=(), sample_time=None, parameters=known)
        return partials(own)

    name, modules = kept_as(part)
    return stored_kernel(f"linear_{name}", make, __name__, *modules)


def fmu(part: str | Component, plant: str = "", tangents: int = 0) -> Path:
    """Path of the FMU of `fmu_kernel` in the user's cache; exported if it does not exist yet."""
    return stored_fmu(fmu_kernel(part, plant, tangents))


def stored_fmu(kernel: Kernel, everywhere: bool = False) -> Path:
    """Path of a kernel's FMU in the cache, for this platform or for all of `carried_runtime`."""
    package, _ = carried_runtime(everywhere)
    content = kernel.to_json() + package + fingerprint(_EXPORT)

    def write(path: Path) -> None:
        from ...fmus.export import export_kernel

        export_kernel(kernel, path, everywhere)

    return kept_fmu(kernel.name, content, write)


def kept_fmu(name: str, content: str, write: Callable[[Path], object]) -> Path:
    """Path of an FMU in the user's cache; written if it does not exist yet."""
    path = kernel_cache.entry(kernel_cache.FMUS, f"{kernel_cache.hashed_name(name, content)}.fmu")
    return path if is_kept(path) else keep(path, lambda: write(path))


def catalogued_model(part: str | Component, plant: str = "", tangents: int = 0) -> NativeModel:
    """The kernel of `fmu_kernel` with its partial derivatives, for a native FMU."""
    from ...fmus.native import partials
    from ...fmus.native.sources import NativeModel

    kernel = fmu_kernel(part, plant, tangents)
    maker = Path(partials.__file__).read_text(encoding="utf-8")
    stored = kernel_cache.hashed_name(f"partials_{kernel.name}", maker + kernel.to_json())

    def make() -> Component:
        return partials.partials(fmu_component(part, plant, tangents))

    return NativeModel(kernel, stored_kernel(stored, make))


@cache
def way_of_making() -> str:
    """Hash of everything except the equations that affects the FMU: Python and C sources."""
    digest = hashlib.sha256(fingerprint(_NATIVE).encode())
    for folder in (resources.files(fmus) / "native" / "c", resources.files(solver) / "c"):
        for file in sorted(folder.iterdir(), key=lambda f: f.name):
            if file.name.endswith((".c", ".h")):
                digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def loop(controller: str | Component, plant: str = "plant") -> Component:
    """The whole closed loop of a plant and a controller, as one component, ``<name>_loop``."""
    from ...solver.interconnect import connect

    law = component(controller)
    whole = connect(component(plant), law)
    goal = {"reference": START_VALUE}
    inputs = tuple(replace(i, start=goal.get(i.role, i.start)) for i in whole.inputs)
    return replace(whole, name=f"{law.name}_loop", inputs=inputs)

"""Which part an option is for: the plant, every controller, or one controller."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from .options import read_named
from .solver.errors import UserError


def mappings(options: argparse.Namespace, controllers: Sequence[str]) -> dict[str, dict[str, str]]:
    """Port names of ``--map`` for each controller, also ``plant.PORT`` and ``controller.PORT``."""

    texts = read_named("--map", options.map, "THEIRS=OURS")
    found: dict[str, dict[str, str]] = {name: {} for name in controllers}
    for theirs, ours in texts.items():
        side, port = split_side(theirs, controllers)
        if not side:
            for name in _owners(theirs, options.plant or "plant", controllers):
                found[name][theirs] = ours
            continue
        if side != "plant" and port in texts and len(controllers) == 1:
            raise UserError(f"--map {theirs} and --map {port}: expected one of them")
        for name in controllers if side == "plant" else meant(side, controllers):
            own = f"plant.{port}" if side == "plant" else f"controller.{port}"
            if own in found[name]:
                raise UserError(f"--map {theirs} and --map {own}: expected one of them")
            found[name][own] = ours
    return found


def _owners(port: str, plant: str, controllers: Sequence[str]) -> Sequence[str]:
    """Controllers whose loops have a port of this name; if none has it, wiring reports it."""
    if len(controllers) == 1:
        return controllers
    from .orchestration.loop.parts import Part

    def has(name: str) -> bool:
        part = Part(name)
        return port in part.inputs or port in part.outputs

    owners = [name for name in controllers if has(name)]
    return controllers if not owners or has(plant) else owners


def check_labels(option: str, parts: Sequence[str]) -> None:
    """Reject two parts with the same name: options, tables and files could not distinguish them."""
    from .orchestration.loop.parts import Part

    seen: dict[str, str] = {}
    for part in parts:
        if parts.count(part) > 1:
            raise UserError(f"{option} has {part} twice; expected each once")
        label = Part(part).own_name
        if label in seen:
            raise UserError(
                f"{option}: {seen[label]} and {part} are both called {label}; rename one of them"
            )
        seen[label] = part


def labels_of(controllers: Sequence[str]) -> dict[str, str]:
    """Controllers by their names in options; the words for sides are not names.

    Without its instruments, if no other has the same name: ``pid`` for ``pid+position_encoder``.
    """
    from .orchestration.loop.parts import Part

    labels = {Part(c).own_name: c for c in controllers}
    alone = [Part(Part(c).bare).own_name for c in controllers]
    shorter = {n: c for n, c in zip(alone, controllers, strict=True) if alone.count(n) == 1}
    labels = shorter | labels
    return {label: c for label, c in labels.items() if label not in ("plant", "controller")}


def split_side(name: str, controllers: Sequence[str]) -> tuple[str, str]:
    """Side and name of ``SIDE.NAME``: plant, controller, or a controller's own; "" if it has none.

    A file's name may have dots: the longest match is used.
    """
    sides = ("plant", "controller", *labels_of(controllers))
    side = max((s for s in sides if name.startswith(f"{s}.")), key=len, default="")
    return side, name.removeprefix(f"{side}.") if side else name


def meant(side: str, controllers: Sequence[str]) -> Sequence[str]:
    """The controllers of a side's name."""
    if side == "controller":
        return controllers
    return [c for label, c in labels_of(controllers).items() if label == side]

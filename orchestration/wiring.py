"""Which signal goes where: ports matched by name, or as the user maps them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..fmus.law_ports import gain_port, rate_port, reference_port
from .participant import Participant


class WiringError(ValueError):
    """Ports that should meet do not; the message names them and what comes near."""


@dataclass(frozen=True)
class Wiring:
    """The connections of a loop.

    Attributes
    ----------
    commands : tuple of (controller output, plant input)
    signals : tuple of (plant output, controller input)
    references : tuple of str
        Controller inputs that nothing drives: set-points.
    accepts_law, reports_law : bool
        Whether the plant has the law's inputs, the controller its outputs.
    """

    commands: tuple[tuple[str, str], ...]
    signals: tuple[tuple[str, str], ...]
    references: tuple[str, ...]
    accepts_law: bool
    reports_law: bool

    def plant_law(self) -> list[str]:
        """The plant's inputs beside the commands, in the order in which a law is written.

        Gains, one row for each command, references likewise, and rates.
        """
        commands, signals = [c for _, c in self.commands], [s for s, _ in self.signals]
        gains = [gain_port(c, s) for c in commands for s in signals]
        references = [reference_port(c, s) for c in commands for s in signals]
        return [*gains, *references, *map(rate_port, commands)]

    def controller_law(self) -> list[str]:
        """The controller's outputs beside the commands, in the order in which a law is read.

        Gains, one row for each command, and rates.
        """
        commands, signals = [c for c, _ in self.commands], [s for _, s in self.signals]
        return [*(gain_port(c, s) for c in commands for s in signals), *map(rate_port, commands)]


def wire(
    plant: Participant, controller: Participant, mapping: Mapping[str, str] | None = None
) -> Wiring:
    """Match the ports of a plant and a controller.

    Parameters
    ----------
    mapping : mapping of str to str, optional
        ``theirs -> ours``: names of a stranger's ports to the names they meet on the other side.

    Raises
    ------
    WiringError
        If the plant's command or every measurement of the controller stays unmatched.
    """
    mapping = dict(mapping or {})
    known = {*plant.inputs, *plant.outputs, *controller.inputs, *controller.outputs}
    for theirs in mapping:
        if theirs not in known:
            raise WiringError(f"--map: neither side has a port {theirs!r}{_near(theirs, known)}")

    def ours(name: str) -> str:
        return mapping.get(name, name)

    plant_outputs = {ours(n): n for n in plant.outputs}
    law = {
        port
        for command in plant.inputs
        for y in plant.outputs
        for port in (gain_port(command, y), reference_port(command, y), rate_port(command))
    }
    needed = {ours(n): n for n in plant.inputs if n not in law}
    commands = tuple((n, needed[ours(n)]) for n in controller.outputs if ours(n) in needed)
    signals = tuple(
        (plant_outputs[ours(n)], n) for n in controller.inputs if ours(n) in plant_outputs
    )
    driven = {theirs for _, theirs in commands}
    missing = [n for n in needed.values() if n not in driven]
    if missing:
        raise WiringError(
            f"nothing drives the input {missing[0]!r} of {plant.name}: {controller.name} has the "
            f"outputs {', '.join(controller.outputs) or 'none'}"
            f"{_near(missing[0], controller.outputs)}; use --map theirs=ours"
        )
    if not signals:
        raise WiringError(
            f"{controller.name} measures nothing of {plant.name}: its inputs are "
            f"{', '.join(controller.inputs) or 'none'}, the plant's outputs are "
            f"{', '.join(plant.outputs)}; use --map theirs=ours"
        )
    free = tuple(n for n in controller.inputs if n not in {c for _, c in signals})
    wiring = Wiring(commands, signals, free, False, False)
    return replace(
        wiring,
        accepts_law=set(wiring.plant_law()) <= set(plant.inputs),
        reports_law=set(wiring.controller_law()) <= set(controller.outputs),
    )


def _near(name: str, names: object) -> str:
    close = difflib.get_close_matches(name, list(names), n=3, cutoff=0.5)  # type: ignore[call-overload]
    return f" (nearest: {', '.join(close)})" if close else ""

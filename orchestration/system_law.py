"""The connections of an .ssp that carry the feedback law of a command."""

from __future__ import annotations

from collections.abc import Sequence

from ..fmus.ports import gain_port, rate_port, reference_port
from ..fmus.system_reading import SystemConnection
from .fmu_instance import Instance


def commands_of(
    commands: Sequence[SystemConnection], measured: Sequence[SystemConnection]
) -> list[SystemConnection]:
    """The commands without the law ports of any of them."""
    signals = {c.source.connector for c in measured}
    inputs = {c.target.connector for c in commands}
    law = {
        port
        for u in inputs
        for port in (
            rate_port(u),
            *(gain_port(u, y) for y in signals),
            *(reference_port(u, y) for y in signals),
        )
    }
    return [c for c in commands if c.target.connector not in law]


def _law(command: SystemConnection, measured: Sequence[SystemConnection]) -> list[tuple[str, str]]:
    """The law's ports of a command, on the plant's side and on the controller's."""
    source, target = command.source.connector, command.target.connector
    return [
        (rate_port(source), rate_port(target)),
        *(
            (port(source, c.target.connector), port(target, c.source.connector))
            for c in measured
            for port in (gain_port, reference_port)
        ),
    ]


def accepts_law(
    plant: Instance, main: Sequence[SystemConnection], measured: Sequence[SystemConnection]
) -> bool:
    return bool(main) and all(
        port in plant.inputs for command in main for _, port in _law(command, measured)
    )


def reports_law(
    main: Sequence[SystemConnection],
    measured: Sequence[SystemConnection],
    commands: Sequence[SystemConnection],
) -> bool:
    joined = {(c.source.connector, c.target.connector) for c in commands}
    return all(pair in joined for command in main for pair in _law(command, measured))

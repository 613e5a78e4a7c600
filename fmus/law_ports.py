"""Names of the feedback law's ports, the same for plant and controller."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def gain_port(command: str, signal: str) -> str:
    """Port of the derivative of a command by a signal."""
    return f"{command}_gain_{signal}"


def reference_port(command: str, signal: str) -> str:
    """Port of the value of a signal at which a command was computed."""
    return f"{command}_ref_{signal}"


def rate_port(command: str) -> str:
    """Port of the rate of a command from the controller's own states."""
    return f"{command}_rate"


def law_ports(commands: Iterable[str], signals: Sequence[str]) -> set[str]:
    """All ports that a feedback law of these commands and signals can have."""
    return {
        port
        for u in commands
        for y in signals
        for port in (gain_port(u, y), reference_port(u, y), rate_port(u))
    }

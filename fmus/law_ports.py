"""Names of the feedback law's ports, the same for plant and controller."""

from __future__ import annotations

import re
from collections.abc import Iterable


def gain_port(command: str, signal: str) -> str:
    """Port of the derivative of a command by a signal."""
    return f"{command}_gain_{signal}"


def reference_port(command: str, signal: str) -> str:
    """Port of the value of a signal at which a command was computed."""
    return f"{command}_ref_{signal}"


def rate_port(command: str) -> str:
    """Port of the rate of a command from the controller's own states."""
    return f"{command}_rate"


def law_ports(ports: Iterable[str], commands: Iterable[str], signals: Iterable[str]) -> set[str]:
    """Those of the ports that belong to a feedback law of some of these commands and signals."""
    us, ys = set(commands), set(signals)
    rates = {rate_port(u) for u in us}
    return {port for port in ports if port in rates or _of_pair(port, us, ys)}


def _of_pair(port: str, commands: set[str], signals: set[str]) -> bool:
    """Whether it is the gain or reference of a command and a signal."""
    ends = (m.span() for m in re.finditer("_(gain|ref)_", port))
    return any(port[:start] in commands and port[end:] in signals for start, end in ends)

"""Names of the ports of the feedback law and of tangents, the same for export and import."""

from __future__ import annotations

import re
from collections.abc import Iterable

FRAME = "tangent_frame"
TRACE = "trace_integral"
FRAME_ROLE = "tangent frame"
SET_ROLE = "tangent"
SET = "_set"
_TANGENT = re.compile(r"(?P<name>.+)_d(?P<number>[1-9]\d*)")


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


def tangent_port(name: str, number: int) -> str:
    """Port of a tangent of a state, an input or an output; numbers count from 1."""
    return f"{name}_d{number}"


def set_port(tangent: str) -> str:
    """Input that sets a tangent of a state."""
    return tangent + SET


def is_tangent_port(name: str, names: set[str]) -> bool:
    """Whether a port belongs to the tangents of one of `names`, or to all tangents."""
    if name in (FRAME, TRACE):
        return True
    match = _TANGENT.fullmatch(name.removesuffix(SET))
    return match is not None and (name.endswith(SET) or match["name"] in names)


def tangent_states(parameters: list[str]) -> tuple[list[str], int]:
    """Names of the states that have tangents, in their order, and how many tangents each has."""
    starts = (p.removesuffix("_start") for p in parameters if p.endswith("_start"))
    found = [match for name in starts if (match := _TANGENT.fullmatch(name))]
    states = list(dict.fromkeys(m["name"] for m in found))
    return states, max((int(m["number"]) for m in found), default=0)

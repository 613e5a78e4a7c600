"""Names of the ports for tangents, the same for export and import."""

from __future__ import annotations

import re

FRAME = "tangent_frame"
TRACE = "trace_integral"
FRAME_ROLE = "tangent frame"
SET_ROLE = "tangent"
SET = "_set"
_TANGENT = re.compile(r"(?P<name>.+)_d(?P<number>[1-9]\d*)")


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
    found = [
        match
        for p in parameters
        if (match := _TANGENT.fullmatch(p.removesuffix("_start"))) and p.endswith("_start")
    ]
    states = list(dict.fromkeys(m["name"] for m in found))
    return states, max((int(m["number"]) for m in found), default=0)

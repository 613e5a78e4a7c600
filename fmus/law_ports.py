"""Names of the feedback law's ports, the same for plant and controller."""

from __future__ import annotations


def gain_port(command: str, signal: str) -> str:
    """Port of the derivative of a command by a signal."""
    return f"{command}_gain_{signal}"


def reference_port(command: str, signal: str) -> str:
    """Port of the value of a signal at which a command was computed."""
    return f"{command}_ref_{signal}"


def rate_port(command: str) -> str:
    """Port of the rate of a command from the controller's own states."""
    return f"{command}_rate"

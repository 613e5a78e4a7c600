"""Terminals of FMI 3.0: a plant and a controller are joined by two connections, not by fourteen."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from .interface import Interface
from .law_ports import gain_port, rate_port, reference_port

COMMAND, MEASUREMENT = "command", "measurement"


def terminals(interface: Interface) -> dict[str, list[str]]:
    """Members of each terminal by its name; none for a component without law ports.

    ``command`` holds a command and its feedback law, ``measurement`` the signals that the law is
    about.
    """
    names = {v.name: v.causality for v in interface.variables}
    found: dict[str, list[str]] = {}
    for command in names:
        if rate_port(command) not in names:
            continue
        signals = [n for n in names if gain_port(command, n) in names]
        law = [port(command, n) for port in (gain_port, reference_port) for n in signals]
        found.setdefault(COMMAND, []).extend([command, *law, rate_port(command)])
        found.setdefault(MEASUREMENT, []).extend(signals)
    return {name: list(dict.fromkeys(members)) for name, members in found.items()}


def terminals_and_icons(interface: Interface) -> bytes:
    """The text of ``terminalsAndIcons/terminalsAndIcons.xml``; it has an icon in any case.

    Members of the same name meet (matching rule ``bus``), so that a controller which has a law for
    a signal that this plant lacks fits all the same: a gain is here with its reference, or not at
    all.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    picture = ET.SubElement(root, "GraphicalRepresentation")
    ET.SubElement(picture, "CoordinateSystem", corners, suggestedScalingFactorTo_mm="0.1")
    ET.SubElement(picture, "Icon", corners)
    found = terminals(interface)
    if found:
        listed = ET.SubElement(root, "Terminals")
        for name, members in found.items():
            terminal = ET.SubElement(listed, "Terminal", name=name, matchingRule="bus")
            for member in members:
                ET.SubElement(
                    terminal,
                    "TerminalMemberVariable",
                    variableName=member,
                    memberName=member,
                    variableKind="signal",
                )
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"

"""Terminals of FMI 3.0: a plant and a controller need two connections instead of fourteen."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from .interface import Interface
from .law_ports import gain_port, rate_port, reference_port

COMMAND, MEASUREMENT = "command", "measurement"


def terminals(interface: Interface) -> dict[str, list[str]]:
    """Members of each terminal by its name; none for a component without law ports.

    ``command`` has a command and its feedback law, ``measurement`` the signals of
    the law.
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


def terminals_xml(found: dict[str, list[str]]) -> bytes:
    """The text of ``terminalsAndIcons/terminalsAndIcons.xml`` for `terminals`.

    Members of the same name are connected (matching rule ``bus``), so that a controller whose
    law uses a signal that this plant does not have also fits: a gain is always together with its
    reference.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
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

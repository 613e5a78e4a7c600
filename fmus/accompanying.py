"""Additional files of an FMU: the page with its equations, licences, terminals of FMI 3.0."""

from __future__ import annotations

import functools
import math
from importlib.metadata import distribution
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from ..solver.kernel import Kernel
from .archive import xml_text
from .interface import Interface, Variable
from .ports import gain_port, rate_port, reference_port

if TYPE_CHECKING:
    from jinja2 import Template

# Here and not in a separate file: stored FMUs are identified by a hash of the modules' text.
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{{ kernel.name }}</title><style>
body { font-family: sans-serif; max-width: 60rem; margin: 2rem auto; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 }
td, th { border: 1px solid #bbb; padding: .25rem .6rem; text-align: left; vertical-align: top }
pre { white-space: pre-wrap }
</style></head><body>
<h1>{{ kernel.name }}</h1>
<p>{{ kernel.description }}.</p>
<h2>Equations</h2>
<pre>{{ kernel.source }}</pre>
{% for causality in ("input", "output", "parameter") %}
<h2>{{ causality | capitalize }}s</h2>
<table><tr><th>name</th><th>unit</th><th>default</th><th>range</th><th>meaning</th></tr>
{% for v in variables if v.causality == causality %}
<tr><td>{{ v.name }}</td><td>{{ v.unit }}</td><td>{{ "" if v.start is none else v.start }}</td>
<td>{{ v | limits }}</td><td>{{ v.description }}</td></tr>
{% endfor %}
</table>
{% endfor %}
</body></html>
"""


def accompanying_files(kernel: Kernel, interface: Interface, fmi: int) -> dict[str, bytes]:
    """Bytes of each file by its name in an FMU of this version of FMI."""
    page = _template().render(kernel=kernel, variables=interface.variables)
    files = {
        "documentation/index.html": page.encode(),
        "documentation/licenses/license.txt": licence("ballscrew"),
    }
    if fmi == 3 and (terminals := _terminals(interface)):
        files["terminalsAndIcons/terminalsAndIcons.xml"] = _terminals_text(terminals)
    return files


def licence(package: str) -> bytes:
    """The licence of an installed package."""
    files = distribution(package).files or []
    found = next(f for f in files if f.name == "LICENSE")
    return Path(str(found.locate())).read_bytes()


@functools.cache
def _template() -> Template:
    from jinja2 import Environment, StrictUndefined  # takes 50 ms, needed only for exports

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["limits"] = _limits
    return environment.from_string(_PAGE)


def _limits(v: Variable) -> str:
    unbounded = math.isinf(v.minimum) and math.isinf(v.maximum)
    return "" if unbounded else f"{v.minimum:g} to {v.maximum:g}"


def _terminals(interface: Interface) -> dict[str, list[str]]:
    """Members of each terminal by its name; none for a component without law ports.

    ``command`` has a command and its feedback law, ``measurement`` the signals of the law, so that
    a plant and a controller need two connections instead of fourteen.
    """
    names = {v.name for v in interface.variables}
    found: dict[str, list[str]] = {}
    for command in (v.name for v in interface.variables if rate_port(v.name) in names):
        signals = [v.name for v in interface.variables if gain_port(command, v.name) in names]
        law = [port(command, n) for port in (gain_port, reference_port) for n in signals]
        found.setdefault("command", []).extend([command, *law, rate_port(command)])
        found.setdefault("measurement", []).extend(signals)
    return {name: list(dict.fromkeys(members)) for name, members in found.items()}


def _terminals_text(terminals: dict[str, list[str]]) -> bytes:
    """Members of the same name are connected (matching rule ``bus``).

    A controller whose law uses a signal that this plant does not have also fits: a gain is always
    together with its reference.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    listed = ET.SubElement(root, "Terminals")
    for name, members in terminals.items():
        terminal = ET.SubElement(listed, "Terminal", name=name, matchingRule="bus")
        for n in members:
            about = {"variableName": n, "memberName": n, "variableKind": "signal"}
            ET.SubElement(terminal, "TerminalMemberVariable", about)
    return xml_text(root)

"""Additional files of an FMU: documentation page, licences, terminals."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path

from ..solver.kernel import Kernel
from .documentation import html_page
from .interface import Interface
from .terminals import terminals, terminals_xml


def accompanying_files(kernel: Kernel, interface: Interface, fmi: int) -> dict[str, bytes]:
    """Bytes of each file by its name in the FMU.

    Parameters
    ----------
    kernel : Kernel
    interface : Interface
    fmi : {2, 3}
        Version of FMI; terminals are of FMI 3.
    """
    files = {
        "documentation/index.html": html_page(kernel, interface).encode(),
        "documentation/licenses/license.txt": licence("ballscrew"),
    }
    if fmi == 3 and (found := terminals(interface)):
        files["terminalsAndIcons/terminalsAndIcons.xml"] = terminals_xml(found)
    return files


def licence(package: str) -> bytes:
    """The licence of an installed package."""
    files = distribution(package).files or []
    found = next(f for f in files if f.name == "LICENSE")
    return Path(str(found.locate())).read_bytes()

"""Additional files of an FMU: documentation page, licences, picture, terminals."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path

from ..solver.kernel import Kernel
from .documentation import html_page
from .icon import icon
from .interface import Interface
from .terminals import terminals_and_icons


def accompanying_files(kernel: Kernel, interface: Interface, fmi: int) -> dict[str, bytes]:
    """Bytes of each file by its name in the FMU.

    Parameters
    ----------
    kernel : Kernel
    interface : Interface
    fmi : {2, 3}
        Version of FMI, which decides where the icon is.
    """
    commanded = any(i.role == "signal" for i in kernel.inputs)
    asked = any(i.role == "reference" for i in kernel.inputs)
    measures = any(i.role == "measurement" for i in kernel.inputs)
    picture = icon(commanded or not measures, asked or measures)
    files = {
        "documentation/index.html": html_page(kernel, interface).encode(),
        "documentation/licenses/license.txt": licence("ballscrew"),
    }
    if fmi == 2:
        return files | {"model.png": picture}
    return files | {
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(interface),
    }


def licence(package: str) -> bytes:
    """The licence of an installed package."""
    files = distribution(package).files or []
    found = next(f for f in files if f.name == "LICENSE")
    return Path(str(found.locate())).read_bytes()

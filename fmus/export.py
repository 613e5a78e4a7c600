"""Turn components into FMUs with pythonfmu."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
import zipfile
from dataclasses import asdict
from importlib.metadata import distribution
from pathlib import Path

from ..solver.codegen import generate
from ..solver.component import Component
from ..solver.files import naming, temporary_folder, write_atomically
from ..solver.kernel import Kernel
from ..solver.kernel_cache import hashed_name
from .accompanying import accompanying_files, licence
from .archive import pack
from .carried_runtime import carried_runtime
from .description import model_description, token_of
from .feedback_law import with_law_ports
from .interface import interface_of
from .made_here import remember

_SLAVE = '''"""The slave that pythonfmu loads: {description}."""

import ctypes
from base64 import b64decode

from {tapes} import TAPES
from {package}.fmus.runtime import ComponentSlave

# pythonfmu 0.7 runs this text at every instantiation, and each time releases a reference to this
# namespace that it does not own; without one given back, the second instance crashes the process.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


class Slave(ComponentSlave):
    layout = {layout!r}
    equations = {equations!r}
    tapes = b64decode(TAPES)
'''


def export(component: Component, path: Path | str) -> Path:
    """Export a component as an FMI 2.0 co-simulation FMU.

    Parameters
    ----------
    component : Component
    path : path-like
        The FMU to write; replaced as a whole or not at all.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ContractError
        If this version cannot solve the component.
    OSError
        If the file cannot be written.
    """
    return export_kernel(generate(with_law_ports(component)), path, everywhere=True)


def export_kernel(kernel: Kernel, path: Path | str, everywhere: bool = False) -> Path:
    """Export a compiled component with its law ports, as `export` does.

    It runs on this platform; if `everywhere`, on all platforms of `carried_runtime`.
    """
    path = Path(path)
    interface = interface_of(kernel)
    token = token_of(kernel.source, repr(interface))
    package, carried = carried_runtime(everywhere)
    texts = {
        kernel.module: kernel.source,
        (tapes := hashed_name(f"tapes_{kernel.name}", kernel.tapes)): f"TAPES = {kernel.tapes!r}\n",
    }
    own = {"equations": kernel.module, "layout": asdict(interface.layout), "tapes": tapes}
    slave = _SLAVE.format(description=kernel.description, package=package, **own)
    script = hashed_name(f"slave_{kernel.name}", slave)
    with naming(Path(tempfile.gettempdir())), temporary_folder("export") as folder:
        sources = Path(folder) / "sources"
        sources.mkdir()
        for name, text in {script: slave, **texts}.items():
            (sources / f"{name}.py").write_text(text, encoding="utf-8", newline="\n")
        for name, data in carried.items():
            file = sources / package / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        others = [sources / package, *(sources / f"{name}.py" for name in texts)]
        built = _build(sources / f"{script}.py", others, Path(folder) / f"{kernel.name}.fmu")
        ours = accompanying_files(kernel, interface, 2) | {
            "modelDescription.xml": model_description(kernel, interface, 2, token),
            "documentation/licenses/pythonfmu.txt": licence("pythonfmu"),
        }
        write_atomically(path, _normalized(built, ours))
    remember(path)
    return path


def _build(script: Path, others: list[Path], target: Path) -> Path:
    """Run pythonfmu's builder; leave `sys.path` and `sys.modules` as they were."""
    from pythonfmu import builder

    # If an FMU ran in this process before, its own copy of pythonfmu may be imported,
    # which has no binaries: use the builder of the installed package.
    builder.HERE = Path(str(distribution("pythonfmu").locate_file("pythonfmu")))
    paths, modules = list(sys.path), set(sys.modules)
    sys.path.insert(0, str(script.parent))
    level = logging.getLogger("pythonfmu").level
    try:
        logging.getLogger("pythonfmu").setLevel(logging.ERROR)
        built = builder.FmuBuilder.build_FMU(script, dest=target, project_files=others)
    finally:
        logging.getLogger("pythonfmu").setLevel(level)
        sys.path[:] = paths
        for name in set(sys.modules) - modules:
            if script.parent in Path(str(getattr(sys.modules[name], "__file__", ""))).parents:
                del sys.modules[name]
    return Path(built)


def _normalized(built: Path, ours: dict[str, bytes]) -> bytes:
    """The FMU's bytes with our files added, in fixed order and with fixed time stamps."""
    with zipfile.ZipFile(built) as old:
        files = {name.replace(os.sep, "/"): old.read(name) for name in old.namelist()} | ours
    names = sorted(files, key=lambda n: (n != "modelDescription.xml", n))
    return pack({name: files[name] for name in names})

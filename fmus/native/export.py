"""Turn components into FMUs with compiled C and its sources."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...solver.compilers import (
    PLATFORMS,
    compile_library,
    compiler_for,
    own_platform,
    platforms_of,
)
from ...solver.component import Component
from ...solver.files import write_atomically
from ..accompanying import accompanying_files
from ..archive import pack
from ..export import with_law_ports
from ..made_here import remember
from ..model_description import VERSION
from . import description, description3
from .sources import MAIN, NativeModel, native_model, sources


@dataclass(frozen=True)
class NativeFmu:
    """An FMU that was written.

    Attributes
    ----------
    path : Path
    compiled : tuple of str
        Platforms with a binary.
    missing : tuple of str
        Platforms without a compiler; the sources are in the FMU in any case.
    """

    path: Path
    compiled: tuple[str, ...]
    missing: tuple[str, ...]

    @property
    def note(self) -> str:
        """One line about what is missing; empty if nothing is."""
        if not self.missing:
            return ""
        held = f"binaries for {', '.join(self.compiled)}" if self.compiled else "sources only"
        return (
            f"{self.path}: no C compiler for {', '.join(self.missing)}, so it contains {held}; "
            "install a compiler, or the package ziglang, which compiles for all platforms"
        )


def export_native(
    component: Component,
    path: Path | str,
    *,
    fmi: int = 2,
    platforms: Sequence[str] | None = None,
) -> NativeFmu:
    """Export a component as an FMU of compiled C, for co-simulation and model exchange.

    Parameters
    ----------
    component : Component
        Without the feedback law's ports.
    path : path-like
        The FMU to write; replaced as a whole or not at all.
    fmi : {2, 3}
        Version of FMI.
    platforms : sequence of str, optional
        One or more of ``linux64``, ``win64``, ``darwin64``, and with FMI 3.0 ``aarch64-linux``,
        ``aarch64-windows``, ``aarch64-darwin``; default: this platform.

    Raises
    ------
    ValueError
        If this version of FMI has no such platform.
    UnsupportedComponent
        If this version cannot solve the component, or C has no function for its equations.
    CompilerFailed
        If a compiler was found but fails.
    OSError
        If the file cannot be written.
    """
    return write_native(native_model(with_law_ports(component)), path, fmi, platforms)


def write_native(
    model: NativeModel, path: Path | str, fmi: int, platforms: Sequence[str] | None = None
) -> NativeFmu:
    """As `export_native`, for a compiled component."""
    path = Path(path)
    wanted = tuple(platforms if platforms is not None else filter(None, [own_platform()]))
    for name in wanted:
        if name not in platforms_of(fmi):
            raise ValueError(
                f"platform {name!r}, expected with FMI {fmi} some of {', '.join(platforms_of(fmi))}"
            )
    able = tuple(name for name in wanted if compiler_for(name))
    token = _token(model, fmi)
    texts = sources(model, fmi, token)
    stem = model.kernel.name
    files: dict[str, bytes] = {}
    if fmi == 2:
        files["modelDescription.xml"] = description.description_of(model, token)
    else:
        files["modelDescription.xml"] = description3.description_of(model, token)
        texts_and_build = description3.build_description(stem)
        files["sources/buildDescription.xml"] = texts_and_build
    for name in able:
        kind = PLATFORMS[name]
        library = compile_library(name, texts, MAIN[fmi], stem)
        files[f"binaries/{kind.folder[fmi]}/{stem}{kind.suffix}"] = library
    files |= accompanying_files(model.kernel, model.interface, fmi)
    files |= {f"sources/{name}": text.encode() for name, text in sorted(texts.items())}
    write_atomically(path, pack(files))
    remember(path)
    return NativeFmu(path, able, tuple(name for name in wanted if name not in able))


def _token(model: NativeModel, fmi: int) -> str:
    """The same for the same equations, variables, C sources and versions, in every process."""
    text = "".join(sources(model, fmi, "").values()) + repr(model.interface) + VERSION
    digest = hashlib.sha256(text.encode()).hexdigest()
    parts = (digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])
    return "{" + "-".join(parts) + "}"

"""Turn components into FMUs with compiled C and its sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from ...solver import compilers, kernel_cache
from ...solver.compilers import PLATFORMS, compile_library, compiler_for, platforms_of
from ...solver.component import Component
from ...solver.files import write_atomically
from ...solver.kernel_cache import hashed_name
from ..accompanying import accompanying_files
from ..archive import pack, xml_text
from ..dependencies import kinds_of
from ..description import MAIN, model_description, token_of
from ..feedback_law import with_law_ports
from ..made_here import remember
from .sources import NativeModel, declarations, native_model, own_sources, sources_of_all

# what is alike is compiled apart; its loops are too short for vectors, which make it larger
_FLAGS = ("-DSEPARATE", "-fno-tree-vectorize", "-fno-asynchronous-unwind-tables")


@dataclass(frozen=True)
class NativeFmu:
    """An FMU that was written."""

    path: Path
    compiled: tuple[str, ...]  # platforms with a binary
    missing: tuple[str, ...]  # platforms without a compiler; the sources are there in any case

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
    component: Component, path: Path | str, *, fmi: int = 2, platforms: Sequence[str] | None = None
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
    ContractError
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
    wanted = tuple(platforms if platforms is not None else filter(None, [compilers.own_platform()]))
    for name in wanted:
        if name not in platforms_of(fmi):
            raise ValueError(
                f"platform {name!r}, expected with FMI {fmi} some of {', '.join(platforms_of(fmi))}"
            )
    able = tuple(name for name in wanted if compiler_for(name))
    kernel, interface = model.kernel, model.interface
    own = own_sources(model)
    alike = sources_of_all(fmi) | {"model.h": declarations(own["model.h"])}
    token = token_of(*alike.values(), *own.values(), repr(interface))
    texts = {**alike, **own, "token.h": f'OWN const char TOKEN[] = "{token}";\n'}
    kinds = kinds_of(model.partials, model.entries)
    described = model_description(kernel, interface, fmi, token, kinds, model.exchanges)
    files = {"modelDescription.xml": described}
    if fmi == 3:
        files["sources/buildDescription.xml"] = _build_description(kernel.name)
    for name in able:
        kind = PLATFORMS[name]
        given = [*_FLAGS, "equations.c", _alike(name, fmi, alike)]
        library = compile_library(name, texts, given, kernel.name)
        files[f"binaries/{kind.folder[fmi]}/{kernel.name}{kind.suffix}"] = library
    files |= accompanying_files(kernel, interface, fmi)
    files |= {f"sources/{name}": text.encode() for name, text in sorted(texts.items())}
    write_atomically(path, pack(files))
    remember(path)
    return NativeFmu(path, able, tuple(name for name in wanted if name not in able))


def _alike(name: str, fmi: int, sources: dict[str, str]) -> str:
    """The object file of what is alike in all FMUs, in the user's cache."""
    given = [*_FLAGS, "-c", MAIN[fmi]]
    way = compiler_for(name), PLATFORMS[name], compilers.FLAGS, given, sources
    path = kernel_cache.entry(kernel_cache.COMPILED, hashed_name("alike", repr(way)) + ".o")
    kernel_cache.kept(path, lambda: compile_library(name, sources, given, "alike"))
    return str(path)


def _build_description(identifier: str) -> bytes:
    """How a tool compiles the sources; FMI 2.0 says it in the model description."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=MAIN[3])
    ET.SubElement(configuration, "Library", name="m", external="true")
    return xml_text(root)

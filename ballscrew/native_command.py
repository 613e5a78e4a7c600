"""``ballscrew export --native``: FMUs of compiled C, beside or instead of pythonfmu's."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .fmus.native.sources import NativeModel

VERSIONS = ("2", "3")


def add_options(add: Any) -> None:
    """Add the options to a parser, by its `add_argument`."""
    add(
        "--native",
        action="store_true",
        help="write FMUs of compiled C, for hosts without Python; with --variational, of those",
    )
    add("--fmi", metavar="2|3", help="with --native: version of FMI (default 2)")
    add(
        "--platforms",
        metavar="NAME,...",
        help="with --native: some of linux64,win64,darwin64 (default: this one)",
    )


def check(options: argparse.Namespace) -> None:
    """Refuse options that make no sense together, before any work is done."""
    from .cli import BadRequest
    from .fmus.native.compilers import PLATFORMS

    for option in ("fmi", "platforms"):
        if getattr(options, option) is not None and not options.native:
            raise BadRequest(f"--{option} makes no sense without --native")
    if options.native and options.ssp:
        raise BadRequest("--native and --ssp: expected one of them")
    if options.fmi is not None and options.fmi not in VERSIONS:
        raise BadRequest(f"--fmi is {options.fmi!r}, expected one of {', '.join(VERSIONS)}")
    for name in _platforms(options) or ():
        if name not in PLATFORMS:
            raise BadRequest(f"--platforms: no platform {name!r}; there are {', '.join(PLATFORMS)}")


def export(options: argparse.Namespace, names: Sequence[str], tangents: int) -> int:
    """Write the FMUs and print their paths; the exit code."""
    from .cli import BAD_REQUEST, TRUSTED, BadRequest, _write
    from .fmus.catalogue import loop, loop_fmu_kernel
    from .fmus.native.compilers import CompilerFailed
    from .fmus.native.export import NativeFmu, write_native
    from .fmus.native.sources import catalogued_model, stored_model, variational_model
    from .solver.codegen import UnsupportedComponent
    from .solver.component import ContractError

    written: list[NativeFmu] = []
    for name in names:
        kind = "_variational" if options.variational else "_loop" if options.loop else ""
        target: Path = options.out / f"{name}{kind}.fmu"
        try:
            if options.variational:
                model = variational_model(name, tangents)
            elif options.loop:
                kernel = loop_fmu_kernel(name)
                model = stored_model(f"loop_{name}", kernel, partial(loop, name))
            else:
                model = catalogued_model(name)

            def make(model: NativeModel = model, target: Path = target) -> None:
                version = int(options.fmi or 2)
                written.append(write_native(model, target, version, _platforms(options)))

            _write(make)
        except (ContractError, UnsupportedComponent) as error:
            if options.only or options.loop:
                raise BadRequest(str(error)) from error
            print(f"left out: {error}", file=sys.stderr)
            continue
        except CompilerFailed as error:
            print(f"ballscrew: {error}", file=sys.stderr)
            return BAD_REQUEST
        print(target)
        if written[-1].note:
            print(f"note: {written[-1].note}", file=sys.stderr)
    return TRUSTED


def _platforms(options: argparse.Namespace) -> list[str] | None:
    return None if options.platforms is None else options.platforms.split(",")

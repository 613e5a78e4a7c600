"""``ballscrew export --native``: FMUs of compiled C, beside or instead of pythonfmu's."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from .console import tell_export
from .options import BAD_REQUEST, TRUSTED, BadRequest
from .params_option import apart, kernel_with_values, plant_of
from .results_folder import write_or_refuse

if TYPE_CHECKING:
    from .fmus.native.sources import NativeModel
    from .orchestration.parameter_file import ParameterFile
    from .solver.kernel import Kernel

VERSIONS = ("2", "3")


def add_options(add: Any) -> None:
    """Add the options to a parser, by its `add_argument`."""
    add(
        "--native",
        action="store_true",
        help="write FMUs of compiled C, for hosts without Python; with --variational, --loop or "
        "--ssp, of those",
    )
    add("--fmi", metavar="2|3", help="with --native: version of FMI (default 2)")
    add(
        "--platforms",
        metavar="NAME,...",
        help="with --native: some of linux64,win64,darwin64 (default: this one)",
    )


def check(options: argparse.Namespace) -> None:
    """Refuse options that make no sense together, before any work is done."""
    from .solver.compilers import PLATFORMS

    for option in ("fmi", "platforms"):
        if getattr(options, option) is not None and not options.native:
            raise BadRequest(f"--{option} makes no sense without --native")
    if options.fmi is not None and options.fmi not in VERSIONS:
        raise BadRequest(f"--fmi is {options.fmi!r}, expected one of {', '.join(VERSIONS)}")
    if options.ssp and options.fmi == "3":
        raise BadRequest("--fmi 3 and --ssp: a system of SSP 1.0 holds FMUs of FMI 2.0")
    for name in _platforms(options) or ():
        if name not in PLATFORMS:
            raise BadRequest(f"--platforms: no platform {name!r}; there are {', '.join(PLATFORMS)}")


def export(
    options: argparse.Namespace, names: Sequence[str], tangents: int, told: ParameterFile | None
) -> int:
    """Write the FMUs, with the start values of a parameter file, and print their paths."""
    from .fmus.catalogue import loop, loop_fmu_kernel, name_of
    from .fmus.native.export import NativeFmu, write_native
    from .fmus.native.sources import catalogued_model, stored_model, variational_model, with_kernel
    from .fmus.units import BadUnit
    from .solver.compilers import CompilerFailed
    from .solver.contract_error import ContractError
    from .solver.tape import UnsupportedComponent

    written: list[NativeFmu] = []
    plant = plant_of(options, told) if options.loop else ""
    for name in names:
        tell_export(names, name)
        kind = "_variational" if options.variational else "_loop" if options.loop else ""
        target: Path = options.out / f"{name_of(name)}{kind}.fmu"
        try:
            if options.variational:
                model = variational_model(name, tangents)
            elif options.loop:
                kernel = loop_fmu_kernel(name, plant)
                model = stored_model(kernel.name, kernel, partial(loop, name, plant))
            else:
                model = catalogued_model(name)
            kernel = kernel_with_values(told, name, model.kernel, plant)
            model = with_kernel(model, kernel)

            def make(model: NativeModel = model, target: Path = target) -> None:
                version = int(options.fmi or 2)
                written.append(write_native(model, target, version, _platforms(options)))

            write_or_refuse(make)
            if not options.variational:
                add_reference(model.kernel, target)
        except (ContractError, UnsupportedComponent, BadUnit) as error:
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


def add_reference(kernel: Kernel, fmu: Path) -> None:
    """Write the reference files beside an FMU, or say why there are none."""
    from .fmus.reference_files import reference_files, write_reference_files
    from .solver.kernel import IntegrationError

    try:
        files = reference_files(kernel)
    except (ArithmeticError, IntegrationError, ValueError) as error:
        print(f"note: {fmu}: no reference solution beside it: {error}", file=sys.stderr)
        return
    write_or_refuse(partial(write_reference_files, files, fmu))


def export_systems(
    options: argparse.Namespace, names: Sequence[str], told: ParameterFile | None
) -> int:
    """Write one .ssp per closed loop, with the values of a parameter file, and print its path."""
    from .fmus.catalogue import name_of
    from .fmus.native.export import NativeFmu, write_native
    from .fmus.native.sources import catalogued_model, with_kernel
    from .fmus.start_values import with_set_point
    from .fmus.system_export import CannotConnect, export_system
    from .fmus.units import BadUnit
    from .solver.compilers import CompilerFailed
    from .solver.contract_error import ContractError
    from .solver.tape import UnsupportedComponent

    with TemporaryDirectory(prefix="ballscrew-export-") as folder:

        def write(name: str, side: str) -> NativeFmu:
            model = catalogued_model(name)
            model = with_kernel(model, kernel_with_values(told, name, with_set_point(model.kernel)))
            path = Path(folder) / side / f"{name_of(name)}.fmu"
            return write_native(model, path, 2, _platforms(options))

        try:
            plant = write(plant_of(options, told), "plant")
            for name in names:
                label = name_of(name)
                target = options.out / f"{label}.ssp"
                base, instruments = apart(told, name)
                controller = write(base, "controller")
                between = {n: write(n, "between").path for n in instruments}
                sides = plant.path, controller.path, target
                write_or_refuse(partial(export_system, *sides, name=label, instruments=between))
                print(target)
                if controller.note:
                    print(f"note: {replace(controller, path=target).note}", file=sys.stderr)
        except (ContractError, UnsupportedComponent, BadUnit, CannotConnect) as error:
            raise BadRequest(str(error)) from error
        except CompilerFailed as error:
            print(f"ballscrew: {error}", file=sys.stderr)
            return BAD_REQUEST
    return TRUSTED


def _platforms(options: argparse.Namespace) -> list[str] | None:
    return None if options.platforms is None else options.platforms.split(",")

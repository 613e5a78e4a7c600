"""Parts, loops and systems as files, for `ballscrew.export` and the command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .params_option import apart, kernel_with_values

if TYPE_CHECKING:
    from .fmus.native.export import NativeFmu
    from .orchestration.loop.parameter_file import ParameterFile

SYSTEM, MODELICA = ".ssp", ".mo"


@dataclass(frozen=True)
class Export:
    """How files are made; the attributes are the parameters of `ballscrew.export`."""

    plant: str = ""
    tangents: int = 0
    params: ParameterFile | None = None
    native: bool = False
    fmi: int = 2
    platforms: Sequence[str] | None = None

    def write(self, part: str, path: Path, folder: Path) -> NativeFmu:
        """Write a part, its loop or, with the suffix `SYSTEM`, a system; one plant per folder.

        For a system, this is the progress of its controller's FMU.
        """
        from .orchestration.loop.catalogue import in_units_of, name_of
        from .plant.instruments import PartName

        described = self.plant or self._described()
        part = in_units_of(part, described)
        if part == PartName.of(described).plain:
            part = described
        if path.suffix == MODELICA:
            return self._write_modelica(part, path)
        if path.suffix != SYSTEM:
            return self._write_fmu(part, path)
        from .fmus.system_export import export_system

        def element(name: str, side: str) -> Path:
            # under the part's own name, which error messages show
            return folder / side / f"{name_of(name)}.fmu"

        base, instruments = apart(self.params, part)
        plant = element(self.plant, "plant")
        alone = replace(self, plant="")
        if not plant.exists():
            alone._write_fmu(self.plant, plant, in_system=True)
        made = alone._write_fmu(base, element(base, "controller"), in_system=True)
        between = {n: element(n, "between") for n in instruments}
        for name, place in between.items():
            alone._write_fmu(name, place, in_system=True)
        export_system(plant, made.path, path, name=name_of(part), instruments=between)
        return replace(made, path=path)

    def _write_modelica(self, part: str, path: Path) -> NativeFmu:
        from .fmus.interface import START
        from .fmus.modelica import modelica
        from .fmus.native.export import NativeFmu
        from .orchestration.loop import catalogue
        from .solver.files import write_atomically

        kernel = catalogue.fmu_kernel(part, self.plant)
        kernel = kernel_with_values(self.params, part, kernel, self.plant)
        starts = {p.name: p.default for p in kernel.parameters}
        starts |= {s.name + START: s.start for s in kernel.states}
        whole = catalogue.loop(part, self.plant) if self.plant else catalogue.component(part)
        write_atomically(path, modelica(whole, starts).encode())
        return NativeFmu(path, (), ())

    def _described(self) -> str:
        """The plant of the parameter file, in its own units; empty if there is none."""
        return self.params.plant_name if self.params and self.params.command else ""

    def _write_fmu(self, part: str, path: Path, in_system: bool = False) -> NativeFmu:
        from .fmus.carried_runtime import platforms_with_core
        from .fmus.interface import with_set_point
        from .fmus.native.export import NativeFmu, write_native
        from .fmus.native.sources import NativeModel
        from .orchestration.loop import catalogue
        from .solver.files import write_atomically

        asked = part, self.plant, self.tangents
        model = catalogue.catalogued_model(*asked) if self.native else None
        kernel = model.kernel if model else catalogue.fmu_kernel(*asked)
        kernel = with_set_point(kernel) if in_system else kernel
        kernel = kernel_with_values(self.params, part, kernel, self.plant)
        if model:
            model = NativeModel(kernel, model.partials)
            return write_native(model, path, self.fmi, self.platforms)
        write_atomically(path, catalogue.stored_fmu(kernel, everywhere=True).read_bytes())
        return NativeFmu(path, *platforms_with_core())

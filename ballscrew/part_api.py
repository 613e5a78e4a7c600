"""The public functions for parts: those that there are, new ones, and parts as files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .api import check_whole_number
from .console import print_notes
from .solver.errors import UserError

if TYPE_CHECKING:
    import sympy as sp

    from .fmus.native.export import NativeFmu
    from .orchestration.loop.parameter_file import ParameterFile, Value
    from .orchestration.loop.parts import PartLike
    from .solver.component import Component, ForceTerm
    from .solver.kernel import Kernel

    Values = Mapping[str, float]

SYSTEM, MODELICA = ".ssp", ".mo"


def catalogue() -> dict[str, tuple[str, ...]]:
    """Names of the available parts.

    Returns
    -------
    dict of str to tuple of str
        ``plants``, ``controllers``, ``instruments`` and ``laws`` (of friction).

    Examples
    --------
    >>> import ballscrew
    >>> "nctf" in ballscrew.catalogue()["controllers"]
    True
    """
    from .controllers import CONTROLLERS
    from .plant import LAWS, PLANTS
    from .plant.instruments import INSTRUMENTS

    named = {"plants": PLANTS, "controllers": CONTROLLERS, "instruments": INSTRUMENTS, "laws": LAWS}
    return {kind: (*names,) for kind, names in named.items()}


def component(name: str) -> Component:
    """Return a component of the catalogue or of a Python file, with its equations.

    A name that does not exist is a KeyError, too, which lists the available ones.

    Parameters
    ----------
    name : str
        A plant, a controller or an instrument of `catalogue`, ``controller+instrument+...``, or
        ``path/to/file.py:function``. The file is run as it is now, the function without arguments.

    Examples
    --------
    >>> import ballscrew
    >>> [s.name for s in ballscrew.component("plant").all_states]
    ['x', 'v', 'i', 'z']
    """
    from .orchestration.loop.catalogue import component as made

    return made(read_again(name))


def read_again(part: str) -> str:
    """The same part; a Python file is read as it is now."""
    from .plant.instruments import PartName
    from .solver.component_file import names_file, read_component

    if names_file(name := PartName.of(part).bare):
        read_component(name)
    return part


def with_friction(
    body: Component,
    law: str | ForceTerm,
    values: Values | None = None,
    velocity: str = "v",
    position: str = "x",
    breakaway: sp.Expr | None = None,
) -> Component:
    """A body with a friction law in its force balance.

    Parameters
    ----------
    body : Component
        Has a `ForceBalance` of `velocity`, and no modes.
    law : str or ForceTerm
        A law of `catalogue`, or your own dry friction: a term called ``friction``
        that opposes sliding by ``sign(v)``. With ``classical`` and with your own term, sticking
        and sliding are modes.
    values : mapping of str to float, optional
        Default values of the law's parameters, in SI units.
    velocity : str
        The state that is the sliding velocity of the body [m/s]. If its unit
        is rad/s, a law of the catalogue is in N*m and rad.
    position : str
        The position state; while the body sticks, its derivative is the one at zero `velocity`.
    breakaway : expression, optional
        Force up to which the body sticks [N], for laws with modes; default: the sliding friction
        at zero velocity.

    Returns
    -------
    Component
        Its output ``friction`` [N] opposes motion.

    Examples
    --------
    >>> from ballscrew import Component, ForceBalance, ForceTerm, State, symbol, with_friction
    >>> x, v = symbol("x"), symbol("v")
    >>> spring = ForceTerm("spring", -100 * x, "a spring of 100 N/m")
    >>> states = State("x", "m", "position", v, start=0.1), State("v", "m/s", "velocity")
    >>> balance = ForceBalance("v", 1, (spring,))
    >>> body = Component("body", "A mass", states=states, balances=(balance,))
    >>> [mode.name for mode in with_friction(body, "classical", {"Fc": 2.0}).modes]
    ['stuck', 'forward', 'backward']
    """
    from .plant.with_friction import with_friction as made

    return made(body, law, values, velocity, position, breakaway)


def export(
    part: PartLike,
    path: Path | str,
    native: bool = False,
    fmi: int = 2,
    platforms: Sequence[str] | None = None,
    plant: PartLike | None = None,
    tangents: int = 0,
    params: ParameterFile | None = None,
) -> Path:
    """Write a part, or the closed loop of a controller, as an FMU or a system of FMUs.

    Parameters
    ----------
    part : str or Component
        A name, a file's function (``mine.py:pi``), or a component.
    path : path-like
        The file to write; replaced as a whole or not at all. A name that ends in ``.ssp`` gives
        a system: the controller `part` and its plant, connected; ``.mo`` gives Modelica source.
    native : bool
        Whether it contains compiled C, and needs no Python on the host, in place of Python.
    fmi : {2, 3}
        Version of the FMI standard; 3 needs `native`.
    platforms : sequence of str, optional
        With `native`: such as ``linux64``, ``win64``, ``darwin64``; default: this machine's.
    plant : str or Component, optional
        For an FMU: the FMU contains the whole closed loop of this plant and the controller `part`.
        For a system: the plant instead of the one in `params` or the default one.
    tangents : int
        How many tangent vectors the FMU carries, for exponents over FMUs.
    params : ParameterFile, optional
        Its values become the start values.

    Returns
    -------
    Path
        `path`.

    Examples
    --------
    >>> import ballscrew, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ballscrew.export("pid", Path(folder) / "pid.fmu").name
    'pid.fmu'
    """
    from .orchestration.loop.loop import plant_of
    from .orchestration.loop.parts import resolve
    from .solver.files import temporary_folder

    path = Path(path)
    name = read_again(part) if isinstance(part, str) else resolve("part", part).name
    around = None if plant is None else resolve("plant", plant, fmus=False).name
    if path.suffix == SYSTEM:
        around = plant_of(params, around)
    how = Export(around or "", tangents, params, native, fmi, platforms)
    with temporary_folder("export") as folder:
        how.write(name, path, Path(folder))
    return path


@dataclass(frozen=True)
class Export:
    """How files are made: the arguments of `export`; empty text and 0 stand for none."""

    plant: str = ""
    tangents: int = 0
    params: ParameterFile | None = None
    native: bool = False
    fmi: int = 2
    platforms: Sequence[str] | None = None

    def __post_init__(self) -> None:
        from .solver.compilers import platforms_of

        object.__setattr__(self, "fmi", check_whole_number("fmi", self.fmi, 2, 3))
        check_whole_number("tangents", self.tangents, 0, 12)
        if self.tangents and self.plant:
            raise UserError(f"tangents is {self.tangents}, for a loop; expected a single part")
        if not self.native and (self.fmi != 2 or self.platforms is not None):
            raise UserError("fmi and platforms are for native FMUs; ask for native as well")
        known = platforms_of(self.fmi)
        for name in self.platforms or ():
            if name not in known:
                there = f"there are {', '.join(known)} with fmi {self.fmi}"
                raise UserError(f"platforms: no platform {name!r}; {there}")

    def write(self, part: str, path: Path, folder: Path) -> NativeFmu:
        """Write a part, its loop or, by the suffix, a system, whose FMUs are in `folder`."""
        from .controllers import in_units_of
        from .plant.instruments import PartName

        plant = self.plant or (
            self.params.plant_name if self.params and self.params.command else ""
        )
        part = in_units_of(part, plant)
        if part == PartName.of(plant).plain:
            part = plant
        if path.suffix == SYSTEM:
            return self._write_system(part, path, folder)
        return (
            self._write_modelica(part, path)
            if path.suffix == MODELICA
            else self._write_fmu(part, path)
        )

    def _write_system(self, part: str, path: Path, folder: Path) -> NativeFmu:
        """Its FMUs have the parts' own names, which messages show; one plant per folder."""
        from .fmus.system_export import export_system
        from .orchestration.loop.catalogue import name_of

        alone = replace(self, plant="")

        def element(name: str, side: str) -> NativeFmu:
            place = folder / side / f"{name_of(name)}.fmu"
            return alone._write_fmu(name, place, in_system=True)

        base, instruments = self._apart(part)
        plant = folder / "plant" / f"{name_of(self.plant)}.fmu"
        if not plant.exists():
            element(self.plant, "plant")
        made = element(base, "controller")
        between = {n: element(n, "between").path for n in instruments}
        export_system(plant, made.path, path, name=name_of(part), instruments=between)
        return replace(made, path=path)

    def _apart(self, name: str) -> tuple[str, tuple[str, ...]]:
        """A controller and its instruments as in an .ssp, each with its own values."""
        from .orchestration.loop.parts import Part
        from .plant.instruments import PartName

        named, label = PartName.of(name), Part(name).label
        if self.params and named.instruments and label in self.params.controllers:
            raise UserError(
                f"{self.params.path}: [controller.{label}] is for one part, but in an .ssp its "
                "instruments are separate parts; export without --params, and run with --set "
                "ELEMENT.VARIABLE=VALUE"
            )
        base = replace(named, instruments=())
        return str(base), tuple(str(PartName(i, units=named.units)) for i in named.instruments)

    def _write_modelica(self, part: str, path: Path) -> NativeFmu:
        from .fmus.interface import START
        from .fmus.modelica import modelica
        from .fmus.native.export import NativeFmu
        from .orchestration.loop import catalogue
        from .solver.files import write_atomically

        kernel = self._with_values(part, catalogue.fmu_kernel(part, self.plant))
        starts = {p.name: p.default for p in kernel.parameters}
        starts |= {s.name + START: s.start for s in kernel.states}
        whole = catalogue.loop(part, self.plant) if self.plant else catalogue.component(part)
        write_atomically(path, modelica(whole, starts).encode())
        return NativeFmu(path, (), ())

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
        kernel = self._with_values(part, with_set_point(kernel) if in_system else kernel)
        if model:
            model = NativeModel(kernel, model.partials)
            return write_native(model, path, self.fmi, self.platforms)
        write_atomically(path, catalogue.stored_fmu(kernel, everywhere=True).read_bytes())
        return NativeFmu(path, *platforms_with_core())

    def _with_values(self, name: str, kernel: Kernel) -> Kernel:
        """The kernel of a part, or of its loop around the plant, with the file's start values."""
        file, plant = self.params, self.plant
        if file is None:
            return kernel
        from .fmus.interface import with_start_values
        from .orchestration.loop.loop import aside, for_controller, for_plant, table_of
        from .orchestration.loop.parts import Part
        from .solver.kernel import CONTROLLER, PLANT

        values: dict[str, float] = {}
        sources: dict[str, str] = {}

        def add(side: str, given: Values, said: Mapping[str, Value]) -> None:
            for n, value in given.items():
                own = f"{side if plant else ''}{n}"
                values[own] = value
                sources[own] = (said[n].source if n in said else "") or f"from {file.path}"

        moves = plant or (name if _is_plant(name) else "")
        if moves:
            add(PLANT, own := for_plant(file, moves), {**file.plant, **file.found})
            print_notes(aside(file, own, moves))
        if plant or not moves:
            said = file.controllers.get(table_of(file, Part(name)), {})
            add(CONTROLLER, for_controller(file, name), said)
        return with_start_values(kernel, values, sources)


def _is_plant(part: str) -> bool:
    """Whether a part is on the plant's side: it has no measurement or set-point."""
    from .orchestration.loop.catalogue import component
    from .plant import PLANTS
    from .plant.instruments import PartName
    from .solver.component_file import names_file

    bare = PartName.of(part).bare
    if not names_file(bare):
        return bare in PLANTS
    return not any(i.role in ("measurement", "reference") for i in component(part).inputs)

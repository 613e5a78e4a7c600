"""The two FMUs of a loop, by name or by file, with the required number of tangents."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ..fmus.catalogue import fmu_kernel
from ..fmus.native.ready import ready_fmu
from ..fmus.reading import FmuError
from ..fmus.tangent_ports import is_tangent_port, tangent_states
from ..orchestration.fmu_instance import FmuInstance
from ..orchestration.isolated import IsolatedInstance, open_fmu
from ..orchestration.loop import Loop
from ..orchestration.parts import Part
from ..orchestration.state_trial import check_state
from ..orchestration.wiring import PLANT, names_on
from ..solver.tape import UnsupportedComponent
from .fmu_with_tangents import ordinary
from .tangents_over_fmus import TangentRun, follow_over_fmus

_Instance = FmuInstance | IsolatedInstance
TRIAL = 1.0, 1e-3  # s: stop time and step of the trial of saved states
ALL = -1  # tangents: as many as the states of both parts together


@dataclass(frozen=True)
class OverFmus:
    """Additional data of a map over FMUs.

    Attributes
    ----------
    tangents : int
        Number of tangents: 1, or 0 if a part has none and no exponent is requested.
    digests : dict of str to str
        SHA-256 of the file of each side.
    """

    tangents: int
    digests: Mapping[str, str]


@dataclass(frozen=True)
class FmuParts:
    """Both FMUs of a loop, opened and not initialized.

    Attributes
    ----------
    plant, controller : FmuInstance or IsolatedInstance
    builds : tuple of str
        Of plant and controller: ``native`` or ``readable``; of a file ``third-party``.
    """

    plant: _Instance
    controller: _Instance
    builds: tuple[str, str]

    @contextlib.contextmanager
    def fresh(self) -> Iterator[tuple[_Instance, _Instance]]:
        """New instances of both, independent of earlier ones."""
        with contextlib.ExitStack() as opened:
            plant = self.plant.reopened()
            opened.callback(plant.close)
            controller = self.controller.reopened()
            opened.callback(controller.close)
            yield plant, controller

    def follow(
        self, loop: Loop, step: float, accuracy: float, count: int | None = None
    ) -> TangentRun:
        """A run of new instances with tangents; arguments and errors as `follow_over_fmus`."""
        with self.fresh() as (plant, controller):
            return follow_over_fmus(
                plant,
                controller,
                loop.set_point,
                loop.stop,
                step,
                plant_values=loop.plant_values,
                controller_values=loop.controller_values,
                mapping=loop.mapping,
                accuracy=accuracy,
                count=count,
            )

    def nominal(self, mapping: Mapping[str, str]) -> dict[str, float]:
        """Nominal values of the plant's outputs except tangents, by their names in results."""
        names = ordinary(self.plant).outputs
        ours = names_on(PLANT, names, mapping)
        return {ours[n]: self.plant.nominal(n) for n in names}

    def said(self) -> str:
        """A description of both FMUs, for results."""
        first, second = self.builds
        if first == second:
            return f"{first} variational FMUs"
        return f"plant: {first} FMU, controller: {second} FMU"


@contextlib.contextmanager
def opened_parts(loop: Loop, tangents: int) -> Iterator[FmuParts]:
    """Open the FMUs of a loop; native ones for names, if there is a compiler.

    Parameters
    ----------
    loop : Loop
        An FMU of it that was not written here runs in its own process.
    tangents : int
        Number of tangents of parts by name: `ALL`, or 0 for ordinary FMUs.

    Raises
    ------
    FmuError, UnsupportedComponent
        Also for a controller that is sampled by its master: it has no tangents here.
    """
    if loop.sampled:
        raise FmuError(f"{loop.controller}: exponents and maps cannot sample an FMU")
    with contextlib.ExitStack() as opened:

        def opened_file(side: str, part: Part) -> _Instance | None:
            if part.has_equations:
                return None
            instance = open_fmu(part.fmu(), side)
            opened.callback(instance.close)
            check_state(instance, {}, *TRIAL)
            return instance

        def opened_name(side: str, part: Part) -> tuple[_Instance, str]:
            ready = ready_fmu(part.name, wanted)
            instance = FmuInstance(ready.path, side)
            opened.callback(instance.close)
            return instance, ready.build

        both = loop.plant, loop.controller
        files = [opened_file("plant", loop.plant), opened_file("controller", loop.controller)]
        wanted = tangents
        if tangents == ALL:
            wanted = sum(map(_states, files, both))
        sides = zip(("plant", "controller"), both, files, strict=True)
        (p, first), (c, second) = (
            (file, "third-party") if file else opened_name(side, part) for side, part, file in sides
        )
        yield FmuParts(p, c, (first, second))


def _states(file: _Instance | None, part: Part) -> int:
    """Number of states of a part that tangents can have; 1 for a probed controller."""
    if file is None:
        return len(part.kernel.states)
    return len(tangent_states(list(file.parameters))[0]) or 1


def _has_tangents(part: Part) -> bool:
    """Whether a part comes with tangents, by name or by file."""
    if not part.has_equations:
        ports = {*part.inputs, *part.outputs}
        return any(is_tangent_port(port, ports) for port in ports)
    try:
        fmu_kernel(part.name, tangents=1)
    except UnsupportedComponent:
        return False
    return True


def over_fmus(loop: Loop, exponents: bool) -> OverFmus:
    """A map's `OverFmus`, with the digests of the present FMUs.

    Raises
    ------
    UnsupportedComponent
        If exponents are requested, and a part of the catalogue has no tangents.
    FmuError, OSError
    """
    parts = {"plant": loop.plant, "controller": loop.controller}
    tangents = int(exponents or all(map(_has_tangents, parts.values())))

    def digest(part: Part) -> str:
        path = ready_fmu(part.name, tangents).path if part.has_equations else part.fmu()
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    return OverFmus(tangents, {side: digest(part) for side, part in parts.items()})

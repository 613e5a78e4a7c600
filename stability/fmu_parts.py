"""The two FMUs of a loop, by name or by file, opened with as many tangents as are followed."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..fmus.catalogue import fmu_kernel, has_equations, variational_kernel
from ..fmus.native.ready import ready_fmu
from ..fmus.tangent_ports import is_tangent_port, tangent_states
from ..orchestration.fmu_instance import FmuInstance
from ..orchestration.isolated import IsolatedInstance, open_fmu
from ..orchestration.parts import part_of
from ..orchestration.state_trial import check_state
from ..orchestration.wiring import PLANT, names_on
from ..solver.tape import UnsupportedComponent
from .fmu_with_tangents import ordinary
from .tangents_over_fmus import TangentRun, follow_over_fmus

_Instance = FmuInstance | IsolatedInstance
TRIAL = 1.0, 1e-3  # s: stop time and step, by which saved states are tried
ALL = -1  # tangents: as many as both parts have states together


@dataclass(frozen=True)
class FmuLoop:
    """A closed loop of two FMUs around a constant set-point.

    Attributes
    ----------
    controller, plant : str
        As `Part.name`.
    setpoint : float
        [m]
    plant_values, controller_values : mapping of str to float
        Parameters and initial states that are not nominal.
    mapping : mapping of str to str
        Names of ports, ``theirs -> ours``.
    """

    controller: str
    plant: str = "plant"
    setpoint: float = 0.08
    plant_values: Mapping[str, float] = field(default_factory=dict)
    controller_values: Mapping[str, float] = field(default_factory=dict)
    mapping: Mapping[str, str] = field(default_factory=dict)

    def followed(
        self, parts: FmuParts, stop: float, step: float, accuracy: float, count: int | None = None
    ) -> TangentRun:
        """A run of new instances with tangents; arguments and errors as `follow_over_fmus`."""
        with parts.fresh() as (plant, controller):
            return follow_over_fmus(
                plant,
                controller,
                self.setpoint,
                stop,
                step,
                plant_values=self.plant_values,
                controller_values=self.controller_values,
                mapping=self.mapping,
                accuracy=accuracy,
                count=count,
            )

    def nominal(self, parts: FmuParts) -> dict[str, float]:
        """Nominal values of the plant's outputs but tangents, by the names that results have."""
        names = ordinary(parts.plant).outputs
        ours = names_on(PLANT, names, self.mapping)
        return {ours[n]: parts.plant.nominal(n) for n in names}


@dataclass(frozen=True)
class OverFmus:
    """What a map over FMUs has beside one over the equations.

    Attributes
    ----------
    step : float
        Communication step [s].
    tangents : int
        How many are followed: one, or none where a part has none and no exponent is asked for.
    mapping : dict of str to str
        Names of ports, ``theirs -> ours``.
    digests : dict of str to str
        SHA-256 of the file of each side.
    """

    step: float
    tangents: int
    mapping: Mapping[str, str]
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
        """New instances of both: nothing of what was done with others is left in them."""
        with contextlib.ExitStack() as opened:
            plant = self.plant.reopened()
            opened.callback(plant.close)
            controller = self.controller.reopened()
            opened.callback(controller.close)
            yield plant, controller

    def said(self) -> str:
        """What they are, for results."""
        first, second = self.builds
        if first == second:
            return f"{first} variational FMUs"
        return f"plant: {first} FMU, controller: {second} FMU"


@contextlib.contextmanager
def opened_parts(plant: str, controller: str, tangents: int) -> Iterator[FmuParts]:
    """Open the FMUs of a loop; native ones for names, where there is a compiler.

    Parameters
    ----------
    plant, controller : str
        As `Part.name`; an FMU that was not written here runs in a process of its own.
    tangents : int
        How many those by name carry: `ALL`, or 0 for ordinary FMUs.

    Raises
    ------
    FmuError, UnsupportedComponent
    """
    with contextlib.ExitStack() as opened:

        def opened_file(side: str, name: str) -> _Instance | None:
            if has_equations(name):
                return None
            instance = open_fmu(Path(name), side)
            opened.callback(instance.close)
            check_state(instance, {}, *TRIAL)
            return instance

        def opened_name(side: str, name: str) -> tuple[_Instance, str]:
            ready = ready_fmu(name, wanted)
            instance = FmuInstance(ready.path, side)
            opened.callback(instance.close)
            return instance, ready.build

        files = [opened_file("plant", plant), opened_file("controller", controller)]
        wanted = tangents
        if tangents == ALL:
            wanted = sum(map(_states, files, (plant, controller)))
        sides = zip(("plant", "controller"), (plant, controller), files, strict=True)
        (p, first), (c, second) = (
            (file, "third-party") if file else opened_name(side, name) for side, name, file in sides
        )
        yield FmuParts(p, c, (first, second))


def _states(file: _Instance | None, name: str) -> int:
    """How many states of a part tangents may have; of one that is probed, one."""
    if file is None:
        return len(fmu_kernel(name).states)
    return len(tangent_states(list(file.parameters))[0]) or 1


def _has_tangents(name: str) -> bool:
    """Whether a part comes with tangents, by name or by file."""
    if not has_equations(name):
        part = part_of(name)
        ports = {*part.inputs, *part.outputs}
        return any(is_tangent_port(port, ports) for port in ports)
    try:
        variational_kernel(name, 1)
    except UnsupportedComponent:
        return False
    return True


def over_fmus(
    plant: str, controller: str, step: float, mapping: Mapping[str, str], exponents: bool
) -> OverFmus:
    """A map's `OverFmus`, with the digests of the FMUs as they are now.

    Raises
    ------
    UnsupportedComponent
        If exponents are asked for, and there are no tangents of a part by name.
    FmuError, OSError
    """
    tangents = int(exponents or (_has_tangents(plant) and _has_tangents(controller)))

    def digest(name: str) -> str:
        path = ready_fmu(name, tangents).path if has_equations(name) else Path(name)
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    digests = {"plant": digest(plant), "controller": digest(controller)}
    return OverFmus(step, tangents, dict(mapping), digests)

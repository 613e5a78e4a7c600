"""The two FMUs of a loop, by name or by file, with the required number of tangents."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ..fmus.ports import tangent_states
from ..orchestration.fmu.fmu_instance import FmuInstance
from ..orchestration.fmu.isolated import IsolatedInstance, open_fmu
from ..orchestration.fmu.state_trial import check_state
from ..orchestration.fmu.wiring import PLANT, names_on, with_aliases
from ..orchestration.loop.catalogue import ready_fmu
from ..orchestration.loop.loop import Loop
from ..orchestration.loop.parts import Part
from ..solver.errors import FmuError
from .fmu_with_tangents import ordinary
from .tangents_over_fmus import TangentRun, follow_over_fmus

_Instance = FmuInstance | IsolatedInstance
TRIAL = 1.0, 1e-3  # s: stop time and step of the trial of saved states


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

    def follow(self, loop: Loop, step: float, accuracy: float) -> TangentRun:
        """A run of new instances with tangents; arguments and errors as `follow_over_fmus`."""
        with contextlib.ExitStack() as opened:
            plant, controller = self.plant.reopened(), self.controller.reopened()
            opened.callback(plant.close)
            opened.callback(controller.close)
            return follow_over_fmus(
                plant,
                controller,
                loop.set_point,
                loop.stop,
                step,
                plant_values=loop.plant_values,
                controller_values=loop.controller_values,
                mapping=with_aliases(plant, controller, loop.mapping),
                accuracy=accuracy,
            )

    def nominal(self, mapping: Mapping[str, str]) -> dict[str, float]:
        """Nominal values of the plant's outputs except tangents, by their names in results."""
        names = ordinary(self.plant).outputs
        ours = names_on(PLANT, names, with_aliases(self.plant, self.controller, mapping))
        return {ours[n]: self.plant.nominal(n) for n in names}

    def said(self) -> str:
        """A description of both FMUs, for results."""
        first, second = self.builds
        if first == second:
            return f"{first} variational FMUs"
        return f"plant: {first} FMU, controller: {second} FMU"


@contextlib.contextmanager
def opened_parts(loop: Loop) -> Iterator[FmuParts]:
    """Open the FMUs of a loop with a tangent for each state of both parts.

    Names become native FMUs if there is a compiler.

    Parameters
    ----------
    loop : Loop
        An FMU of it that was not written here runs in its own process.

    Raises
    ------
    FmuError, ContractError
        Also for a controller that is sampled by its master: it has no tangents here.
    """
    if loop.sampled:
        raise FmuError(f"{loop.controller}: exponents cannot sample an FMU")
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

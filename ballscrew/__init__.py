"""Friction, co-simulation and stability of a ball-screw axis."""

import os.path
from importlib import import_module
from typing import TYPE_CHECKING, Any

# When installed, the parts are inside this package. In a checkout they are next to it, and Python
# started there finds this folder first.
if not os.path.isdir(os.path.join(__path__[0], "solver")):
    __path__.append(os.path.dirname(__path__[0]))

# module: names; a name is imported when it is first asked for, since SymPy takes half a second
_NAMES = {
    "api": "run swap lyapunov stability_map",
    "study_api": "tune swap_study",
    "part_api": "catalogue component with_friction export",
    "measured_api": "run_trial read_force_records read_drive_records read_parameters identify "
    "diagnose compare",
    "solver.component": "Component Parameter Input Output State DiscreteState ForceTerm "
    "ForceBalance Event Mode Delay symbol TIME",
    "solver.errors": "UserError",
    "solver.interconnect": "connect interconnect",
    "orchestration.loop.loop": "Loop SystemLoop",
    "orchestration.master.couplings": "Coupling",
    "orchestration.master.reference_signal": "Reference",
}
_PUBLIC = {n: f"ballscrew.{module}" for module, names in _NAMES.items() for n in names.split()}
__all__ = sorted(_PUBLIC)

if TYPE_CHECKING:
    # Every name once more: a name that is not here is an error in a type checker of a user.
    __version__: str
    from .api import *  # noqa: F403
    from .measured_api import *  # noqa: F403
    from .orchestration.loop.loop import Loop as Loop
    from .orchestration.loop.loop import SystemLoop as SystemLoop
    from .orchestration.master.couplings import Coupling as Coupling
    from .orchestration.master.reference_signal import Reference as Reference
    from .part_api import *  # noqa: F403
    from .solver.component import *  # noqa: F403
    from .solver.errors import UserError as UserError
    from .solver.interconnect import connect as connect
    from .solver.interconnect import interconnect as interconnect
    from .study_api import *  # noqa: F403
else:

    def __getattr__(name: str) -> Any:
        if name == "__version__":  # written once, in pyproject.toml
            from importlib.metadata import version

            return version("ballscrew")
        if name in _PUBLIC:
            return getattr(import_module(_PUBLIC[name]), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

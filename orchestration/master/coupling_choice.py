"""Choice of the coupling of a run, with the reason."""

from __future__ import annotations

import numpy as np

from ...solver.errors import CouplingError
from ..fmu.fmu_instance import Instance
from ..fmu.wiring import Wiring
from .coupling import Answer, CoupledPair, Vector
from .couplings import Coupling
from .verdict import ACCURACY, scales


def choose_coupling(
    wiring: Wiring, plant: Instance, controller: Instance, wanted: Coupling | None
) -> tuple[Coupling, str]:
    """The requested coupling, else the best that both sides support; and the reason.

    Raises
    ------
    CouplingError
        If the request is impossible.
    """
    if wanted is Coupling.MONOLITHIC:
        raise CouplingError("the monolithic coupling runs no FMUs; see run_monolithic")
    if wanted and wanted.law and not wiring.accepts_law:
        name = wanted.value.replace("jacobian", "Jacobian")
        raise CouplingError(
            f"{name} coupling needs law ports on {plant.name} (u_gain_..., u_ref_..., u_rate) but "
            "it has none; use gauss-seidel"
        )
    if wiring.is_empty:
        return Coupling.JACOBI, f"{plant.name} runs alone; there is no coupling"
    if wanted is not None:
        return wanted, "as asked"
    if wiring.accepts_law:
        return Coupling.INTERFACE_JACOBIAN, "both sides allow it"
    return Coupling.GAUSS_SEIDEL, f"{plant.name} has no law ports"


def tangent_reason(loop: CoupledPair, wiring: Wiring) -> str:
    """Why the interface-Jacobian coupling was chosen, and the source of the derivatives."""
    if loop.answer is Answer.SAMPLED:
        return "the plant has law ports; the controller is sampled and holds its commands"
    if wiring.reports_law:
        return "the plant accepts the feedback law and the controller reports it"
    if loop.answer is Answer.DIRECT or loop.controller.can_save:
        return "the plant accepts the feedback law; the controller's derivatives are probed"
    return (
        "the plant has law ports, but the controller's derivatives are not available: its "
        "command is held"
    )


def late_start(loop: CoupledPair, commands: Vector, names: list[str]) -> str:
    """Advice if jacobi's first step holds a start value far from the first command.

    Parameters
    ----------
    loop : CoupledPair
    commands : ndarray, shape (k, m)
        True commands at the communication points.
    names : list of str
        Of the commands.
    """
    if loop.answer is not Answer.STEPPED or not names:
        return ""
    off = np.abs(commands[0] - loop.given) / scales(commands)
    worst = int(np.argmax(off))
    if not off[worst] > ACCURACY:
        return ""
    return (
        f"{names[worst]} starts at {loop.given[worst]:.4g} and is {commands[0, worst]:.4g} after "
        "the first step of the controller, which jacobi does not use: give it that "
        "start value, or use --coupling gauss-seidel"
    )

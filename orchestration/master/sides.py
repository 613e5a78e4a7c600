"""Both sides of a loop and how they are coupled; what is run is opened from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import CouplingError
from ..fmu.fmu_instance import Instance, Value
from ..fmu.group import initialize
from ..fmu.wiring import UNWIRED, Wiring, wire
from .coupling import Answer, CoupledPair
from .couplings import Coupling
from .reference_signal import Reference


@dataclass
class Sides:
    """A plant and a controller, what connects and drives them, and how they are coupled.

    Raises
    ------
    CouplingError
        If the parts cannot be coupled in this way.
    """

    plant: Instance  # not initialized yet
    controller: Instance
    reference: Reference  # for the controller's set-point, see `wire`
    stop: float  # [s]
    # default: tangent if the plant accepts a feedback law and derivatives of the controller are
    # available, else gauss-seidel
    coupling: Coupling | None = None
    # 0 or 1; default: 1 for interface-Jacobian coupling if both sides can save their states, else 0
    corrections: int | None = None
    adaptive: bool = False  # whether the steps are chosen by the residual's effect
    # of plant and controller: parameters, start values, and inputs that are not connected
    values: tuple[Mapping[str, Value], Mapping[str, Value]] = ({}, {})
    # names of ports, ``theirs -> ours``, see `wire`; with `wiring` it only names the results
    mapping: Mapping[str, str] = field(default_factory=dict)
    wiring: Wiring = UNWIRED  # default: ports of the same name, or as mapped

    def __post_init__(self) -> None:
        if self.wiring is UNWIRED:
            self.wiring = wire(self.plant, self.controller, self.mapping)
        self.start: Vector = self.reference.all_at(0.0, self.wiring.orders)
        missing = self._missing()
        self.reversible = not missing  # whether steps can be repeated
        self.scheme, self.reason = self._chosen()
        for wanted, what in ((self.corrections, "corrections"), (self.adaptive, "adaptive steps")):
            if wanted and missing:
                raise CouplingError(f"{what} need {missing}")
        by_default = self.scheme.law and self.reversible
        self.corrected = by_default if self.corrections is None else bool(self.corrections)

    def _missing(self) -> str:
        """What the loop lacks for repeating its steps; empty if nothing."""
        if not all(self.plant.is_real(theirs) for _, theirs in self.wiring.commands):
            return "real commands"
        can = self.plant.can_save and self.controller.can_save
        return "" if can else "both FMUs to save and restore their state"

    def _chosen(self) -> tuple[Coupling, str]:
        """The requested coupling, else the best that both sides support; and the reason."""
        wanted, accepts = self.coupling, self.wiring.accepts_law
        if wanted and wanted.law and not accepts:
            name = wanted.value.replace("jacobian", "Jacobian")
            raise CouplingError(
                f"{name} coupling needs law ports on {self.plant.name} (u_gain_..., u_ref_..., "
                "u_rate) but it has none; use gauss-seidel"
            )
        if self.wiring.is_empty:
            return Coupling.JACOBI, f"{self.plant.name} runs alone; there is no coupling"
        if wanted is not None:
            return wanted, "as asked"
        if accepts:
            return Coupling.INTERFACE_JACOBIAN, "both sides allow it"
        return Coupling.GAUSS_SEIDEL, f"{self.plant.name} has no law ports"

    def reason_of(self, main: CoupledPair) -> str:
        """Why this coupling was chosen, and the source of its derivatives."""
        if self.coupling is not None or not self.scheme.law:
            return self.reason
        if main.answer is Answer.SAMPLED:
            return "the plant has law ports; the controller is sampled and holds its commands"
        if self.wiring.reports_law:
            return "the plant accepts the feedback law and the controller reports it"
        if main.answer is Answer.DIRECT or main.controller.can_save:
            return "the plant accepts the feedback law; the controller's derivatives are probed"
        return (
            "the plant has law ports, but the controller's derivatives are not available: its "
            "command is held"
        )

    def opened(self, again: bool = True) -> tuple[Instance, Instance]:
        """Plant and controller, opened again or these themselves, and initialized together."""
        p, c = self.plant, self.controller
        if again:
            p, c = p.reopened(), c.reopened()
        initialize(p, c, self.wiring, self.values, self.stop, self.start)
        return p, c

    def main(self, again: bool = False) -> CoupledPair:
        """The loop as asked."""
        p, c = self.opened(again)
        averaged = self.scheme.law or self.corrected
        return CoupledPair(p, c, self.wiring, self.scheme, self.corrected, averaged, self.start)

    def again(
        self, corrected: bool, averaged: bool, parts: int = 1, scheme: Coupling | None = None
    ) -> CoupledPair:
        """Open the loop again at its start, to judge the run; each step in so many parts."""
        p, c = self.opened()
        # other outputs are judged in networks only
        wiring = self.wiring if self.wiring.network else replace(self.wiring, others=())
        scheme = scheme or self.scheme
        return CoupledPair(p, c, wiring, scheme, corrected, averaged, self.start, parts)

    def best(self) -> CoupledPair:
        """The loop, corrected if possible."""
        return self.again(self.reversible, self.scheme.law or self.reversible)

    def otherwise(self, main: CoupledPair) -> CoupledPair:
        """The loop that corrects its steps if the run does not, and vice versa."""
        return self.again(not main.corrected, not self.scheme.law)

    def times_commands(self, answer: Answer) -> bool:
        """Whether the exchange decides when a command arrives, and no correction mends it."""
        # the times of sampled commands are given; a law follows the signals within the step
        in_time = answer is Answer.SAMPLED or (self.scheme.law and answer is Answer.DIRECT)
        return not (in_time or self.reversible or self.wiring.is_empty)

    def a_step_off(self, answer: Answer) -> CoupledPair:
        """The loop whose commands arrive a step later or earlier than those of the run."""
        scheme = Coupling.GAUSS_SEIDEL if self.scheme.late else Coupling.JACOBI
        pair = self.again(False, False, scheme=scheme)
        if scheme.late and answer is Answer.STEPPED:
            pair.late[:] = np.nan  # the first command, as in the first step of the run
        return pair


def step_that_meets(period: float, step: float) -> float:
    """The longest step [s], at most `step`, of which the sampling period is a multiple."""
    return period / max(1, math.ceil(period / step - 1e-9)) if period > 0 else step

"""Both sides of a loop and how they are coupled; the run and its co-runs are opened from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ...solver.errors import CouplingError
from ..fmu.fmu_instance import Instance, Value
from ..fmu.group import Group, initialize
from ..fmu.wiring import UNWIRED, Wiring, wire
from .coupling import Answer, CoupledPair
from .couplings import Coupling
from .reference_signal import Reference

Vector = npt.NDArray[np.float64]
Reopen = Callable[[Instance], Instance]


def _reopened(part: Instance) -> Instance:
    return part.reopened()


def _turned(part: Instance) -> Instance:
    """Opened again; the steps of a group begin with the reverse order."""
    return part.reopened(True) if isinstance(part, Group) else part.reopened()


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

    def opened(self, reopen: Reopen = _reopened) -> tuple[Instance, Instance]:
        """Plant and controller, opened again by this function and initialized together."""
        p, c = reopen(self.plant), reopen(self.controller)
        initialize(p, c, self.wiring, self.values, self.stop, self.start)
        return p, c

    def main(self) -> CoupledPair:
        """The loop of the run: these instances themselves."""
        p, c = self.opened(lambda part: part)
        averaged = self.scheme.law or self.corrected
        return CoupledPair(p, c, self.wiring, self.scheme, self.corrected, averaged, self.start)

    def again(
        self,
        corrected: bool,
        averaged: bool,
        parts: int = 1,
        scheme: Coupling | None = None,
        reopen: Reopen = _reopened,
    ) -> CoupledPair:
        """Open the loop again at its start, to judge the run; each step in so many parts."""
        p, c = self.opened(reopen)
        # other outputs are judged in networks only
        wiring = self.wiring if self.wiring.network else replace(self.wiring, others=())
        scheme = scheme or self.scheme
        return CoupledPair(p, c, wiring, scheme, corrected, averaged, self.start, parts)

    def best(self, parts: int) -> CoupledPair:
        """The loop, corrected if possible, with each step in so many parts."""
        return self.again(self.reversible, self.scheme.law or self.reversible, parts)

    def co_runs(self, main: CoupledPair, curved: bool) -> list[CoupledPair]:
        """Open the co-runs: the other scheme, or shorter steps if no states can be saved.

        The other scheme has the same error as the run if the set-point is `curved` within the
        steps; then a co-run with half of the step is added. In a network, the other scheme also
        steps the parts in reverse order.
        """
        tangent = self.scheme.law
        if not self.reversible:
            return [self.again(False, tangent, parts) for parts in (2, 4)]
        reopen = _turned if self.wiring.network else _reopened
        other = self.again(not main.corrected, not tangent, reopen=reopen)
        if not curved:
            return [other]
        return [other, self.again(main.corrected, main.averaged, 2)]

    def late(self, main: CoupledPair) -> Callable[[], CoupledPair] | None:
        """Return a function that opens a loop with other command times; None if not useful."""
        # the times of sampled commands are given; a law follows the signals within the step
        in_time = main.answer is Answer.SAMPLED
        in_time |= self.scheme.law and main.answer is Answer.DIRECT
        if in_time or self.reversible:
            return None
        scheme = Coupling.GAUSS_SEIDEL if self.scheme.late else Coupling.JACOBI

        def opened() -> CoupledPair:
            pair = self.again(False, False, scheme=scheme)
            if scheme.late and main.answer is Answer.STEPPED:
                pair.begin_with_first_command()  # so does the first step of the run
            return pair

        return opened


def step_that_meets(period: float, step: float) -> float:
    """The longest step [s], at most `step`, of which the sampling period is a multiple."""
    return period / max(1, math.ceil(period / step - 1e-9)) if period > 0 else step

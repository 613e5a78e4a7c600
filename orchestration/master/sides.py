"""Both sides of a loop and how they are coupled; what is run is opened from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from ...solver.arrays import Vector
from ...solver.errors import CouplingError
from ..fmu.fmu_instance import Instance, StepFailed, Value
from ..fmu.group import initialize
from ..fmu.wiring import UNWIRED, Wiring, wire
from .coupling import Answer, CoupledPair
from .couplings import Coupling
from .reference_signal import Reference

SHORT = 1e-4, 1e-5  # of a step, for the gain of a ring: effects through states vanish with it
MOVED = 1e-3  # of a command's nominal value
LASTS = 0.5  # share of the gain that has to remain at the shorter of the two


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
    # default: interface-Jacobian if the plant accepts a feedback law, else gauss-seidel
    coupling: Coupling | None = None
    corrections: int | None = None  # 0 or 1; default: 1 for interface-Jacobian if states are saved
    # of plant and controller: parameters, start values, and inputs that are not connected
    values: tuple[Mapping[str, Value], Mapping[str, Value]] = ({}, {})
    # names of ports, ``theirs -> ours``, see `wire`; with `wiring` it only names the results
    mapping: Mapping[str, str] = field(default_factory=dict)
    wiring: Wiring = UNWIRED  # default: ports of the same name, or as mapped
    _begun: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if self.wiring is UNWIRED:
            self.wiring = wire(self.plant, self.controller, self.mapping)
        self.start: Vector = self.reference.all_at(0.0, self.wiring.orders)
        self.scheme = self._chosen()
        real = all(self.plant.is_real(theirs) for _, theirs in self.wiring.commands)
        # whether steps can be repeated
        self.reversible = real and self.plant.can_save and self.controller.can_save
        if self.corrections and not self.reversible:
            lacks = "both FMUs to save and restore their state" if real else "real commands"
            raise CouplingError(f"corrections need {lacks}")
        by_default = self.scheme.law and self.reversible
        self.corrected = by_default if self.corrections is None else bool(self.corrections)

    def _chosen(self) -> Coupling:
        """The requested coupling, else the best that both sides support."""
        wanted, accepts = self.coupling, self.wiring.accepts_law
        if wanted and wanted.law and not accepts:
            name = wanted.value.replace("jacobian", "Jacobian")
            raise CouplingError(
                f"{name} coupling needs law ports on {self.plant.name} (u_gain_..., u_ref_..., "
                "u_rate) but it has none; use gauss-seidel"
            )
        if self.wiring.is_empty:
            return Coupling.JACOBI
        return wanted or (Coupling.INTERFACE_JACOBIAN if accepts else Coupling.GAUSS_SEIDEL)

    def reason_of(self, main: CoupledPair) -> str:
        """Why this coupling was chosen, and the source of its derivatives."""
        if self.wiring.is_empty:
            return f"{self.plant.name} runs alone; there is no coupling"
        if self.coupling:
            return "as asked"
        if not self.scheme.law:
            return f"{self.plant.name} has no law ports"
        probed = main.answer is Answer.DIRECT or main.controller.can_save
        if main.answer is Answer.SAMPLED or not (self.wiring.reports_law or probed):
            return "the plant has law ports; the controller holds its commands"
        if self.wiring.reports_law:
            return "the plant accepts the feedback law and the controller reports it"
        return "the plant accepts the feedback law; the controller's derivatives are probed"

    def main(self) -> CoupledPair:
        """The loop as asked."""
        averaged = self.scheme.law or self.corrected
        return self._opened(self.scheme, self.corrected, averaged, self.wiring)

    def _opened(
        self, scheme: Coupling, corrected: bool, averaged: bool, wiring: Wiring | None = None
    ) -> CoupledPair:
        """The loop at its start: first these instances themselves, after that opened again."""
        p, c = self.plant, self.controller
        if self._begun:
            p, c = p.reopened(), c.reopened()
        self._begun = True
        initialize(p, c, self.wiring, self.values, self.stop, self.start)
        if wiring is None:  # to judge a run: other outputs are judged in networks only
            wiring = self.wiring if self.wiring.network else replace(self.wiring, others=())
        return CoupledPair(p, c, wiring, scheme, corrected, averaged, self.start)

    def best(self) -> CoupledPair:
        """The loop, corrected if possible."""
        return self._opened(self.scheme, self.reversible, self.scheme.law or self.reversible)

    def otherwise(self, main: CoupledPair) -> CoupledPair:
        """The loop that corrects its steps if the run does not, and vice versa."""
        return self._opened(self.scheme, not main.corrected, not self.scheme.law)

    def times_commands(self, answer: Answer) -> bool:
        """Whether the exchange decides when a command arrives, and no correction mends it."""
        # the times of sampled commands are given; a law follows the signals within the step
        in_time = answer is Answer.SAMPLED or (self.scheme.law and answer is Answer.DIRECT)
        return not (in_time or self.reversible or self.wiring.is_empty)

    def a_step_off(self, answer: Answer) -> CoupledPair:
        """The loop whose commands arrive a step later or earlier than those of the run."""
        scheme = Coupling.GAUSS_SEIDEL if self.scheme.late else Coupling.JACOBI
        pair = self._opened(scheme, False, False)
        if scheme.late and answer is Answer.STEPPED:
            pair.late[:] = np.nan  # the first command, as in the first step of the run
        return pair

    def loop_gain(self, step: float) -> float:
        """Change of the commands by a change of the plant's commands without delay; 0: it decays.

        Both are opened again for each change, and moved by very short parts of the step [s].
        """
        sizes = np.array([MOVED * self.plant.nominal(n) for _, n in self.wiring.commands])

        def answer(time: float, moved: Vector) -> Vector:
            with closing(self.main()) as pair:
                return pair.commands("answer_to", pair.given + moved, time, self.start)

        def gain(time: float) -> float:
            before = answer(time, 0.0 * sizes)
            rows = [answer(time, row) - before for row in np.diag(sizes)]
            return float(np.linalg.norm(np.array(rows) / sizes[:, None], 2))

        try:
            longer, shorter = (gain(share * step) for share in SHORT)
        except StepFailed:  # a part rejects such steps: the gain is not known
            return 0.0
        return shorter if shorter > LASTS * longer else 0.0


def step_that_meets(period: float, step: float) -> float:
    """The longest step [s], at most `step`, of which the sampling period is a multiple."""
    return period / max(1, math.ceil(period / step - 1e-9)) if period > 0 else step

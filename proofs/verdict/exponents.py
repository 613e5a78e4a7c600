"""The exponents from FMUs with tangents equal those of the complete loop in one solver.

Every exponent of the nominal loops and of five perturbed ones by both methods. Each difference is
given with the change of the reference between two tolerances: a loop is compared only for as long
as its reference does not depend on the tolerance.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from runner import Row

from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.arrays import Vector
from ballscrew.solver.kernel import Model
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.stability.tangents_over_fmus import TangentRun, follow_over_fmus

TANGENTS = 5
STOP, SHORT, STEP = 20.0, 3.0, 1e-3  # [s]
TIGHT, LOOSER = 1e-13, 1e-11  # the reference's tolerances
SETTLED = 0.1  # largest difference of the references, over the allowed difference
RELATIVE, ABSOLUTE = 1e-3, 1e-3  # share of an exponent, and bits/s near zero


@dataclass(frozen=True)
class Case:
    controller: str
    plant: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    goal: float = 0.08
    stop: float = STOP  # from 5 s on, some references differ by far more than allowed

    def whole(self, stop: float, tolerance: float = TIGHT) -> tuple[Vector, str]:
        """Exponents in one solver [bits/s], and why it stopped; first frame: x, v, z, i, w."""
        kernel = loop_kernel("plant", self.controller)
        values = {"plant_" + k: v for k, v in self.plant.items()}
        values |= {"controller_" + k: v for k, v in self.values.items()}
        model = Model(kernel, values, tolerance)
        model.set_input("x_d", self.goal)
        names = [s.name for s in kernel.states]
        order = [f"plant_{n}" for n in "xvzi"] + [n for n in names if n.startswith("controller_")]
        frame = np.eye(len(names))[[names.index(n) for n in order]]
        run = follow_tangents(model, np.linspace(0.0, stop, 2001), frame=frame)
        return np.asarray(run.exponents) / np.log(2), run.failure

    def over_fmus(self) -> TangentRun:
        names = ("plant", self.controller)
        pair = [FmuInstance(fmu(name, tangents=TANGENTS), name) for name in names]
        values = {"plant_values": self.plant, "controller_values": self.values}
        try:
            return follow_over_fmus(*pair, self.goal, self.stop, STEP, **values)
        finally:
            for instance in pair:
                instance.close()


LESS, MORE = {"sigma0_hat": 66966.331}, {"sigma1_hat": 349.41}
CASES = {
    "IOL, nominal": Case("iol"),
    "NCTF, nominal": Case("nctf"),
    "IOL, sigma0_hat = 66966.331": Case("iol", values=LESS, stop=SHORT),
    "IOL, sigma0_hat = 66966.331, sigma1_hat = 349.41": Case("iol", values=LESS | MORE, stop=SHORT),
    "NCTF, sigma1 at 70 %": Case("nctf", {"sigma1": 0.7 * 344.56}),
    "NCTF, sigma1 at 130 %": Case("nctf", {"sigma1": 1.3 * 344.56}),
    "NCTF, set-point 4 cm": Case("nctf", goal=0.04),
}


def share(found: Vector, reference: Vector) -> float:
    """Largest difference of an exponent over the allowed difference."""
    allowed = np.maximum(RELATIVE * np.abs(reference), ABSOLUTE)
    return float(np.max(np.abs(found - reference) / allowed))


def tasks(asked: Namespace) -> dict[str, tuple[str]]:
    return {name: (name,) for name in CASES}


def trial(name: str) -> Row:
    """One loop by both methods [bits/s]."""
    case = CASES[name]
    (one, failure), (looser, _) = case.whole(case.stop), case.whole(case.stop, LOOSER)
    began = time.perf_counter()
    run = case.over_fmus()
    seconds, other = time.perf_counter() - began, np.asarray(run.exponents) / np.log(2)
    row: Row = {"loop": name, "stop": float(run.time[-1]), "stopped": run.stopped or failure}
    row |= {"model": one.tolist(), "difference": (other - one).tolist()}
    row |= {"communication_steps": len(run.time) - 1, "seconds": round(seconds, 1)}
    row["largest_share_of_allowed"] = share(other, one)
    row["share_that_the_model_moves"] = share(looser, one)
    if case.stop < STOP:
        longer = [case.whole(STOP, t)[0] for t in (LOOSER, TIGHT)]
        row["share_that_the_model_moves_over_20_s"] = share(*longer)
    return row


def report(rows: Sequence[Row]) -> Row:
    limits = {"largest_share_of_allowed": 1.0, "share_that_the_model_moves": SETTLED}
    good = [all(r[k] <= most for k, most in limits.items()) and not r["stopped"] for r in rows]
    outside = [r["loop"] for r, right in zip(rows, good, strict=True) if not right]
    return {"loops": rows, "outside": outside, "holds": not outside}


def says(report: Row) -> str:
    worst = max(r["largest_share_of_allowed"] for r in report["loops"])
    return f"{len(report['loops'])} loops: the largest difference is {worst:.2g} of the allowed one"

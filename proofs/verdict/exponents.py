"""The exponents from FMUs with tangents equal those of the complete loop in one solver.

Every exponent of the nominal loops and of five perturbed ones by both methods. Each difference is
given with the change of the reference between two tolerances: a loop is compared only for as long
as its reference does not depend on the tolerance.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Sequence

import numpy as np
from runner import Row

from ballscrew import Loop
from ballscrew.orchestration.fmu.fmu_instance import FmuInstance
from ballscrew.orchestration.loop.catalogue import fmu
from ballscrew.solver.arrays import Vector
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.stability.lyapunov import loop_maker, loop_order
from ballscrew.stability.tangents_over_fmus import TangentRun, follow_over_fmus

TANGENTS = 5
STOP, SHORT, STEP = 20.0, 3.0, 1e-3  # [s]
TIGHT, LOOSER = 1e-13, 1e-11  # the reference's tolerances
SETTLED = 0.1  # largest difference of the references, over the allowed difference
RELATIVE, ABSOLUTE = 1e-3, 1e-3  # share of an exponent, and bits/s near zero
LESS, MORE = {"sigma0_hat": 66966.331}, {"sigma1_hat": 349.41}
CASES = {  # from 5 s on, some references differ by far more than allowed
    "IOL, nominal": Loop("iol", stop=STOP),
    "NCTF, nominal": Loop("nctf", stop=STOP),
    "IOL, sigma0_hat = 66966.331": Loop("iol", stop=SHORT, controller_values=LESS),
    "IOL, sigma0_hat = 66966.331, sigma1_hat = 349.41": Loop(
        "iol", stop=SHORT, controller_values=LESS | MORE
    ),
    "NCTF, sigma1 at 70 %": Loop("nctf", stop=STOP, plant_values={"sigma1": 0.7 * 344.56}),
    "NCTF, sigma1 at 130 %": Loop("nctf", stop=STOP, plant_values={"sigma1": 1.3 * 344.56}),
    "NCTF, set-point 4 cm": Loop("nctf", stop=STOP, reference=0.04),
}


def whole(loop: Loop, stop: float, tolerance: float) -> tuple[Vector, str]:
    """Exponents in one solver [bits/s], and why it stopped."""
    model = loop_maker(loop)(tolerance)
    frame = np.eye(len(model.x))[loop_order(model.kernel)]
    run = follow_tangents(model, np.linspace(0.0, stop, 2001), frame=frame)
    return np.asarray(run.exponents) / np.log(2), run.failure


def over_fmus(loop: Loop) -> TangentRun:
    names = ("plant", loop.controller.name)
    pair = [FmuInstance(fmu(name, tangents=TANGENTS), name) for name in names]
    values = {"plant_values": loop.plant_values, "controller_values": loop.controller_values}
    try:
        return follow_over_fmus(*pair, loop.set_point, loop.stop, STEP, **values)
    finally:
        for instance in pair:
            instance.close()


def share(found: Vector, reference: Vector) -> float:
    allowed = np.maximum(RELATIVE * np.abs(reference), ABSOLUTE)
    return float(np.max(np.abs(found - reference) / allowed))


def tasks(asked: Namespace) -> dict[str, tuple[str]]:
    return {name: (name,) for name in CASES}


def trial(name: str) -> Row:
    """One loop by both methods [bits/s]."""
    case = CASES[name]
    (one, failure), (looser, _) = (whole(case, case.stop, t) for t in (TIGHT, LOOSER))
    began = time.perf_counter()
    run = over_fmus(case)
    seconds, other = time.perf_counter() - began, np.asarray(run.exponents) / np.log(2)
    row: Row = {"loop": name, "stop": float(run.time[-1]), "stopped": run.stopped or failure}
    row |= {"model": one.tolist(), "difference": (other - one).tolist()}
    row |= {"communication_steps": len(run.time) - 1, "seconds": round(seconds, 1)}
    row["largest_share_of_allowed"] = share(other, one)
    row["share_that_the_model_moves"] = share(looser, one)
    if case.stop < STOP:
        longer = [whole(case, STOP, t)[0] for t in (LOOSER, TIGHT)]
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

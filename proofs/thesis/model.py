"""Section 3.3: parameters and the friction law."""

from __future__ import annotations

import math

import numpy as np

from ballscrew.controllers.nctf import STEP_VOLTAGE
from thesis.claim import Claim, number
from thesis.loops import Figures, loop_run
from thesis.printed import (
    GRID_1,
    NOMINAL,
    PRINTED_A,
    PRINTED_H,
    REGION_1,
    SETPOINT,
    SIGMA0,
    SIGMA1,
    SYSTEM_1,
    SYSTEM_2,
)


def parameters() -> Figures:
    """Numbers computed from the printed ones."""
    (low0, high0), (low1, high1) = REGION_1
    steps0 = round(SIGMA0 * (high0 - low0) / GRID_1) + 1
    steps1 = round(SIGMA1 * (high1 - low1) / GRID_1) + 1
    return {
        "back_emf": NOMINAL["ke"],
        "sigma1_from_damping": 2.0 * math.sqrt(SIGMA0 * NOMINAL["m"]) - NOMINAL["sigma2"],
        "step_share_of_35_V": STEP_VOLTAGE / 35.0,
        "step_share_of_36_V": STEP_VOLTAGE / 36.0,
        "system_1": {
            "sigma0_percent": 100.0 * SYSTEM_1[0] / SIGMA0,
            "sigma0_of_printed_percent": 1.00001 * SIGMA0,
            "sigma1_of_printed_percent": 1.03251 * SIGMA1,
        },
        "system_2": {
            "sigma0_percent": 100.0 * SYSTEM_2[0] / SIGMA0,
            "sigma0_of_printed_percent": 0.99998 * SIGMA0,
            "sigma1_of_printed_percent": 1.01407 * SIGMA1,
        },
        "region_1": {
            "sigma0_hat": [low0 * SIGMA0, high0 * SIGMA0],
            "sigma1_hat": [low1 * SIGMA1, high1 * SIGMA1],
            "loops": steps0 * steps1,
        },
        "nctf": {
            "m": -PRINTED_H / PRINTED_A,
            "sigma0_70": 0.7 * SIGMA0,
            "sigma1_70": 0.7 * SIGMA1,
            "sigma0_130": 1.3 * SIGMA0,
            "sigma1_130": 1.3 * SIGMA1,
        },
    }


def friction_model() -> Figures:
    """Section 3.3: modified and original LuGre friction in closed loops."""
    apart = {}
    for controller in ("iol", "nctf"):
        ours, original = loop_run(controller), loop_run(controller, plant="plant_lugre")
        apart[controller] = float(np.max(np.abs(ours.outputs["x"] - original.outputs["x"])))
    return {"largest_difference_of_x": apart}


def model_claims(f: Figures) -> list[Claim]:
    p, apart = f["parameters"], f["friction_model"]["largest_difference_of_x"]
    return [
        number(
            "Table 3.1",
            "sigma1 (Eq. 2.17: 2 sqrt(sigma0 m) - sigma2)",
            344.56,
            p["sigma1_from_damping"],
            "N*s/m",
            0.005,
            digits=7,
        ),
        number(
            "Table 3.1",
            "torque constant against the inverse of the speed constant, 255 rpm/V",
            0.0374,
            p["back_emf"],
            "V*s/rad",
            0.005,
            "The two should be the same number. The rounding in the table leaves a difference of "
            f"{100 * (p['back_emf'] / NOMINAL['kt'] - 1):.2f} %.",
            relative=True,
        ),
        Claim(
            "3.3",
            "modified and original LuGre models are indistinguishable with Kv = 1e8",
            "qualitative",
            f"x differs by at most {1e6 * apart['iol']:.3g} um (linearizing) and "
            f"{1e6 * apart['nctf']:.2g} um (NCTF) over 20 s",
            "within 0.1 % of the step",
            max(apart.values()) <= 1e-3 * SETPOINT,
            f"That is {100 * apart['iol'] / SETPOINT:.2g} % of the step. But the offsets of the "
            "linearizing loop in Section 3.5.1 are tens of micrometres, too.",
        ),
    ]

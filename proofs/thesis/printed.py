"""Numbers that the thesis prints, and the nominal parameters."""

from __future__ import annotations

import math

from ballscrew.plant.ball_screw import PARAMETERS as AXIS
from ballscrew.plant.lugre import PARAMETERS as LUGRE

NOMINAL = {p.name: p.default for p in (*AXIS, *LUGRE)}
SIGMA0, SIGMA1 = NOMINAL["sigma0"], NOMINAL["sigma1"]
BITS = 1.0 / math.log(2.0)
SETPOINT = 0.08  # Sections 3.4.1.2 and 3.4.2.2 [m]
STOP, LONG = 20.0, 300.0  # of the text, and the time that fits Tables 3.3 and 3.4 [s]
NOMINAL_VOLTAGE = 35.0  # 3.4.1.2 [V]
PEAK = (0.32, 33.0)  # Fig. 3.5, "approximately" [s], [V]
STEADY, STEADY_NCTF = 1.5, 2.2  # times after which the voltage is steady: Figs. 3.5, 3.10 [s]
SECOND_PEAK = 0.3  # Fig. 3.10, "approximately" [s]
SYSTEM_1 = (66967.331, 355.76)  # 3.5.1.1: sigma0_hat, sigma1_hat
SYSTEM_2 = (66966.331, 349.41)  # 3.5.1.2
LARGEST_1 = -0.03413  # Fig. 3.13 [bits/s]
SPECTRUM_2 = (0.0, -0.00173, -13.03, -13.19)  # Fig. 3.17 [bits/s]
RUNAWAY, CYCLE = 66968.98, 344.16  # Fig. 3.18: critical sigma0_hat, sigma1_hat
REGION = ((0.99998 * SIGMA0, 1.00003 * SIGMA0), (0.98548 * SIGMA1, 1.06675 * SIGMA1))  # Eq. 3.29
GRID = 0.05  # of the region
PRINTED_H, PRINTED_A, PRINTED_M, PRINTED_C = 0.1193, 0.1, -1.193, 13.25  # 3.4.2.1
LARGEST_BY_SIGMA1 = {
    70: -0.0167, 75: -0.0161, 80: -0.0154, 85: -0.0147, 90: -0.0142, 95: -0.0137, 100: -0.0134,
    105: -0.0130, 110: -0.0127, 115: -0.0125, 120: -0.0124, 125: -0.0123, 130: -0.0123,
}  # Tables 3.3-3.4: rows, all columns alike [bits/s]  # fmt: skip

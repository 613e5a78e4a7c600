"""The numbers of the thesis, and the nominal parameters for them."""

from __future__ import annotations

import math

from ballscrew.plant.ball_screw import PARAMETERS as AXIS
from ballscrew.plant.lugre import PARAMETERS as LUGRE

NOMINAL = {p.name: p.default for p in (*AXIS, *LUGRE)}


SIGMA0, SIGMA1 = NOMINAL["sigma0"], NOMINAL["sigma1"]


BITS = 1.0 / math.log(2.0)


SETPOINT = 0.08  # m, Sections 3.4.1.2 and 3.4.2.2


STOP = 20.0  # s, the same


LONG = 300.0  # s


VARIANTS = {"estimated": "iol", "true": "iol_true_acceleration"}


# The numbers of the thesis.
NOMINAL_VOLTAGE = 35.0  # V, 3.4.1.2


PEAK = (0.32, 33.0)  # Fig. 3.5, s and V, "approximately"


STEADY = 1.5  # Fig. 3.5: the voltage is steady after this time, s


SECOND_PEAK = 0.3  # Fig. 3.10: time of the second peak, s, "approximately"


STEADY_NCTF = 2.2  # Fig. 3.10: the voltage is steady after this time, s


SYSTEM_1 = (66967.331, 355.76)  # 3.5.1.1: sigma0_hat, sigma1_hat


SYSTEM_2 = (66966.331, 349.41)  # 3.5.1.2


LARGEST_1 = -0.03413  # Fig. 3.13, bits/s


SPECTRUM_2 = (0.0, -0.00173, -13.03, -13.19)  # Fig. 3.17, bits/s


SECONDS_1 = 1177.0  # 3.5.1.1: to compute the exponents


RUNAWAY = 66968.98  # Fig. 3.18: critical sigma0_hat


CYCLE = 344.16  # Fig. 3.18: critical sigma1_hat


REGION_1 = ((0.99998, 1.00003), (0.98548, 1.06675))  # Eq. 3.29


GRID_1 = 0.05


PRINTED_H, PRINTED_A, PRINTED_M, PRINTED_C = 0.1193, 0.1, -1.193, 13.25  # 3.4.2.1


PERCENT = tuple(range(70, 131, 5))  # rows and columns of Tables 3.3 and 3.4


COARSE = PERCENT[::2]  # those for which sigma0 and sigma1 are both perturbed here


ROWS = (
    -0.0167, -0.0161, -0.0154, -0.0147, -0.0142, -0.0137, -0.0134,
    -0.0130, -0.0127, -0.0125, -0.0124, -0.0123, -0.0123,
)  # fmt: skip


MISPRINT = (130, 90, 0.0123)  # row, column and value of the only cell that differs from its row

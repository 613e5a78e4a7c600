"""Section 3.4.1: input-output linearization."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from ballscrew.orchestration.loop.closed_loop import metrics
from thesis.claim import Claim, number
from thesis.loops import Figures, loop_run
from thesis.nctf import with_faster_bristles
from thesis.printed import SETPOINT


def linearization() -> Figures:
    """Section 3.4.1.2."""
    run = loop_run("iol")
    found = metrics(run).to_dict()
    u = run.commands["u"]
    late = run.time >= 1.5
    at_half = float(run.outputs["x"][500] - SETPOINT)
    rates, start = np.array([-5.0, -6.0, -7.0]), np.array([-SETPOINT, 0.0, 0.0])
    weights = np.linalg.solve(np.vander(rates, increasing=True).T, start)

    def peak_excess(scale: float) -> float:
        return metrics(loop_run("iol", with_faster_bristles(scale), 3.0)).peak_voltage - 35.0

    scale = float(brentq(peak_excess, 1.0, 1.5, xtol=1e-4))
    faster = metrics(loop_run("iol", with_faster_bristles(scale), 3.0))
    return found | {
        "voltage_at_0_32_s": float(u[320]),
        "voltage_at_1_5_s": float(u[1500]),
        "voltage_at_end": float(u[-1]),
        "voltage_change_after_1_5_s": float(np.ptp(u[late])),
        "x1_at_half_second": at_half,
        "x1_at_half_second_exact": float(weights @ np.exp(0.5 * rates)),
        "poles_times": scale,
        "settling_with_these_poles": faster.settling_time_2pct,
    }


def linearization_claims(f: Figures) -> list[Claim]:
    r = f["linearization"]
    late = r["voltage_change_after_1_5_s"]
    return [
        Claim(
            "3.4.1.2, Fig. 3.4",
            "no overshoot",
            "none",
            f"{1e3 * r['overshoot']:.2g} mm",
            "below 0.001 mm",
            r["overshoot"] < 1e-6,
        ),
        Claim(
            "3.4.1.2, Fig. 3.4",
            "no steady-state error",
            "none",
            f"{r['steady_state_error']:.1g} m after 20 s",
            "below 1 um",
            abs(r["steady_state_error"]) < 1e-6,
        ),
        Claim(
            "Eq. 3.22",
            "x1 at 0.5 s, by the equation that the thesis gives and does not evaluate",
            "not printed",
            f"{r['x1_at_half_second']:.9g} m; exact solution {r['x1_at_half_second_exact']:.9g} m",
            "within 1e-08 m of the exact solution",
            abs(r["x1_at_half_second"] - r["x1_at_half_second_exact"]) <= 1e-8,
            printed=False,
        ),
        number("3.4.1.2, Fig. 3.5", "peak voltage, approximately", 33, r["peak_voltage"], "V", 1.0),
        number(
            "3.4.1.2, Fig. 3.5",
            "time of the peak",
            0.32,
            r["peak_voltage_time"],
            "s",
            0.02,
            f"The peak is flat: at 0.32 s the voltage is {r['voltage_at_0_32_s']:.2f} V. That is "
            f"{1e3 * (r['peak_voltage'] - r['voltage_at_0_32_s']):.0f} mV below the peak.",
        ),
        Claim(
            "3.4.1.2",
            "the voltage stays within the nominal 35 V",
            "35 V",
            f"{r['peak_voltage']:.2f} V",
            "at most 35 V",
            r["peak_voltage"] <= 35.0,
        ),
        Claim(
            "3.4.1.1",
            "the coefficients of Eq. 3.21 give the shortest settling time within the nominal "
            "voltage",
            "18, 107, 210",
            f"2 % settling {r['settling_time_2pct']:.3f} s; {r['settling_with_these_poles']:.3f} s "
            "is possible",
            "nothing faster within 35 V",
            r["settling_with_these_poles"] >= r["settling_time_2pct"],
            f"With poles {r['poles_times']:.3f} times as far out (coefficients "
            f"{18 * r['poles_times']:.2f}, {107 * r['poles_times'] ** 2:.1f}, "
            f"{210 * r['poles_times'] ** 3:.1f}) the voltage just reaches 35 V, and the loop "
            "settles "
            f"{1e3 * (r['settling_time_2pct'] - r['settling_with_these_poles']):.0f} ms sooner.",
        ),
        Claim(
            "3.4.1.2, Fig. 3.5",
            "the voltage is steady after 1.5 s",
            "qualitative",
            f"changes by {late:.2f} V after it",
            "by less than 5 % of the peak",
            late < 0.05 * r["peak_voltage"],
        ),
    ]

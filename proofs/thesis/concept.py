"""Section 3.2: the concept of Lyapunov exponents."""

from __future__ import annotations

import numpy as np

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.stability.lyapunov import loop_maker, loop_order, lyapunov
from thesis.claim import Claim, numbers
from thesis.loops import Figures, spectrum_figures
from thesis.printed import BITS, NOMINAL, SETPOINT, SIGMA0, STOP


def concept() -> Figures:
    """Section 3.2: first frames and initial conditions."""
    kernel = loop_kernel("plant", "nctf")
    order = loop_order(kernel)
    make = loop_maker(Loop("nctf", reference=SETPOINT))
    frames = {}
    for shift in range(len(order)):
        turned = order[shift:] + order[:shift]
        model = make(1e-11)
        frame = np.eye(len(order))[turned]
        run = follow_tangents(model, np.array([0.0, STOP]), frame=frame)
        frames[kernel.states[turned[0]].name] = float(run.growth[-1].max()) * BITS
    starts = {}
    for setpoint in (0.02, 0.04, 0.08, 0.12):
        run_ = lyapunov(
            loop_maker(Loop("iol", reference=setpoint)),
            STOP,
            order=loop_order(loop_kernel("plant", "iol")),
        )
        starts[f"{setpoint:g}"] = spectrum_figures(run_)
    return {"first_state_of_frame": frames, "iol_by_setpoint": starts}


def concept_claims(f: Figures) -> list[Claim]:
    c = f["concept"]
    runs = c["iol_by_setpoint"].values()
    limits = np.array([r["asymptotic_bits_per_s"] for r in runs])
    spread = float(np.ptp(limits, axis=0).max())
    early = [r["lambda1_times_t_bits"] for r in runs]
    frames = list(c["first_state_of_frame"].values())
    iol, nc = f["spectra"]["iol_at_300_s"], f["spectra"]["nctf_at_300_s"]
    return [
        Claim(
            "3.2",
            "exponents do not depend on the initial conditions within one attractor",
            "qualitative",
            f"limits of the linearizing loop from 2, 4, 8 and 12 cm differ by {spread:.1g} bits/s",
            "limits within 1e-3 bits/s",
            spread <= 1e-3,
            "This is true of the limits only. The thesis prints values at a finite time. After "
            f"20 s the largest exponent times time is {early[0]:.2f}, {early[1]:.2f}, "
            f"{early[2]:.2f} and "
            f"{early[3]:.2f} bits from 2, 4, 8 and 12 cm. The exact limits are 0, -5, -6 and -7 "
            "1/s from "
            "every start, which is 0, "
            + ", ".join(f"{-pole * BITS:.4f}" for pole in (5, 6, 7))
            + f" bits/s. The spread of {spread:.1g} bits/s is the error of this program.",
        ),
        Claim(
            "3.2, Eq. 3.7",
            "an arbitrary initial vector set may be chosen",
            "qualitative",
            f"largest exponent times time after 20 s, NCTF: {max(frames):.2f} to {min(frames):.2f} "
            "bits by the vector that comes first",
            "the same within 1 %",
            max(frames) - min(frames) <= 0.01 * abs(min(frames)),
            "In the limit this is right. At the times used here an exponent is a constant divided "
            "by the time. The constant depends on the vector that is orthonormalized first: "
            + ", ".join(
                f"{name.split('_')[-1]} first {value:.2f}"
                for name, value in c["first_state_of_frame"].items()
            )
            + " bits. The printed tables fit x first, which is the order of Table 3.2.",
        ),
        Claim(
            "3.2",
            "a stable fixed point has negative exponents only, a limit cycle one zero",
            "qualitative",
            "both nominal loops come to rest with a largest exponent of "
            f"{iol['asymptotic_bits_per_s'][0]:g} in the limit",
            "largest limit below 0",
            iol["asymptotic_bits_per_s"][0] < 0.0,
            "At rest S(v) is 0 and the bristles do not creep. Every deflection below Fs/sigma0 = "
            f"{1e6 * NOMINAL['Fs'] / SIGMA0:.1f} um is an equilibrium, and the direction along "
            "this line is neutral. The limits are "
            + numbers(iol["asymptotic_bits_per_s"])
            + " (linearizing) and "
            + numbers(nc["asymptotic_bits_per_s"])
            + " bits/s (NCTF). At a finite time t the largest exponent is c/t with c = "
            f"{iol['lambda1_times_t_bits']:.3f} and {nc['lambda1_times_t_bits']:.3f} bits. So a "
            "negative value does not show an isolated fixed point, and a zero does not show a "
            "cycle.",
        ),
    ]

"""Sections 3.5.1.1 and 3.5.1.2: two perturbed linearizing loops."""

from __future__ import annotations

import time

import numpy as np

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.spectrum import follow_tangents
from ballscrew.stability.lyapunov import loop_lyapunov, loop_maker, loop_order
from thesis.claim import Claim, number, numbers
from thesis.loops import Figures, growth, hats, spectrum_figures
from thesis.printed import (
    BITS,
    LARGEST_1,
    LONG,
    SECONDS_1,
    SETPOINT,
    SIGMA0,
    SPECTRUM_2,
    STOP,
    SYSTEM_1,
    SYSTEM_2,
    VARIANTS,
)
from thesis.solvers import NEIGHBOURS


def spectra() -> Figures:
    """Exponents of the nominal loops and of 3.5.1.1 and 3.5.1.2, at 20 s and at 300 s."""
    found: Figures = {}
    for name, stop in (("at_20_s", STOP), ("at_300_s", LONG)):
        found[f"iol_{name}"] = spectrum_figures(loop_lyapunov(Loop("iol", stop=stop)))
        found[f"nctf_{name}"] = spectrum_figures(loop_lyapunov(Loop("nctf", stop=stop)))
    for variant, controller in VARIANTS.items():
        as_percent = (1.00001 * SIGMA0, SYSTEM_1[1])
        _, grown = growth(controller, hats(*as_percent), LONG, tolerance=1e-11)
        found[f"system_1_{variant}_as_percent_at_300_s"] = float(grown[-1]) / LONG
        for k, system in enumerate((SYSTEM_1, SYSTEM_2), start=1):
            run = loop_lyapunov(Loop(controller, stop=STOP, controller_values=hats(*system)))
            found[f"system_{k}_{variant}"] = spectrum_figures(run)
            times, grown = growth(controller, hats(*system), 600.0, tolerance=1e-11, points=2401)
            rate = grown[1:] / times[1:]
            below = np.flatnonzero(rate < LARGEST_1)
            found[f"system_{k}_{variant}_long"] = {
                "lambda1_at_20_s": float(rate[np.searchsorted(times, STOP) - 1]),
                "lambda1_at_300_s": float(rate[np.searchsorted(times, LONG) - 1]),
                **_after_300_s(controller, system),
                "last_below_printed": float(times[1 + below[-1]]),
            }
    taken = []  # the best of three, because other programs run on this machine
    for _ in range(3):
        model = loop_maker(Loop("iol", reference=SETPOINT, controller_values=hats(*SYSTEM_1)))(1e-9)
        before = time.perf_counter()
        follow_tangents(model, np.linspace(0.0, STOP, 401))
        taken.append(time.perf_counter() - before)
    found["seconds_system_1"] = min(taken)
    return found


def _after_300_s(controller: str, system: tuple[float, float]) -> Figures:
    """All exponents and the mean trace after 300 s, and the largest at other tolerances."""
    make = loop_maker(Loop(controller, reference=SETPOINT, controller_values=hats(*system)))
    model = make(1e-11)
    frame = np.eye(len(model.x))[loop_order(model.kernel)]
    run = follow_tangents(model, np.array([0.0, LONG]), frame=frame)
    return {
        "exponents_at_300_s": (np.sort(run.exponents)[::-1] * BITS).tolist(),
        "trace_at_300_s": float(run.trace[-1]) / LONG * BITS,
        "lambda1_at_300_s_by_tolerance": {
            f"{tolerance:g}": float(
                growth(controller, hats(*system), LONG, tolerance=tolerance)[1][-1] / LONG
            )
            for tolerance in (1e-8, 1e-9, 1e-10, 1e-12)
        },
    }


def system_claims(f: Figures) -> list[Claim]:
    return [*_first_system(f), *_second_system(f)]


def _first_system(f: Figures) -> list[Claim]:
    """Section 3.5.1.1."""
    p, s = f["parameters"], f["spectra"]
    one, here = s["system_1_estimated"], f["loose_solvers"]["systems_here"][0]
    one_long, true_long = s["system_1_estimated_long"], s["system_1_true_long"]
    tolerances = one_long["lambda1_at_300_s_by_tolerance"]
    return [
        *_parameter_claims("3.5.1.1", ("100.001", "103.251"), SYSTEM_1, p["system_1"]),
        Claim(
            "3.5.1.1, Figs. 3.11-3.12",
            "the states converge",
            "qualitative",
            f"after 20 s x1 is {1e6 * here['offset']:.2f} um and moves by "
            f"{1e6 * 2 * here['swing']:.2g} um in two seconds",
            "within 10 um",
            abs(here["offset"]) < 1e-5 and here["kind"] == "stands",
            f"This program's verdict is: {one['verdict']}. The block is stuck. Only the bristles "
            f"still creep, by {1e9 * here['swing']:.0f} nm/s on average.",
        ),
        Claim(
            "3.5.1.1, Fig. 3.13",
            "all exponents are negative",
            "qualitative",
            "after 20 s " + numbers(one["exponents_bits_per_s"]) + " bits/s",
            "all below 0",
            max(one["exponents_bits_per_s"]) < 0.0,
            f"After 300 s the largest is {one_long['lambda1_at_300_s']:.4f} bits/s. That is "
            f"{one_long['lambda1_at_20_s'] / one_long['lambda1_at_300_s']:.1f} times smaller: it "
            "goes to zero with time.",
        ),
        number(
            "3.5.1.1, Fig. 3.13",
            "largest exponent",
            LARGEST_1,
            one_long["lambda1_at_300_s"],
            "bits/s",
            0.03,
            "The value depends on the time. After the 20 s of the text it is "
            f"{one_long['lambda1_at_20_s']:.4f}, and it passes the printed value at "
            f"{one_long['last_below_printed']:.0f} s. At 300 s, the time that fits Tables 3.3-3.4, "
            f"it is {one_long['lambda1_at_300_s']:.5f} with estimates inside x1''. With the true "
            f"x1'' it is {true_long['lambda1_at_300_s']:.5f} and passes the printed value at "
            f"{true_long['last_below_printed']:.0f} s. With sigma0_hat at a true 100.001 % it is "
            f"{s['system_1_estimated_as_percent_at_300_s']:.5f}. The block creeps where S(v) "
            "changes its sign, so the value depends on the accuracy: with tolerances of "
            + ", ".join(tolerances)
            + " it is "
            + ", ".join(f"{v:.5f}" for v in tolerances.values())
            + ". The rest cannot be decided.",
            relative=True,
        ),
        Claim(
            "3.5.1.1",
            "computing the exponents takes",
            f"{SECONDS_1:g} s",
            f"{s['seconds_system_1']:.2g} s (all four over 20 s)",
            "no claim to compare: another computer",
            True,
            f"That is {SECONDS_1 / s['seconds_system_1']:,.0f} times less. The computer is another "
            "one, and the method is a stiff one whose tangents use the exact Jacobian.",
            printed=False,
        ),
    ]


def _parameter_claims(
    where: str, shares: tuple[str, str], printed: tuple[float, float], found: Figures
) -> list[Claim]:
    """Estimates of sigma0 and sigma1, as percentages and as values."""
    why = f"The printed value is {found['sigma0_percent']:.5f} % of the nominal one."
    if where == "3.5.1.1":
        why += " This page uses the values, not the percentages."
    return [
        number(
            where,
            f"{shares[0]} % of sigma0",
            printed[0],
            found["sigma0_of_printed_percent"],
            "N/m",
            0.005,
            why,
            digits=8,
        ),
        number(
            where,
            f"{shares[1]} % of sigma1",
            printed[1],
            found["sigma1_of_printed_percent"],
            "N*s/m",
            0.005,
            digits=6,
        ),
    ]


def _second_system(f: Figures) -> list[Claim]:
    """Section 3.5.1.2."""
    p, s, loose = f["parameters"], f["spectra"], f["loose_solvers"]
    two, two_true = s["system_2_estimated"], s["system_2_true"]
    two_long = s["system_2_estimated_long"]
    here = loose["systems_here"][1]
    limit = two["asymptotic_bits_per_s"]
    swings = {k: [1e6 * e["swing"] for e in v] for k, v in loose["systems"].items()}
    default, tight = swings["RK45 0.001 1e-06"], swings["RK45 1e-06 1e-09"]
    return [
        *_parameter_claims("3.5.1.2", ("99.998", "101.407"), SYSTEM_2, p["system_2"]),
        Claim(
            "3.5.1.2, Figs. 3.14-3.16",
            "a stable limit cycle around the origin",
            "limit cycle",
            f"{two['verdict']}, x1 = {1e6 * (two['rest']['plant_x'] - SETPOINT):+.1f} um "
            f"({1e6 * (two_true['rest']['plant_x'] - SETPOINT):+.1f} um with the true x1'')",
            "a cycle",
            two["verdict"] == "limit cycle",
            f"The motion dies out: in the last two of 20 s it is {1e6 * here['swing']:.1g} um to "
            "either side. The error of a solver can keep it alive. Scipy's RK45 (Dormand and "
            "Prince's pair, as ode45) with a relative tolerance of 1e-3 and an absolute one of "
            f"1e-6 for all states makes it swing by {default[1]:.0f} um. With tolerances a "
            f"thousand times smaller it swings by {tight[1]:.1g} um. The deflection itself is "
            f"{1e6 * two['rest']['plant_z']:.0f} um, and 1e-6 is "
            f"{100 * 1e-6 / two['rest']['plant_z']:.0f} % of it. What the loose solver does "
            "changes with "
            f"the last bits: of {NEIGHBOURS} loops whose sigma0_hat differs by parts of 1e-13, "
            f"{loose['swinging_neighbours'][1]} swing by more than 10 um. So do "
            f"{loose['swinging_neighbours'][0]} of {NEIGHBOURS} around the system of 3.5.1.1, "
            "which "
            "the thesis calls stable. Integration can have made the cycle, then. It does not "
            "explain why only one of the two systems swings. The table of solvers is below.",
        ),
        Claim(
            "3.5.1.2, Fig. 3.17",
            "largest exponents",
            f"{SPECTRUM_2[0]:g}, {SPECTRUM_2[1]} bits/s",
            "{:.4f}, {:.4f} after 300 s; ".format(*two_long["exponents_at_300_s"][:2])
            + f"limits {limit[0]:g}, {limit[1]:.2g}",
            "within 2e-3 bits/s after 300 s",
            max(
                abs(a - b)
                for a, b in zip(two_long["exponents_at_300_s"][:2], SPECTRUM_2[:2], strict=False)
            )
            <= 2e-3,
            "A line of equilibria has a zero and a small negative number, too: 0 along the line, "
            f"and {limit[1] / BITS:.2g} 1/s for the creep towards it. But the finite-time values "
            f"need {-two['lambda1_times_t_bits'] / 1e-3:.0f} s to fall to 0.001 bits/s. So the "
            "printed 0 does not come from 20 or 300 s of the motion found here.",
        ),
        number(
            "3.5.1.2, Fig. 3.17",
            "third exponent (limit here)",
            SPECTRUM_2[2],
            limit[2],
            "bits/s",
            0.02,
            "The third and the fourth belong to the ringing of the stuck block, a pair of "
            f"eigenvalues with the real part {limit[2] / BITS:.3f} 1/s. Both limits are "
            f"{limit[2]:.2f} bits/s. After 20 s they are {two['exponents_bits_per_s'][2]:.2f} and "
            f"{two['exponents_bits_per_s'][3]:.1f} bits/s.",
            relative=True,
        ),
        number(
            "3.5.1.2, Fig. 3.17",
            "fourth exponent (limit here)",
            SPECTRUM_2[3],
            limit[3],
            "bits/s",
            0.02,
            relative=True,
        ),
        _sum_of_exponents(two, two_long),
    ]


def _sum_of_exponents(two: Figures, two_long: Figures) -> Claim:
    rest_trace, printed_sum = sum(two["asymptotic_bits_per_s"]), sum(SPECTRUM_2)
    slide = (two_long["trace_at_300_s"] - rest_trace) * LONG
    return Claim(
        "3.5.1.2, Fig. 3.17",
        "the four exponents together (they have to add up to the mean trace)",
        f"{printed_sum:.2f} bits/s",
        f"{two['mean_trace_bits_per_s']:.1f} after 20 s, {two_long['trace_at_300_s']:.1f} "
        f"after 300 s, {rest_trace:.2f} at rest",
        "within 1 % at 20 or 300 s",
        min(
            abs(two["mean_trace_bits_per_s"] / printed_sum - 1.0),
            abs(two_long["trace_at_300_s"] / printed_sum - 1.0),
        )
        <= 0.01,
        f"While the block slides, the bristles contract fast: the slide adds {slide:.0f} bits "
        f"to the sum. With the slide included, the mean would be {printed_sum:.2f} after "
        f"{slide / (printed_sum - rest_trace) / 3600:.1f} hours. So either the transient was left "
        "out, or the fast direction was lost between two orthonormalizations. The sum of the "
        f"stuck loop is {rest_trace / BITS:.2f} 1/s.",
    )

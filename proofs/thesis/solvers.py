"""Results of other solvers for the two perturbed loops, and of loose tolerances."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.stability.lyapunov import loop_maker
from thesis.loops import SEEN, SWING, End, Figures, Vector, end_of, hats
from thesis.model import parameters
from thesis.printed import RUNAWAY, SETPOINT, SIGMA0, STOP, SYSTEM_1, SYSTEM_2, VARIANTS


def by_scipy(sigma0: float, sigma1: float, method: str, rtol: float, atol: float) -> End:
    """The same with a solver of scipy, with one absolute tolerance for all states."""
    model = loop_maker(Loop("iol", reference=SETPOINT, controller_values=hats(sigma0, sigma1)))(
        1e-8
    )
    x = [s.name for s in model.kernel.states].index("plant_x")

    def far(t: float, state: Vector) -> float:
        return 1.0 - abs(float(state[x]))

    far.terminal = True  # type: ignore[attr-defined]
    with np.errstate(all="ignore"):
        run = solve_ivp(
            model.derivatives, (0.0, STOP), model.x.copy(), method, rtol=rtol, atol=atol, events=far
        )
    if run.t[-1] < STOP:
        return End("diverges", math.inf, math.inf)
    swing = float(np.ptp(run.y[x][run.t >= STOP - 2.0])) / 2.0
    return End("swings" if swing > SWING else "stands", swing, float(run.y[x][-1]) - SETPOINT)


SOLVERS = tuple(
    (method, rtol, atol)
    for method in ("RK45", "BDF", "Radau", "LSODA")
    for rtol, atol in ((1e-3, 1e-6), (1e-6, 1e-9))
)


NEIGHBOURS = 9  # loops with sigma0_hat differing by parts of 1e-13: dependence on the last bits


def loose_solvers() -> Figures:
    """Effect of the integration on 3.5.1.1, 3.5.1.2 and the plane."""
    systems = {}
    for method, rtol, atol in SOLVERS:
        ends = [by_scipy(*s, method, rtol, atol) for s in (SYSTEM_1, SYSTEM_2)]
        systems[f"{method} {rtol:g} {atol:g}"] = [vars(e) for e in ends]
    box = parameters()["region_1"]
    across, up = np.linspace(*box["sigma0_hat"], 8), np.linspace(*box["sigma1_hat"], 6)
    left = [(a, b) for b in up for a in across if a < SIGMA0]
    right = [(a, b) for b in up for a in across if SIGMA0 <= a < RUNAWAY]
    shares = {}
    for label, cells in (("left of nominal", left), ("right of nominal", right)):
        found = {"this program": [end_of(*c) for c in cells]}
        for method in ("RK45", "BDF"):
            found[method] = [by_scipy(*c, method, 1e-3, 1e-6) for c in cells]
        shares[label] = {"loops": len(cells)} | {
            f"{name} {least:g}": sum(least < e.swing < math.inf for e in ends) / len(ends)
            for name, ends in found.items()
            for least in (SWING, SEEN)
        }
    ours = [vars(end_of(*s)) for s in (SYSTEM_1, SYSTEM_2)]
    neighbours = [
        [by_scipy(s0 * (1.0 + k * 1e-13), s1, "RK45", 1e-3, 1e-6).swing for k in range(NEIGHBOURS)]
        for s0, s1 in (SYSTEM_1, SYSTEM_2)
    ]
    true = [vars(end_of(*s, controller=VARIANTS["true"])) for s in (SYSTEM_1, SYSTEM_2)]
    return {
        "systems": systems,
        "systems_here": ours,
        "systems_here_true": true,
        "swinging_shares": shares,
        "swinging_neighbours": [sum(s > SEEN for s in found) for found in neighbours],
    }


def solver_table(f: Figures) -> list[str]:
    """Results of solvers for the two systems of 3.5.1."""
    loose = f["loose_solvers"]
    rows = [
        "| solver | relative, absolute tolerance | 3.5.1.1: swing, offset [um] | 3.5.1.2: swing, "
        "offset [um] |",
        "|---|---|---|---|",
    ]
    courses = {"this program 1e-08 nominal": loose["systems_here"]} | loose["systems"]
    for label, ends in courses.items():
        method, rtol, atol = label.rsplit(" ", 2)
        texts = [f"{1e6 * e['swing']:.3g}, {1e6 * e['offset']:.3g}" for e in ends]
        atol = "1e-8 of each nominal magnitude" if atol == "nominal" else atol
        rows.append(f"| {method} | {rtol}, {atol} | {texts[0]} | {texts[1]} |")
    return [
        "**Integration and 3.5.1.2.** Half the range of x in the last two of 20 s, and the offset "
        "from the set-point at the end. All solvers but the first are scipy's:",
        "",
        *rows,
    ]

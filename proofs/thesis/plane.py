"""Section 3.5.1.3: the region of Fig. 3.18."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from thesis.claim import Claim, number
from thesis.loops import Figures, end_of
from thesis.model import parameters
from thesis.printed import CYCLE, GRID_1, NOMINAL, RUNAWAY, SETPOINT, SIGMA0, SIGMA1, VARIANTS


def edge(settled: Callable[[float], bool], good: float, bad: float, width: float) -> float | None:
    """Value between `good` and `bad` at which `settled` changes to false; None without a change."""
    if not settled(good) or settled(bad):
        return None
    while abs(bad - good) > width:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if settled(middle) else (good, middle)
    return 0.5 * (good + bad)


def runaway_edge(
    sigma1: float, setpoint: float = SETPOINT, controller: str = "iol"
) -> float | None:
    """Smallest sigma0_hat at which the loop diverges, to 0.0005 N/m."""
    return edge(
        lambda s0: end_of(s0, sigma1, controller, setpoint).kind != "diverges",
        SIGMA0,
        SIGMA0 + 20.0,
        5e-4,
    )


def cycle_edge(sigma0: float, controller: str = "iol") -> float | None:
    """Largest sigma1_hat below which the loop oscillates, to 0.005 N*s/m."""
    return edge(lambda s1: end_of(sigma0, s1, controller).kind == "stands", 347.0, 340.0, 0.005)


def plane() -> Figures:
    """Fig. 3.18: edges, and shares of kinds in its parts."""
    box = parameters()["region_1"]
    edges: Figures = {}
    for variant, controller in VARIANTS.items():
        edges[variant] = {
            "runaway_by_sigma1": {
                f"{s1:g}": runaway_edge(s1, controller=controller)
                for s1 in (box["sigma1_hat"][0], 342.0, SIGMA1, 350.0, 355.0, 360.0, 365.0)
            },
            "runaway_by_setpoint": {
                f"{sp:g}": runaway_edge(box["sigma1_hat"][0], sp, controller)
                for sp in (0.02, 0.04, 0.08, 0.12)
            },
            "cycle_by_sigma0": {
                f"{d0:+g}": cycle_edge(SIGMA0 + d0, controller)
                for d0 in (-1.0, -0.5, 0.0, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5)
            },
        }
    across = np.linspace(*box["sigma0_hat"], 34)
    up = np.linspace(*box["sigma1_hat"], 57)
    cells = [(a, b, end_of(a, b)) for b in up for a in across]
    parts: dict[str, Callable[[float, float], bool]] = {
        "all": lambda a, b: True,
        "left of nominal": lambda a, b: a < SIGMA0,
        "from nominal to the critical value": lambda a, b: SIGMA0 <= a < RUNAWAY,
        "beyond the critical value": lambda a, b: a > RUNAWAY,
        "below 344.16": lambda a, b: b < CYCLE,
        "above nominal sigma1": lambda a, b: b > SIGMA1,
        "below 344.16, left of nominal": lambda a, b: b < CYCLE and a < SIGMA0,
        "below 344.16, right of nominal": lambda a, b: b < CYCLE and a >= SIGMA0,
    }
    shares = {}
    for name, inside in parts.items():
        ends = [e for a, b, e in cells if inside(a, b)]
        shares[name] = {"loops": len(ends)} | {
            kind: sum(e.kind == kind for e in ends) / len(ends)
            for kind in ("stands", "swings", "diverges")
        }
    offsets = [abs(e.offset) for a, b, e in cells if e.kind == "stands" and a < SIGMA0]
    off = (float(d) for d in np.arange(0.05, 1.75, 0.05))
    first = next(d for d in off if end_of(SIGMA0 + d, SIGMA1).kind == "swings")
    return {
        "grid_steps_to_critical": [(RUNAWAY - SIGMA0) / GRID_1, (CYCLE - SIGMA1) / GRID_1],
        "edges": edges,
        "shares": shares,
        "largest_offset_left": max(offsets),
        "first_swing_off_sigma0": first,
    }


def plane_claims(f: Figures) -> list[Claim]:
    q, loose = f["plane"], f["loose_solvers"]
    shares, edges, true = q["shares"], q["edges"]["estimated"], q["edges"]["true"]
    lowest = next(iter(edges["runaway_by_sigma1"].values()))
    lowest_true = next(iter(true["runaway_by_sigma1"].values()))
    cycles = {k: v for k, v in edges["cycle_by_sigma0"].items() if float(k) >= 0.0}
    cycles_true = [v for k, v in true["cycle_by_sigma0"].items() if float(k) >= 0.0]
    least = min(cycles.values())
    steps = q["grid_steps_to_critical"]
    stiff = SIGMA1 + NOMINAL["sigma2"] - 18.0
    left, middle = shares["left of nominal"], shares["from nominal to the critical value"]
    low, above = shares["below 344.16"], shares["above nominal sigma1"]
    low_left = shares["below 344.16, left of nominal"]
    low_right = shares["below 344.16, right of nominal"]
    solvers = loose["swinging_shares"]["left of nominal"]
    return [
        number(
            "3.5.1.3, Fig. 3.18",
            "critical sigma0_hat: greater ones are all unstable",
            RUNAWAY,
            lowest,
            "N/m",
            GRID_1,
            "The edge depends a little on sigma1_hat: "
            + ", ".join(f"{v:.3f} at {float(k):.6g}" for k, v in edges["runaway_by_sigma1"].items())
            + " N*s/m. Beyond the first of these all loops diverge. The printed value is a point "
            f"of the grid: it is {steps[0]:.2f} steps of {GRID_1} from the nominal value. The edge "
            "is the border of a basin of attraction, so it depends on more than the parameters: "
            "with set-points of "
            + ", ".join(f"{100 * float(k):g}" for k in edges["runaway_by_setpoint"])
            + " cm it is at "
            + ", ".join(f"{v:.2f}" for v in edges["runaway_by_setpoint"].values())
            + " N/m.",
            digits=8,
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "all loops beyond it are unstable",
            "all",
            f"{100 * shares['beyond the critical value']['diverges']:.1f} % of "
            f"{shares['beyond the critical value']['loops']} loops diverge",
            "all",
            shares["beyond the critical value"]["diverges"] == 1.0,
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "from nominal to critical sigma0_hat: all three kinds, fixed points dominate",
            "qualitative",
            _kinds(middle),
            "standing ones more than half, all kinds met",
            middle["stands"] > 0.5 and middle["swings"] > 0 and middle["diverges"] > 0,
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "left of nominal sigma0_hat most loops have a limit cycle",
            "most",
            _kinds(left),
            "swinging ones more than half",
            left["swings"] > 0.5,
            f"They come to rest, off the set-point by up to {1e6 * q['largest_offset_left']:.0f} "
            f"um. With the loose tolerances above, on a grid of {solvers['loops']} of these loops, "
            f"RK45 makes {100 * solvers['RK45 1e-06']:.0f} % swing by more than 1 um "
            f"({100 * solvers['RK45 1e-05']:.0f} % by more than 10 um). BDF makes "
            f"{100 * solvers['BDF 1e-06']:.0f} % swing ({100 * solvers['BDF 1e-05']:.0f} %). This "
            f"program finds {100 * solvers['this program 1e-06']:.0f} %.",
        ),
        number(
            "3.5.1.3, Fig. 3.18",
            "critical sigma1_hat (least over sigma0_hat from the nominal on)",
            CYCLE,
            least,
            "N*s/m",
            GRID_1,
            f"This is a point of the grid, too: {steps[1]:.2f} steps from the nominal value. The "
            "tolerance is one step. Where swinging begins depends on sigma0_hat - sigma0: "
            + ", ".join(f"{v:.3f} at {k}" for k, v in cycles.items())
            + f" N/m. With the true x1'' the least value is {min(cycles_true):.3f}.",
            digits=6,
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "below it a loop has a limit cycle or is unstable",
            "all",
            _kinds(low),
            "none stands",
            low["stands"] == 0.0,
            f"Right of the nominal sigma0_hat this is true: {100 * low_right['stands']:.0f} % of "
            f"{low_right['loops']} loops stand. Left of it {100 * low_left['stands']:.0f} % of "
            f"{low_left['loops']} stand, at an offset from the set-point, as said above.",
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "above nominal sigma1_hat fixed points and limit cycles share the area equally",
            "equally",
            _kinds(above),
            "within a factor of 2",
            above["swings"] >= 0.5 * above["stands"],
            f"Here {100 * above['swings']:.1f} % swing. The error of a solver can make this "
            "difference, too. Right of the nominal sigma0_hat, with the loose tolerances, RK45 and "
            "BDF make "
            f"{100 * loose['swinging_shares']['right of nominal']['RK45 1e-06']:.0f} and "
            f"{100 * loose['swinging_shares']['right of nominal']['BDF 1e-06']:.0f} % swing by "
            "more than 1 um, this program "
            f"{100 * loose['swinging_shares']['right of nominal']['this program 1e-06']:.0f} %.",
        ),
        Claim(
            "3.5.1.3, Fig. 3.18",
            "above nominal sigma1_hat unstable loops are a small portion",
            "qualitative",
            f"{100 * above['diverges']:.1f} %",
            "below 20 %",
            above["diverges"] < 0.2,
        ),
        Claim(
            "3.5.1.3, 3.6",
            "less than 0.01 % off sigma0 can lead to limit cycles and to instability",
            "0.01 %",
            f"first swing at {100 * q['first_swing_off_sigma0'] / SIGMA0:.4f} % (sigma1_hat "
            "nominal), runaway from "
            f"{100 * (edges['runaway_by_sigma1'][_nominal_key(edges)] / SIGMA0 - 1):.4f} %",
            "both below 0.01 %",
            edges["runaway_by_sigma1"][_nominal_key(edges)] < 1.0001 * SIGMA0
            and q["first_swing_off_sigma0"] < 1e-4 * SIGMA0,
            "The controller cancels friction terms that are much larger than its own terms. While "
            f"the block is stuck, the last coefficient of the loop is 210 + {stiff:.2f} "
            "(sigma0_hat "
            f"- sigma0). A difference of {-210 / stiff:.3f} N/m ({100 * 210 / stiff / SIGMA0:.1g} "
            "%) makes it zero. With "
            f"the true x1'' the first runaway of the region is at {lowest_true:.3f} N/m.",
        ),
    ]


def _nominal_key(edges: Figures) -> str:
    return f"{SIGMA1:g}"


def _kinds(share: Figures) -> str:
    return (
        f"{100 * share['stands']:.1f} % stand, {100 * share['swings']:.1f} % swing, "
        f"{100 * share['diverges']:.1f} % diverge ({share['loops']} loops)"
    )

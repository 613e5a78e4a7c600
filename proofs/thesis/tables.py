"""Section 3.5.2: NCTF controllers of perturbed plants, Tables 3.3 and 3.4."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from ballscrew.controllers.nctf import STOPPED_SPEED, design
from ballscrew.orchestration.loop.closed_loop import metrics
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import loop_kernel
from ballscrew.stability.lyapunov import loop_lyapunov
from thesis.claim import Claim, number, numbers
from thesis.loops import Figures, Vector, growth, loop_run, spectrum_figures
from thesis.printed import (
    COARSE,
    LONG,
    MISPRINT,
    PERCENT,
    PRINTED_A,
    PRINTED_C,
    ROWS,
    SETPOINT,
    SIGMA0,
    SIGMA1,
    STOP,
)


def table_run(sigma0_percent: float, sigma1_percent: float, followed: float = LONG) -> Figures:
    """A cell of Tables 3.3 and 3.4: the controller of a perturbed plant on the nominal one.

    The largest exponent is that at 300 s. At rest it falls like 1/t, so a motion of 20 s is enough.
    """
    made = design(
        {"sigma0": sigma0_percent / 100 * SIGMA0, "sigma1": sigma1_percent / 100 * SIGMA1}
    )
    _, grown = growth("nctf", made.parameters(), followed)
    return {"A": made.stopping_time, "lambda1": float(grown[-1]) / LONG}


def with_stopping_time(stopping_time: float) -> dict[str, float]:
    """The controller by the rule of the printed design for a stopping time [s]."""
    share = stopping_time / PRINTED_A
    kernel = loop_kernel("plant", "nctf")
    default = {p.name: p.default for p in kernel.parameters}
    return {
        "c": PRINTED_C / share,
        "Kp": default["controller_Kp"] * share,
        "Ki": default["controller_Ki"] * share,
    }


def tables() -> Figures:
    """Tables 3.3 and 3.4."""
    alone = [table_run(100, p) for p in PERCENT]
    both = [[table_run(q, p, STOP) for q in COARSE] for p in COARSE]
    lengths = np.array([r["lambda1"] * LONG for r in alone])
    printed = np.array(ROWS)
    best = float(lengths @ lengths / (lengths @ printed))
    _, at_20 = growth("nctf", with_stopping_time(PRINTED_A), STOP)
    needed = []
    for value in ROWS:
        needed.append(
            float(
                brentq(
                    lambda a, v=value: (
                        growth("nctf", with_stopping_time(a), STOP)[1][-1] - v * LONG
                    ),
                    0.09,
                    0.1022,
                    xtol=1e-5,
                )
            )
        )
    runs = {}
    for name, (q, p) in {"70": (70, 70), "130": (130, 130)}.items():
        made = design({"sigma0": q / 100 * SIGMA0, "sigma1": p / 100 * SIGMA1})
        run = loop_run("nctf", made.parameters())
        exponents = loop_lyapunov(Loop("nctf", stop=LONG, controller_values=made.parameters()))
        runs[name] = (run, made, exponents)
    rows_alone = {}
    for p in (70, 130):
        rows_alone[p] = loop_run("nctf", design({"sigma1": p / 100 * SIGMA1}).parameters())
    by_stopping_time = [
        {
            "A": a,
            "settling": metrics(loop_run("nctf", with_stopping_time(a), 10.0)).settling_time_2pct,
            "lambda1": float(growth("nctf", with_stopping_time(a), STOP)[1][-1]) / LONG,
        }
        for a in (0.08, 0.1, 0.12)
    ]
    return {
        "percent": list(PERCENT),
        "sigma0_alone": alone,
        "both": both,
        "best_time": best,
        "time_of_nominal_cell": [
            float(at_20[-1]) / v for v in (ROWS[6] - 5e-5, ROWS[6], ROWS[6] + 5e-5)
        ],
        "lambda1_at_20_s": float(at_20[-1]) / STOP,
        "A_needed": needed,
        "by_stopping_time": by_stopping_time,
        "systems": {
            name: metrics(run).to_dict() | {"A": made.stopping_time} | spectrum_figures(exponents)
            for name, (run, made, exponents) in runs.items()
        },
        "x_apart": float(np.max(np.abs(runs["70"][0].outputs["x"] - runs["130"][0].outputs["x"]))),
        "x_apart_sigma0_alone": float(
            np.max(np.abs(rows_alone[70].outputs["x"] - rows_alone[130].outputs["x"]))
        ),
    }


def table_claims(f: Figures) -> list[Claim]:
    t = f["tables"]
    alone = np.array([r["lambda1"] for r in t["sigma0_alone"]])
    both = np.array([[c["lambda1"] for c in row] for row in t["both"]])
    return [
        *_two_systems(f),
        *_printed_cells(t, f["coasting"], alone, both),
        *_trends(t["by_stopping_time"], alone, both),
    ]


def _two_systems(f: Figures) -> list[Claim]:
    """Sections 3.5.2.1 and 3.5.2.2."""
    p, t = f["parameters"], f["tables"]
    one, two = t["systems"]["70"], t["systems"]["130"]
    arithmetic = [
        number(f"3.5.2.{k}", f"{share} % of sigma{n}", value, p["nctf"][f"sigma{n}_{share}"], unit,
               0.005, digits=7)
        for k, share, n, value, unit in (
            (1, 70, 0, 46877.06, "N/m"),
            (1, 70, 1, 241.19, "N*s/m"),
            (2, 130, 0, 87057.4, "N/m"),
            (2, 130, 1, 447.93, "N*s/m"),
        )
    ]  # fmt: skip
    systems = [
        Claim(
            f"3.5.2.{k}, Figs. {figures}",
            f"{share} % of both: the states converge and all exponents are negative",
            "qualitative",
            f"2 % settling {run['settling_time_2pct']:.2f} s; after 300 s "
            + numbers(run["exponents_bits_per_s"])
            + " bits/s",
            "settles, all below 0",
            run["settling_time_2pct"] is not None and max(run["exponents_bits_per_s"]) < 0.0,
            f"This program's verdict is: {run['verdict']}, with a limit of "
            f"{run['asymptotic_bits_per_s'][0]:g}. The design on the perturbed plant has A = "
            f"{run['A']:.4f} s.",
        )
        for k, share, figures, run in ((1, 70, "3.19-3.21", one), (2, 130, "3.22-3.24", two))
    ]
    return [
        *arithmetic,
        *systems,
        Claim(
            "3.5.2.2",
            "the trajectories of the two systems do not differ significantly",
            "qualitative",
            f"x differs by up to {1e3 * t['x_apart']:.1f} mm",
            "within 1 % of the step",
            t["x_apart"] <= 0.01 * SETPOINT,
            f"The perturbed sigma0 gives A = {one['A']:.4f} and {two['A']:.4f} s, so the gains "
            "and the tanh differ. With sigma1 alone perturbed, the two systems differ by "
            f"{1e3 * t['x_apart_sigma0_alone']:.2f} mm. So sigma0 seems to have been left alone "
            "here, as in the tables.",
        ),
    ]


def _printed_cells(t: Figures, coasting: Figures, alone: Vector, both: Vector) -> list[Claim]:
    """The exponents of Tables 3.3 and 3.4, `alone` with the nominal sigma0, and their time."""
    stops = np.array([[c["A"] for c in row] for row in t["both"]])
    off = np.abs(alone / np.array(ROWS) - 1.0)
    middle, centre = PERCENT.index(100), COARSE.index(100)
    by_sigma0 = coasting["stopping_time_by_threshold_and_sigma0"]
    by_sigma1 = coasting["stopping_time_by_threshold_and_sigma1"]
    return [
        Claim(
            "Tables 3.3-3.4",
            "rows: largest exponent by sigma1",
            "-0.0167 to -0.0123 bits/s",
            f"{alone[0]:.5f} to {alone[-1]:.5f} bits/s with sigma0 left alone, t = 300 s",
            "each row within 2 %",
            bool(off.max() <= 0.02),
            f"The rows are below. The largest difference is {100 * off.max():.1f} %, in the row "
            f"{PERCENT[int(off.argmax())]} %. A stopping time of "
            f"{1e3 * t['A_needed'][int(off.argmax())]:.2f} ms instead of "
            f"{1e3 * t['sigma0_alone'][int(off.argmax())]['A']:.2f} ms would give the printed "
            "value "
            f"there. This rests on the threshold of {STOPPED_SPEED:g} m/s. It was chosen so that "
            "the nominal plant has A = 0.1 s.",
        ),
        Claim(
            "3.5.2, Tables 3.3-3.4",
            "time length as in 3.5.1, which is 20 s",
            "20 s",
            f"nominal cell: {t['lambda1_at_20_s']:.4f} bits/s at 20 s, {alone[middle]:.4f} at 300 "
            "s",
            "nominal cell at 20 s within 1 %",
            abs(t["lambda1_at_20_s"] / ROWS[middle] - 1.0) <= 0.01,
            "At rest the largest exponent times time is a constant, "
            f"{t['lambda1_at_20_s'] * STOP:.4f} bits with A = 0.1 s. The printed -0.0134, as "
            f"rounded, is its value at {t['time_of_nominal_cell'][0]:.0f} to "
            f"{t['time_of_nominal_cell'][2]:.0f} s. A time of {t['best_time']:.0f} s "
            "fits all thirteen rows best.",
        ),
        Claim(
            "3.5.2.3, Tables 3.3-3.4",
            "columns: the largest exponent does not depend on sigma0",
            "equal columns",
            f"row 100 %: {both[centre][0]:.4f} at 70 %, {both[centre][centre]:.4f} at 100 %, "
            f"{both[centre][-1]:.4f} at 130 % of sigma0",
            "within 1 %",
            bool(np.ptp(both[centre]) <= 0.01 * abs(both[centre][centre])),
            f"On the perturbed plant the stopping time is {stops[centre][0]:.3f} s at 70 % and "
            f"{stops[centre][-1]:.3f} s at 130 % of sigma0, and the controller follows it. Another "
            "threshold does not change this. The ratio of A at 130 % to A at 70 %, for sigma0 and "
            "for "
            "sigma1, is "
            + "; ".join(
                f"{by_sigma0[v][2] / by_sigma0[v][0]:.4f}, {by_sigma1[v][2] / by_sigma1[v][0]:.4f} "
                f"at {v} m/s"
                for v in by_sigma0
            )
            + ". The printed columns need a ratio of 1. The rows need "
            f"{t['A_needed'][-1] / t['A_needed'][0]:.4f}. The tables fit a sigma0 that was not "
            "perturbed.",
        ),
        Claim(
            "Table 3.3",
            f"row {MISPRINT[0]} %, column {MISPRINT[1]} %",
            f"+{MISPRINT[2]} bits/s",
            f"{both[COARSE.index(MISPRINT[0])][COARSE.index(MISPRINT[1])]:.4f} bits/s; "
            f"{alone[-1]:.4f} with sigma0 left alone",
            "the same sign",
            bool(both[COARSE.index(MISPRINT[0])][COARSE.index(MISPRINT[1])] > 0),
            f"The sign is a misprint. The rest of the row is {ROWS[-1]}, and the text says that "
            "all "
            "are negative.",
        ),
    ]


def _trends(ways: list[Figures], alone: Vector, both: Vector) -> list[Claim]:
    """Statements of Section 3.5.2.3 on the tables."""
    centre = COARSE.index(100)
    quickest = [w["A"] for w in sorted(ways, key=lambda w: w["settling"])]
    lowest = [w["A"] for w in sorted(ways, key=lambda w: w["lambda1"])]
    return [
        Claim(
            "3.5.2.3",
            "all largest exponents are negative",
            "169 cells",
            f"{int((both < 0).sum())} of {both.size} cells negative, {both.min():.4f} to "
            f"{both.max():.4f}",
            "all of the cells computed",
            bool((both < 0).all()),
            "This is at 300 s. In the limit all of them are 0. The verdicts rest on the motion.",
        ),
        Claim(
            "3.5.2.3",
            "the largest exponent rises with sigma1",
            "qualitative",
            f"{alone[0]:.4f} to {alone[-1]:.4f} with sigma0 left alone, "
            f"{both[centre][centre] - both[0][centre]:+.4f} from 70 to 100 %",
            "in every row",
            bool((np.diff(alone) > 0).all()),
        ),
        Claim(
            "3.5.2.3",
            "a larger largest exponent does not mean slower convergence",
            "qualitative",
            "; ".join(
                f"A = {w['A']:g} s: {w['lambda1']:.4f}, settling {w['settling']:.2f} s"
                for w in ways
            ),
            "the order of settling is not that of the exponents",
            quickest != lowest,
            "The exponents here come from the way to rest, divided by the time of the run. They "
            f"vary by a factor of {both.min() / both.max():.1f} over the tables.",
        ),
    ]


def exponent_tables(f: Figures) -> list[str]:
    """Tables 3.3 and 3.4 with the results here."""
    t = f["tables"]
    rows = [
        "| sigma1 | printed (all columns) | here, sigma0 left alone | difference | A [ms] | A "
        "that gives the print [ms] |",
        "|---|---|---|---|---|---|",
    ]
    for percent, printed, cell, needed in zip(
        PERCENT, ROWS, t["sigma0_alone"], t["A_needed"], strict=True
    ):
        rows.append(
            f"| {percent} % | {printed:.4f} | {cell['lambda1']:.5f} | "
            f"{100 * (cell['lambda1'] / printed - 1):+.1f} % | {1e3 * cell['A']:.2f} | "
            f"{1e3 * needed:.2f} |"
        )
    grid = [
        "| sigma1 | " + " | ".join(f"{q} % of sigma0" for q in COARSE) + " |",
        "|---|" + "---|" * len(COARSE),
    ]
    for percent, cells in zip(COARSE, t["both"], strict=True):
        values = " | ".join(f"{c['lambda1']:.4f}" for c in cells)
        grid.append(f"| {percent} % | {values} |")
    return [
        "**Tables 3.3-3.4, rows.** Largest exponent [bits/s] at 300 s:",
        "",
        *rows,
        "",
        "**Tables 3.3-3.4, columns.** The same with both parameters perturbed, as the text says, "
        "at every second row and column:",
        "",
        *grid,
    ]

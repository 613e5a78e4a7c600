"""Questions that the text of the thesis does not answer."""

from __future__ import annotations

from ballscrew.controllers.nctf import STOPPED_SPEED
from thesis.loops import SWING, Figures
from thesis.printed import COARSE, GRID_1, LARGEST_1, ROWS, VARIANTS


def undecided(f: Figures) -> list[str]:
    """Questions that the text of the thesis does not answer."""
    s, t, q = f["spectra"], f["tables"], f["plane"]
    loose, edges = f["loose_solvers"], f["plane"]["edges"]
    swings = loose["systems"]["RK45 0.001 1e-06"]
    ours, true = loose["systems_here"][1], loose["systems_here_true"][1]
    cycles = {
        v: min(x for k, x in edges[v]["cycle_by_sigma0"].items() if float(k) >= 0.0)
        for v in VARIANTS
    }
    low = {v: next(iter(edges[v]["runaway_by_sigma1"].values())) for v in VARIANTS}
    rows = zip(t["sigma0_alone"], ROWS, strict=True)
    worst = max(abs(cell["lambda1"] / printed - 1) for cell, printed in rows)
    return [
        "The thesis' solver, step and tolerances. They are not named. Loose tolerances give the "
        f"swing of 3.5.1.2 ({1e6 * swings[1]['swing']:.0f} um with RK45 at 1e-3 and 1e-6, "
        f"{1e6 * loose['systems']['BDF 0.001 1e-06'][1]['swing']:.2g} um with BDF). They make "
        f"3.5.1.1 swing, too ({1e6 * swings[0]['swing']:.3g} um with RK45). So integration can "
        "have made the swing. This does not show that it did.",
        "Whether x1'' inside Eq. 3.21 comes from the estimates or from the true parameters. "
        f"Offsets in 3.5.1.2 are {1e6 * ours['offset']:.1f} and {1e6 * true['offset']:.1f} um, the "
        "largest exponent of 3.5.1.1 at 300 s "
        f"{s['system_1_estimated_long']['lambda1_at_300_s']:.5f} and "
        f"{s['system_1_true_long']['lambda1_at_300_s']:.5f} bits/s (printed {LARGEST_1}), the "
        f"critical values {low['estimated']:.3f} and {low['true']:.3f} N/m, "
        f"{cycles['estimated']:.3f} and {cycles['true']:.3f} N*s/m. The estimates are nearer each "
        f"time. In the last two the difference is less than the grid of {GRID_1}.",
        "How long the exponents were followed. The text says 20 s; the nominal cell of Table 3.3 "
        f"fits {t['time_of_nominal_cell'][1]:.0f} s, Fig. 3.13 "
        f"{s['system_1_estimated_long']['last_below_printed']:.0f} s.",
        'What counted as "static" in reading A, and how 13.25 was fitted. The threshold of '
        f"{STOPPED_SPEED:g} m/s was chosen to give 0.1 s. It fits the rows within "
        f"{100 * worst:.1f} "
        "%. Another rule may fit as well.",
        "Whether sigma0 was perturbed at all for Tables 3.3-3.4. With it the row 100 % would run "
        f"from {t['both'][COARSE.index(100)][0]['lambda1']:.4f} to "
        f"{t['both'][COARSE.index(100)][-1]['lambda1']:.4f}.",
        "The motor's nominal voltage: 35 V in the text, 36 V in Table 2.1. The NCTF loop's first "
        f"{f['nctf']['voltage_at_start']:.2f} V lie between the two.",
        "The rule by which loops were sorted in Fig. 3.18. Here a loop swings if x moves by more "
        "than "
        f"{1e6 * SWING:g} um to either side in the last two of 20 s. By this rule "
        f"{100 * q['shares']['all']['swings']:.1f} % of the region swing.",
        "What Figs. 3.4-3.24 show beyond the text. The thesis' pictures are not at hand.",
    ]

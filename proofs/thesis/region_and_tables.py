"""Sections 3.5.1.3 and 3.5.2: the region of Fig. 3.18, and Tables 3.3 and 3.4."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ballscrew import component
from ballscrew.controllers.nctf import NctfDesign, design
from thesis import printed as th
from thesis.loops import end_of, figures, growth, largest, scipy_end, spectrum, step
from thesis.rows import Row, near

Inside = Callable[[float, float], bool]


def edge(settled: Callable[[float], bool], good: float, bad: float, width: float) -> float:
    """Value between `good` and `bad` at which `settled` changes to false; NaN without a change."""
    if not settled(good) or settled(bad):
        return math.nan
    while abs(bad - good) > width:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if settled(middle) else (good, middle)
    return 0.5 * (good + bad)


def _runaway(sigma1: float, setpoint: float = th.SETPOINT) -> float:
    """Smallest sigma0_hat at which the loop diverges [N/m]."""

    def ends(s0: float) -> bool:
        return end_of(s0, sigma1, setpoint).kind != "diverges"

    return edge(ends, th.SIGMA0, th.SIGMA0 + 20.0, 5e-4)


def _cycle() -> float:
    """Least sigma1_hat, over sigma0_hat from the nominal one on, below which a loop swings."""
    edges = [
        edge(lambda s1, off=off: end_of(th.SIGMA0 + off, s1).kind == "stands", 347.0, 340.0, 0.005)
        for off in (0.0, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5)
    ]
    return float(np.nanmin(edges))


def grid() -> tuple[Any, Any]:
    """Values of sigma0_hat and sigma1_hat of the 1938 loops of the picture."""
    return np.linspace(*th.REGION[0], 34), np.linspace(*th.REGION[1], 57)


def _share(kind: str, inside: Inside) -> float:
    """Share of the loops inside that end in this way."""
    across, up = grid()
    kinds = [end_of(a, b).kind for b in up for a in across if inside(a, b)]
    return kinds.count(kind) / len(kinds)


def _loose_share(method: str) -> float:
    across, up = np.linspace(*th.REGION[0], 8), np.linspace(*th.REGION[1], 6)
    ends = [scipy_end((a, b), method, 1e-3, 1e-6) for b in up for a in across if a < th.SIGMA0]
    return sum(1e-6 < e.swing < math.inf for e in ends) / len(ends)


def _first_swing() -> float:
    """The least increase of sigma0_hat with which the loop swings, over sigma0."""
    offs = np.arange(0.05, 1.75, 0.05)
    swings = (d for d in offs if end_of(th.SIGMA0 + d, th.SIGMA1).kind == "swings")
    return float(next(swings)) / th.SIGMA0


def _above(a: float, b: float) -> bool:
    return b > th.SIGMA1


WHERE = "3.5.1.3, Fig. 3.18"
PLANE = (
    near(WHERE, "critical sigma0_hat at the least sigma1_hat [N/m]", th.RUNAWAY, th.GRID,
         partial(_runaway, th.REGION[1][0])),
    Row(WHERE, "the same at the largest sigma1_hat [N/m]", "", partial(_runaway, 365.0)),
    Row(WHERE, "the same with a step of 2 cm in place of 8 [N/m]", "",
        partial(_runaway, th.REGION[1][0], 0.02)),
    Row(WHERE, "loops beyond it are unstable: their share", "all",
        partial(_share, "diverges", lambda a, b: a > th.RUNAWAY), (1.0, 1.0)),
    Row(WHERE, "between nominal and critical sigma0_hat fixed points dominate: their share",
        "most", partial(_share, "stands", lambda a, b: th.SIGMA0 <= a < th.RUNAWAY),
        (0.5, 1.0)),
    Row(WHERE, "left of nominal sigma0_hat limit cycles dominate: their share", "most",
        partial(_share, "swings", lambda a, b: a < th.SIGMA0), (0.5, 1.0),
        "They come to rest off the set-point. The next two rows are the shares of a grid of "
        "18 of these loops that a loose solver (1e-3, 1e-6) makes swing."),
    *(
        Row(WHERE, f"the same share by {method}", "", partial(_loose_share, method))
        for method in ("RK45", "BDF")
    ),
    near(WHERE, "critical sigma1_hat [N*s/m]", th.CYCLE, th.GRID, _cycle),
    Row(WHERE, "below it no loop stands: share that does", "0",
        partial(_share, "stands", lambda a, b: b < th.CYCLE), (0.0, 0.0),
        "Right of the nominal sigma0_hat this is true (next row); left of it the loops come "
        "to rest off the set-point, as said above."),
    Row(WHERE, "the same right of the nominal sigma0_hat", "",
        partial(_share, "stands", lambda a, b: a >= th.SIGMA0 and b < th.CYCLE), (0.0, 0.0)),
    Row(WHERE, "above nominal sigma1_hat fixed points and cycles share the area: ratio of "
        "cycles to fixed points", "1",
        lambda: _share("swings", _above) / _share("stands", _above), (0.5, 2.0),
        "The error of a solver can make this difference, too."),
    Row(WHERE, "above nominal sigma1_hat unstable loops are a small part: share", "small",
        partial(_share, "diverges", _above), (0.0, 0.2)),
    Row("3.5.1.3, 3.6", "less than 0.01 % off sigma0 can make a cycle: share off", "1e-4",
        _first_swing, (0.0, 1e-4)),
    Row("3.5.1.3, 3.6", "and instability: share off", "1e-4",
        lambda: _runaway(th.SIGMA1) / th.SIGMA0 - 1.0, (0.0, 1e-4)),
)  # fmt: skip


@cache
def designed(percent0: float, percent1: float) -> NctfDesign:
    """NCTF for a plant with these shares of sigma0 and sigma1."""
    return design({"sigma0": percent0 / 100 * th.SIGMA0, "sigma1": percent1 / 100 * th.SIGMA1})


def _cell(percent0: float, percent1: float) -> float:
    """A cell of Tables 3.3 and 3.4 at 300 s; at rest it falls like 1/t, so 20 s are enough."""
    made = designed(percent0, percent1).parameters()
    return float(growth("nctf", th.STOP, **made)[1][-1]) / th.LONG


def _by_stopping_time(time: float) -> dict[str, float]:
    """The controller by the rule of the printed design for a stopping time [s]."""
    share, own = time / th.PRINTED_A, {p.name: p.default for p in component("nctf").parameters}
    return {"c": th.PRINTED_C / share, "Kp": own["Kp"] * share, "Ki": own["Ki"] * share}


def _needed(exponent: float) -> float:
    def off(time: float) -> float:
        return float(growth("nctf", th.STOP, **_by_stopping_time(time))[1][-1]) - exponent * th.LONG

    return float(brentq(off, 0.09, 0.1022, xtol=1e-5))


def _apart(one: NctfDesign, two: NctfDesign) -> float:
    """Largest difference of x under two controllers, over the step."""
    x = [step("nctf", **made.parameters()).outputs["x"] for made in (one, two)]
    return float(np.max(np.abs(x[0] - x[1]))) / th.SETPOINT


def _order() -> float:
    """Whether the order of settling times of three designs is that of the exponents."""
    ways = [_by_stopping_time(a) for a in (0.08, 0.1, 0.12)]
    settling = [figures("nctf", 10.0, **w)["settling_time_2pct"] for w in ways]
    exponents = [largest("nctf", th.STOP, **w) for w in ways]
    return float((np.argsort(settling) == np.argsort(exponents)).all())


def _largest_of(percent: int) -> float:
    run = spectrum("nctf", th.LONG, **designed(percent, percent).parameters())
    return run.figures()["exponents_bits_per_s"][0]


def _rises() -> float:
    """Least difference of the exponents of adjacent rows, sigma0 left alone [bits/s]."""
    return float(np.diff([_cell(100, p) for p in th.LARGEST_BY_SIGMA1]).min())


SEVEN = [*th.LARGEST_BY_SIGMA1][::2]  # rows, and columns [%]
TABLES = (
    *(
        near(f"3.5.2.{k}", f"{share} % of sigma{n} [{unit}]", printed, 0.005,
             lambda share=share, n=n: share / 100 * (th.SIGMA0, th.SIGMA1)[n])
        for k, share, n, printed, unit in (
            (1, 70, 0, 46877.06, "N/m"), (1, 70, 1, 241.19, "N*s/m"),
            (2, 130, 0, 87057.4, "N/m"), (2, 130, 1, 447.93, "N*s/m"))
    ),
    *(
        Row(f"3.5.2.{k}", f"{share} % of both: all exponents are negative, the largest after "
            "300 s [bits/s]", "below 0", partial(_largest_of, share), (-math.inf, -1e-9))
        for k, share in ((1, 70), (2, 130))
    ),
    Row("3.5.2.2", "these two trajectories do not differ: x apart by, over the step", "0",
        lambda: _apart(designed(70, 70), designed(130, 130)), (0.0, 0.01),
        "The perturbed sigma0 changes A, and with it the gains. With sigma1 alone perturbed (next "
        "row) they differ less. So sigma0 seems to have been left alone, as in the tables."),
    Row("3.5.2.2", "the same with sigma1 alone perturbed", "",
        lambda: _apart(designed(100, 70), designed(100, 130))),
    *(
        near("Tables 3.3-3.4", f"row {p} %, sigma0 left alone, 300 s [bits/s]", printed,
             0.02 * abs(printed), lambda p=p: _cell(100, p))
        for p, printed in th.LARGEST_BY_SIGMA1.items()
    ),
    Row("Tables 3.3-3.4", "stopping time that gives the row 130 % exactly [s]", "",
        lambda: _needed(th.LARGEST_BY_SIGMA1[130])),
    Row("Tables 3.3-3.4", "stopping time of the design for that row [s]", "",
        lambda: designed(100, 130).stopping_time),
    near("3.5.2, Tables 3.3-3.4", "the nominal cell at the 20 s of 3.5.1 [bits/s]", -0.0134,
         1.3e-4, lambda: th.LONG / th.STOP * _cell(100, 100),
         "At rest the largest exponent times time is a constant; the rows fit 300 s."),
    Row("3.5.2.3, Tables 3.3-3.4", "columns alike: the cell at 70 % of sigma0 over that at "
        "100 %", "1", lambda: _cell(70, 100) / _cell(100, 100), (0.99, 1.01),
        "On the perturbed plant the stopping time is another one, and the controller follows "
        "it. Another threshold of A does not change this. The tables fit a sigma0 that was "
        "not perturbed."),
    Row("Table 3.3", "row 130 %, column 90 % [bits/s]", 0.0123, partial(_cell, 90, 130),
        (1e-9, math.inf), "The sign is a misprint: the rest of its row is -0.0123, and the "
        "text says that all are negative."),
    Row("3.5.2.3", "all largest exponents are negative: the largest of 49 cells [bits/s]",
        "below 0", lambda: max(_cell(q, p) for q in SEVEN for p in SEVEN), (-math.inf, -1e-9)),
    Row("3.5.2.3", "the largest exponent rises with sigma1: least rise from row to row "
        "[bits/s]", "above 0", _rises, (1e-9, math.inf)),
    Row("3.5.2.3", "a larger exponent does not mean slower convergence: whether both orders "
        "of three designs are alike (1) or not (0)", "0", _order, (0.0, 0.0)),
)  # fmt: skip

SECTIONS = {"F": PLANE, "G": TABLES}

"""The long-term motion of Van der Pol's oscillator."""

from __future__ import annotations

from typing import Any

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding, exponents, motion

OSCILLATOR = part(__file__, "van_der_pol")
TABLE = "VanDerPol_ref.csv of the Reference-FMUs"
EULER = "their table is explicit Euler in steps of 0.01 s; with it we get the same digits"


def findings() -> list[Finding]:
    x = motion(OSCILLATOR, 20.0, 0.01).outputs["x"][-1]
    found, weak = (exponents(OSCILLATOR, 40.0, {"mu": mu}).motion for mu in (1.0, 0.1))
    swing, scipy = found.amplitude["plant_x"], "DOP853 of SciPy gives the same to 1e-8"
    mean = "the mean of mu (1 - x^2) over a period, by quadrature"
    averaging = "averaging over a period gives -mu, without terms in mu^3"
    second, slow = float(found.limit[1]), float(weak.limit[1])
    return [
        Finding("x at 20 s, mu = 1", float(x), "1", TABLE, 2.01484, 1e-5, EULER),
        Finding("swing of x in the cycle, mu = 1", swing, "1", TABLE, 2.02778, 1e-5, EULER),
        Finding("period, mu = 1", found.period or 0.0, "s", scipy),
        Finding("second exponent, mu = 1 [nats/s]", second, "1/s", mean),
        Finding("second exponent, mu = 0.1 [nats/s]", slow, "1/s", averaging),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (phase, course)):
        for k, mu in enumerate((0.1, 1.0, 4.0)):
            start = {"mu": mu, "x_start": 0.1 if mu < 1 else 2.0}
            run = motion(OSCILLATOR, 60.0, 0.01, start)
            style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": f"mu = {mu:g}"}
            phase.plot(run.outputs["x"], run.outputs["v"], **style)
            shown = run.time <= 20.0
            course.plot(run.time[shown], run.outputs["x"][shown], **style)
        phase.set(xlabel="x", ylabel="v [1/s]", title="Every motion ends in the same cycle")
        course.set(xlabel="time [s]", ylabel="x", title="Its swing stays 2 while its shape changes")
        figure.legend(*phase.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure

"""The long-term motion of Van der Pol's oscillator."""

from __future__ import annotations

from functools import cache
from typing import Any

import ballscrew

from ..drawing import COLOURS, DASHES, drawing, part
from ..finding import Finding

OSCILLATOR = part(__file__, "van_der_pol")
TABLE = "VanDerPol_ref.csv of the Reference-FMUs"
EULER = "their table is explicit Euler in steps of 0.01 s; with it we get the same digits"


@cache
def motion(mu: float, stop: float, start: float = 2.0) -> Any:
    """The motion from (start, 0)."""
    return ballscrew.run(
        "none",
        OSCILLATOR,
        stop=stop,
        step=0.01,
        coupling=ballscrew.Coupling("monolithic"),
        plant_values={"mu": mu, "x_start": start},
    )


@cache
def exponents(mu: float) -> Any:
    return ballscrew.lyapunov("none", OSCILLATOR, stop=40.0, plant_values={"mu": mu})


def findings() -> list[Finding]:
    run = motion(1.0, 20.0).run
    found = exponents(1.0)
    weak = exponents(0.1)
    scipy = "DOP853 of SciPy gives the same to 1e-8"
    return [
        Finding("x at 20 s, mu = 1", float(run.outputs["x"][-1]), "1", TABLE, 2.01484, 1e-5, EULER),
        Finding(
            "swing of x in the cycle, mu = 1",
            found.motion.amplitude["plant_x"],
            "1",
            TABLE,
            2.02778,
            1e-5,
            EULER,
        ),
        Finding("period, mu = 1", found.motion.period or 0.0, "s", scipy),
        Finding(
            "second exponent, mu = 1 [nats/s]",
            float(found.motion.limit[1]),
            "1/s",
            "the mean of mu (1 - x^2) over a period, by quadrature",
        ),
        Finding(
            "second exponent, mu = 0.1 [nats/s]",
            float(weak.motion.limit[1]),
            "1/s",
            "averaging over a period gives -mu, without terms in mu^3",
        ),
    ]


def picture() -> Any:
    with drawing(2) as (figure, (phase, course)):
        for k, mu in enumerate((0.1, 1.0, 4.0)):
            run = motion(mu, 60.0, 0.1 if mu < 1 else 2.0).run
            style = {"color": COLOURS[k], "ls": DASHES[k], "lw": 1.4, "label": f"mu = {mu:g}"}
            phase.plot(run.outputs["x"], run.outputs["v"], **style)
            shown = run.time <= 20.0
            course.plot(run.time[shown], run.outputs["x"][shown], **style)
        phase.set(xlabel="x", ylabel="v [1/s]", title="Every motion ends in the same cycle")
        course.set(xlabel="time [s]", ylabel="x", title="Its swing stays 2 while its shape changes")
        figure.legend(*phase.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure

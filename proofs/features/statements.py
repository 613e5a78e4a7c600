"""Statements of the thesis on several laws, each with its number here."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .criteria import (
    LAG_DEVIATION,
    MEASURED_BREAK_AWAY,
    RATE_DEVIATION,
    Cell,
    rise_time,
)
from .observations import Observations


@dataclass(frozen=True)
class NamedFigure:
    """A number of the thesis for LuGre, and the result of the same comparison here.

    Attributes
    ----------
    thesis, here : float or None
        Shares; None if the text does not give the measured quantity.
    """

    what: str
    thesis: float
    here: float | None
    words: str
    values: dict[str, float] = field(default_factory=dict)


def named_figures(cells: dict[str, Cell], seen: Observations) -> list[NamedFigure]:
    """The largest deviations given in the thesis, for the cells of LuGre."""
    deviations = cells["breakaway_force"].figures
    largest = max(abs(deviations[f"deviation_{k}"]) for k in MEASURED_BREAK_AWAY)
    nominal = seen.parameters["Fs"] / MEASURED_BREAK_AWAY["forwards"] - 1
    friction = cells["friction_lag"].figures["friction_at_0.5_mm_per_s"]
    fastest = cells["varying_breakaway_force"].figures["fastest"]
    return [
        NamedFigure(
            "break-away force, Section 2.4.2",
            0.05,
            largest,
            f"'about 5 %'; Fs alone is {nominal:.1%} above the measured 2.2 N, and what the "
            f"loaded rig shows {largest:.1%}",
            {"Fs_over_measured": nominal},
        ),
        _implied("friction lag at 0.5 mm/s, Section 2.4.4", LAG_DEVIATION, friction),
        _implied("break-away at 20.3 N/s, Section 2.4.5", RATE_DEVIATION, fastest),
    ]


def _implied(what: str, deviation: float, predicted: float) -> NamedFigure:
    low, high = predicted / (1 + deviation), predicted / (1 - deviation)
    return NamedFigure(
        what,
        deviation,
        None,
        f"predicted here: {predicted:.3f} N; the measured value is not printed, and would have "
        f"been {low:.3f} or {high:.3f} N",
        {"predicted": predicted, "measured_if_below": low, "measured_if_above": high},
    )


def statements(cells: dict[str, dict[str, Cell]], seen: dict[str, Observations]) -> list[str]:
    """Statements of the thesis on several laws, each with its number here."""
    found = []
    if {"lugre", "classical"} <= set(cells):
        lugre, classical = seen["lugre"].forwards.force, seen["classical"].forwards.force
        if lugre is not None and classical is not None:
            found.append(
                "LuGre and the classical law 'reproduce the identical break-away force' (2.4.2): "
                f"{lugre:.4f} and {classical:.4f} N"
            )
    if "lugre" in cells:
        peaks = seen["lugre"].rate_peaks
        found.append(
            "LuGre's break-away force 'won't enter the open interval (-Fc, Fc)' (2.4.5): the least "
            f"is {np.nanmin(peaks):.3f} N, Fc {seen['lugre'].parameters['Fc']:.3f} N"
        )
    if {"lugre", "dahl"} <= set(cells):
        deviations = {
            law: max(c.measure for c in cells[law]["presliding"].checks)
            for law in ("lugre", "dahl")
        }
        order = "and so would" if deviations["dahl"] < deviations["lugre"] else "but not"
        found.append(
            "LuGre 'highly agrees' in presliding, Dahl does not 'capture the magnitude' (2.4.6): "
            f"with the identified parameters LuGre is up to {deviations['lugre']:.0%} off, Dahl up "
            f"to {deviations['dahl']:.0%}; with a threshold at LuGre's largest, it would pass, "
            f"{order} Dahl"
        )
        rises = {law: rise_time(seen[law].step) for law in ("lugre", "dahl")}
        found.append(
            "Dahl follows a step with a 'slow transient response' (Fig. 2.19): from 10 to 90 % in "
            f"{1e3 * rises['dahl']:.0f} ms, LuGre in {1e3 * rises['lugre']:.0f} ms on the same "
            "rig, where the motor's back-EMF damps both"
        )
    return found

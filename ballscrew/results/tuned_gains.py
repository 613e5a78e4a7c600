"""Gains of one controller that were tuned for one machine."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..orchestration.linear_loop import Margins
from ..orchestration.tune import TunedController
from .result import Result, table_of


@dataclass(frozen=True, repr=False)
class TunedGains(Result, TunedController):
    """Gains of one controller for one machine; see `ballscrew.tune`."""

    @property
    def values(self) -> dict[str, float]:
        """The gains by name."""
        return {g.name: g.value for g in self.gains}

    def figures(self) -> dict[str, Any]:
        """What ``tuning.json`` holds."""
        return self.to_dict()

    def pictures(self) -> dict[str, Any]:
        from ..orchestration.tune_pictures import bode_figure, motions_figure

        pictures = {"motions": motions_figure(self)}
        return {**pictures, "bode": bode_figure(self)} if self.margins else pictures

    def headline(self) -> str:
        judged = self.motions[-1].figures
        said = [
            f"{self.loop.title}: on a motion not used for tuning, the error is "
            f"{_length(judged.rms_error)} rms and {_length(judged.peak_error)} at most"
        ]
        said += [_margins(m) for m in self.margins]
        said += self.no_margins
        weak = self.weaknesses
        return "; ".join(said) + (f". Limitations: {', '.join(weak)}" if weak else "")

    def facts(self) -> Iterable[tuple[str, str]]:
        for g in self.gains:
            text = f"{g.value:.6g} {g.unit} (searched {g.low:.3g} to {g.high:.3g})"
            yield g.name, text
        for m in self.motions:
            f = m.figures
            turn = "" if math.isnan(f.reversal_error) else f", {_length(f.reversal_error)} at turns"
            yield (
                m.name,
                f"{_length(f.rms_error)} rms, {_length(f.peak_error)} at most{turn}; command "
                f"{m.peak_command:.4g} of {self.limit:g} {self.command_unit}",
            )

    def to_pandas(self) -> Any:
        """A row for each gain."""
        return table_of([vars(g) for g in self.gains], "name")


def _length(value: float) -> str:
    """A length in a readable unit."""
    return f"{1e6 * value:.3g} um" if abs(value) < 1e-3 else f"{1e3 * value:.3g} mm"


def _margins(m: Margins) -> str:
    state = f"sliding at {m.speed:g} m/s" if m.speed else "stuck"
    if not m.stable:
        return f"{state}: unstable"
    gain = "no end" if math.isinf(m.gain_margin) else f"{m.gain_margin:.3g}"
    phase = "none, its gain stays below one"
    if not math.isnan(m.phase_margin):
        phase = f"{m.phase_margin:.3g} degrees at {m.crossover:.3g} Hz"
    return f"{state}: gain margin {gain}, phase margin {phase}, Ms {m.sensitivity:.3g}"

"""Identification of a friction law: its result and its files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...orchestration.loop.parameter_file import DRIVE, ParameterFile, Value
from ...plant.law import law as friction_law
from ...solver.component import symbol
from ...solver.files import write_json
from ..records.record import Record
from .fitted_law import OFFSET
from .identifiability import BACKWARDS, FORWARDS
from .intervals import Fit, Interval
from .layout import StackedRecords
from .left_over import LeftOver

SIDES = {FORWARDS: "_pos", BACKWARDS: "_neg"}


@dataclass(frozen=True)
class Identification:
    """Result of an identification; `parameters` are by our estimator on all records."""

    law: str
    records: tuple[Record, ...]  # corrected by `time_shift` if it is larger than known before
    parameters: dict[str, Interval]  # of the law, and mass and offset if requested
    # forwards and backwards, with the offset of `parameters`; empty for one direction
    per_direction: dict[str, dict[str, Interval]]
    fit: Fit
    course: StackedRecords
    left: LeftOver  # residual of the force beyond its noise, and its parts
    time_shift: Interval | None  # of the force after the motion [s]; None: the law does not fit
    warnings: tuple[str, ...]  # why it is not trusted
    notes: tuple[str, ...]
    file: ParameterFile | None = None  # prior values, for the result's parameter file
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def unexplained(self) -> float:
        """Root mean square residual of the force, without its noise [N]."""
        return self.left.force

    @property
    def held_out(self) -> float:
        """Fit on data held out [%]; 100 is a perfect one, 0 that of a constant force."""
        return 100.0 * self.fit.share(self.course.force)

    @property
    def trusted(self) -> bool:
        return not self.warnings

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            "law": self.law,
            "records": [r.name for r in self.records],
            "record_notes": {r.name: list(r.notes) for r in self.records},
            "parameters": _told(self.parameters),
            "per_direction": {s: _told(table) for s, table in self.per_direction.items()},
            "delay_of_force_s": [float(d) for d in self.fit.delays],
            "load_cell_noise_N": self.fit.noise,
            "unexplained_force_N": self.unexplained,
            "unexplained_force_goes_with": [asdict(p) for p in self.left.parts],
            "fit_on_held_out_data_percent": self.held_out,
            "time_shift_s": asdict(self.time_shift) if self.time_shift else None,
            "trusted": self.trusted,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def parameter_file(self) -> ParameterFile:
        """The law's values with their intervals, and other values from `file`.

        A parameter that is not identified has the value of `file`, else the estimate with its wide
        interval, and is listed in a table with the reason.
        """
        given = self.file or ParameterFile()
        names = ", ".join(r.name for r in self.records)
        replaced = _of_law(given.law) if given.law != self.law else {}
        known = {n: v for n, v in given.plant.items() if n not in replaced}
        values = _of_law(self.law) | known
        for name, i in self.parameters.items():
            if name == OFFSET and given.kind != DRIVE:
                continue
            held = name in self.fixed
            if name not in known or (i.identified and not (held and known[name].value == i.value)):
                source = f"{'' if i.identified else 'an estimate, not '}identified from {names}"
                low = min(-math.inf if i.low is None else i.low, i.value)
                bounds = low, max(math.inf if i.high is None else i.high, i.value)
                said = (None, "given, held") if held else (bounds, source)
                values[name] = Value(i.value, i.unit, *said)
        reasons = {n: i.because for n, i in self.parameters.items() if not i.identified}
        new = replace(given, path=None, law=self.law, plant=values, not_identified=reasons)
        return replace(new, found={}, diagnosis=None).turning()

    def save(self, folder: Path | str) -> None:
        """Write ``identified.json``, and ``parameters.toml`` into `folder`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "identified.json", self.to_dict())
        self.parameter_file().save(folder)


def _told(table: Mapping[str, Interval]) -> dict[str, Any]:
    return {n: asdict(i) for n, i in table.items()}


def _of_law(name: str) -> dict[str, Value]:
    """The parameters of a law, not fitted; none without a law."""
    own = friction_law(name)(symbol("v")).parameters if name else ()
    return {p.name: Value(p.default, p.unit, None, f"{p.source}, not fitted") for p in own}

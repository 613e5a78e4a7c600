"""Whether records can carry a diagnosis, and what of them is doubtful."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .bad_record import BadRecord
from .drive_record import DriveRecord

Vector = npt.NDArray[np.float64]

_CLIPPED = 0.02  # of the samples at the largest value


def check_tellable(records: Sequence[DriveRecord]) -> list[str]:
    """Doubts of what records can tell.

    Raises
    ------
    BadRecord
        If they cannot carry a diagnosis at all.
    """
    notes = []
    channels = {tuple(sorted(set(r.signals) & {"i"})) for r in records}
    if len(channels) > 1:
        raise BadRecord("some records have the current `i` and some not; diagnose them apart")
    for record in records:
        x, u = record.x, record.u
        if np.ptp(x) == 0:
            raise BadRecord(
                f"{record.name}: the position never changes ({x[0]:.6g} m): a drive that does not "
                "move says nothing of its friction; record a motion both ways"
            )
        if np.ptp(u) == 0 and u[0] == 0:
            raise BadRecord(f"{record.name}: the command u is zero all the time")
        for column in ("u", "i"):
            if column in record.signals:
                share = _clipped(record.signals[column])
                if share > _CLIPPED:
                    notes.append(
                        f"{record.name}: {column} is at its largest value in {100 * share:.0f} % "
                        "of the samples: clipped? What was cut off tells nothing"
                    )
        smooth_x = np.convolve(x, np.ones(21) / 21, "valid")
        pace = np.diff(smooth_x)
        if not (
            np.any(pace > 0.05 * np.abs(pace).max()) and np.any(pace < -0.05 * np.abs(pace).max())
        ):
            notes.append(
                f"{record.name}: moves one way only: whatever shows at reversals, or differs by "
                "direction, cannot be told from a constant force"
            )
    return notes


def _clipped(values: Vector) -> float:
    """Share of the samples at the extremes, beyond what a smooth top would have."""
    largest = np.nanmax(np.abs(values))
    return float(np.mean(np.abs(values) >= largest * (1 - 1e-9))) if largest > 0 else 0.0

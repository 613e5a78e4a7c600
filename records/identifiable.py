"""Whether several records can be used for one diagnosis, and warnings about them."""

from __future__ import annotations

from collections.abc import Sequence

from .bad_record import BadRecord
from .examine import examine
from .record import Record


def check_identifiable(records: Sequence[Record]) -> list[str]:
    """Warnings about the information in records.

    Raises
    ------
    BadRecord
        If they cannot be used for a diagnosis.
    """
    channels = {tuple(sorted(set(r.signals) & {"i"})) for r in records}
    if len(channels) > 1:
        raise BadRecord(
            "some records have the current `i` and some do not; diagnose them separately"
        )
    return [note for record in records for note in examine(record).notes]

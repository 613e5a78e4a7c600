"""Status numbers of calls of an FMU, in FMI 2.0 and 3.0."""

from __future__ import annotations

OK, DISCARD, ERROR, FATAL = 1, 2, 3, 4  # a warning counts as OK


class Refused(RuntimeError):
    """An FMU rejected a call.

    Attributes
    ----------
    status : int
        FMI's.
    """

    def __init__(self, message: str, status: int = ERROR) -> None:
        super().__init__(message)
        self.status = status

"""The error for files that cannot be used as measured data."""


class BadRecord(ValueError):
    """The file cannot be used as a record; the message says where, why and what to do."""

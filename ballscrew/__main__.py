"""The command's first moments: from here on, an interrupt is met with one line."""

import io
import os
import sys

from .orchestration.operating_system import can_supervise, hold_interrupts


class _Errors(io.FileIO):
    """Standard error, which nobody has to hear: no result is lost since it was closed."""

    def write(self, data):  # type: ignore[no-untyped-def]
        try:
            return super().write(data)
        except OSError:
            return len(data)


def _open_streams() -> None:
    """Take the place of streams that are closed, or a file of results would be written to."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.platform == "win32":  # whose consoles are no files, and whose files have an old encoding
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.reconfigure(encoding="utf-8")
        return
    errors = io.BufferedWriter(_Errors(2, "w", closefd=False))
    encoding = getattr(sys.stderr, "encoding", None)
    sys.stderr = io.TextIOWrapper(
        errors, encoding, "backslashreplace", line_buffering=True, write_through=True
    )


def _command() -> int:
    try:
        from .cli import main as command
    except Exception as error:
        from .console import complain_of_ourselves

        return complain_of_ourselves(error)
    return command()


def main() -> int:
    """Run the command, supervised where the system can, and return its exit code."""
    _open_streams()
    if can_supervise():
        hold_interrupts()  # until somebody can answer
    from .supervision import supervised

    return supervised(_command)


if __name__ == "__main__":
    sys.exit(main())

"""Start of the command: from here on, an interrupt prints one line."""

import atexit
import gc
import io
import os
import sys
import warnings

from .orchestration.fmu.operating_system import can_supervise, hold_interrupts


class _Errors(io.FileIO):
    """Standard error; if it was closed, no result is lost."""

    def write(self, data):  # type: ignore[no-untyped-def]
        try:
            return super().write(data)
        except OSError:
            return len(data)


def _open_streams() -> None:
    """Replace closed streams; otherwise their output would go into a file of results."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.platform == "win32":  # where a console is not a file, and files have an old encoding
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
    """Run the command, supervised where the system supports it, and return its exit code."""
    _open_streams()
    gc.set_threshold(100_000, 50, 50)  # a look at all objects after each 700 takes a tenth
    atexit.register(gc.freeze)  # and so does the last one, before the process ends
    warnings.simplefilter("ignore", RuntimeWarning)  # NumPy's, of what verdict or notes tell
    if can_supervise():
        hold_interrupts()  # until a handler exists
    from .supervision import supervised

    return supervised(_command)


if __name__ == "__main__":
    sys.exit(main())

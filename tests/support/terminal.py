"""Commands whose standard error is a terminal."""

import os
import pty
import select
import subprocess
import termios


def in_terminal(words: list[str], columns: int = 100) -> tuple[int, str]:
    """The exit code of a command, and what it writes on a terminal that is its standard error.

    Our end of the terminal's other side stays open until all is read: some systems lose what
    is not read yet when the last process closes it.
    """
    ours, theirs = pty.openpty()
    try:
        termios.tcsetwinsize(theirs, (24, columns))
        said = b""
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=theirs) as process:
            ended = False
            while not ended:
                ended = process.poll() is not None  # then what is there now is all
                while select.select([ours], [], [], 0 if ended else 0.05)[0]:
                    said += os.read(ours, 4096)
    finally:
        os.close(ours)
        os.close(theirs)
    return process.returncode, said.decode()

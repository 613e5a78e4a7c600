"""Commands whose standard error is a terminal."""

import os
import pty
import select
import subprocess
import termios


def in_terminal(words: list[str]) -> tuple[int, str]:
    """The exit code of a command, and what it writes on its standard error, a terminal.

    The terminal has 100 columns. It is kept open here until all is read: when the last process
    closes it, some systems lose what is not read yet.
    """
    ours, theirs = pty.openpty()
    try:
        termios.tcsetwinsize(theirs, (24, 100))
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

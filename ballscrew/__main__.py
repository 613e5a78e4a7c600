"""The command's first moments: from here on, an interrupt is met with one line."""

import signal
import sys


def main() -> int:
    """Run the command, supervised where the system can, and return its exit code."""
    if not sys.platform.startswith("linux"):
        from .cli import main as command

        return command()
    signals = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) != signal.SIG_IGN]
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)  # they wait until somebody can answer
    from .supervision import supervised

    return supervised()


if __name__ == "__main__":
    sys.exit(main())

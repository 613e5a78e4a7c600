"""What a command prints: names in a third party's file cannot move a cursor or colour it."""

from __future__ import annotations

from typing import TextIO

# control characters but the end of a line and the tabulator; marks that turn the order of letters
_OBEYED = {*range(0x20), *range(0x7F, 0xA0)} - {0x09, 0x0A}
_OBEYED |= {0x061C, *range(0x200E, 0x2010), *range(0x2028, 0x202F), *range(0x2066, 0x206A)}
_WRITTEN = {code: ascii(chr(code))[1:-1] for code in _OBEYED}


def printable(text: str) -> str:
    """A text with what a terminal would obey written as Python has it, as ``\\x1b``."""
    return text.translate(_WRITTEN)


class Printable:
    """A stream that writes `printable` text, and is the stream in all else."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        self._stream.write(printable(text))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


def unchanged(stream: TextIO) -> TextIO:
    """The stream below `Printable`, for what moves the cursor on purpose."""
    return stream._stream if isinstance(stream, Printable) else stream

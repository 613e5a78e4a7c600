"""Text in newtons and metres about a rotating body, converted to its own units.

Records of such a body are read with a travel of 2 pi per turn, so that a metre is exactly a radian
and a newton is exactly a newton metre: only the words differ.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from .parameter_file import TURNS

_WORDS = {
    "N": "N*m",
    "kg": "kg*m^2",
    "m": "rad",
    "mm": "mrad",
    "um": "urad",
    "µm": "µrad",
    "nm": "nrad",
}
# after a number or in brackets, or alone in its column, but not within a word or a file's name
_UNIT = re.compile(
    r"(?:(?<=[\d)%*] )|(?<=  )|(?<=\[))"
    r"(?:[1NVA](?:\*s)?/(?:m|mm)(?:\^2)?|(?:kg|N|mm|um|µm|nm|m)(?:/s(?:\^2)?)?)(?=$|[\s,;.:)\]])",
    re.MULTILINE,
)
_MASS = re.compile(r"(?:^|(?<=\bof ))m\b(?= {2,}| [\d(])", re.MULTILINE)


def in_turning_units(text: str) -> str:
    """Lines for a reader with N*m for N, rad for m and kg*m^2 for kg; the mass m is J.

    Numbers are before their units, with one space between.
    """
    units = _UNIT.sub(lambda unit: re.sub("[A-Za-zµ]+", _word, unit[0]), text)
    return _MASS.sub("J", units)


def page_in_turning_units(page: str) -> str:
    """`in_turning_units` of what a page of HTML shows; scripts, styles and tags stay."""
    kept = re.split(r"(<(script|style)\b.*?</\2>|<[^>]*>)", page, flags=re.DOTALL)
    return "".join(
        part if number % 3 else "J" if part == "m" else in_turning_units(part)
        for number, part in enumerate(kept)
        if number % 3 != 2  # the tag's name, repeated
    )


def _word(word: re.Match[str]) -> str:
    return _WORDS.get(word[0], word[0])


def words_for(notes: Sequence[str]) -> Callable[[str], str]:
    """The conversion of lines for a reader: to N*m and rad if `notes` say that the body turns."""
    return in_turning_units if TURNS in notes else str

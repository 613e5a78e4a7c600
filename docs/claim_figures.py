"""How a figure on a page is taken from a stored proof: a small language, and no code."""

from __future__ import annotations

import re
import statistics
from collections.abc import Callable
from typing import Any

WORDS = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen"
).split()
FUNCTIONS: dict[str | None, Callable[[list[Any]], Any]] = {
    None: lambda found: found[0], "len": len, "max": max, "min": min, "sum": sum,
    "median": statistics.median, "list": lambda found: ", ".join(found) or "nothing",
}  # fmt: skip
TERM = re.compile(r"(?:(-?[\d.e+-]+) \* )?(?:(len|max|min|sum|median|list) )?(/.+)")


def at(report: Any, pointer: str) -> list[Any]:
    """What a JSON pointer leads to; ``*`` is each member, ``[a==b, c==d]`` those that fit."""
    found = [report]
    for part in re.findall(r"/(\[[^]]*\]|[^/]+)", pointer):
        if part == "*" or part[0] == "[":
            wanted = [pair.split("==") for pair in part[1:-1].split(", ")] if part != "*" else []
            members = [x for f in found for x in (f.values() if isinstance(f, dict) else f)]
            found = [m for m in members if all(str(m.get(k)) == v for k, v in wanted)]
        else:
            key = part.replace("~1", "/")
            found = [f[int(key)] if isinstance(f, list) else f[key] for f in found]
    return found


def term(text: str, report: Any) -> Any:
    """``[NUMBER *] [FUNCTION] POINTER``, or a number."""
    match = TERM.fullmatch(text)
    if match is None:
        return float(text)
    factor, function, pointer = match.groups()
    found = at(report, pointer)
    if function and not re.search(r"/[*\[]", pointer):
        (found,) = found  # a list of the file itself
    value = FUNCTIONS[function](found)
    return value * float(factor) if factor else value


def figure(expression: str, report: Any) -> str:
    """What has to stand on the page: ``TERM [+ TERM ...] [per TERM] [| FORMAT]``.

    The format is Python's, with ``_`` for blanks between thousands from 10 000 on; ``word`` and
    ``Word`` write a small number in words; ``none``, ``None`` and ``no`` are these words for zero.
    """
    terms, _, form = expression.partition(" | ")
    above, _, below = terms.partition(" per ")
    value, *more = (term(t, report) for t in above.split(" + "))
    for other in more:
        value += other
    if below:
        value /= term(below, report)
    if form.lower() in ("none", "no"):
        return form if value == 0 else str(value)
    if isinstance(value, str):
        return value
    if form.lower() == "word":
        return WORDS[round(value)].capitalize() if form == "Word" else WORDS[round(value)]
    form = form if abs(value) >= 1e4 else form.replace("_", "")
    return re.sub(r"e\+?(-?)0*(\d)", r"e\1\2", format(value, form).replace("_", " "))

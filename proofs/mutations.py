"""Damaged and hostile FMUs and systems: one mutation of a good file per seed."""

from __future__ import annotations

import io
import random
import re
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass

HOSTILE_NAMES = (
    "../escaped.txt",
    "/tmp/ballscrew-escaped.txt",
    "a/../../escaped.txt",
    "..\\escaped.txt",
    "C:escaped.txt",
    "C:\\escaped.txt",
    "resources/../../escaped.txt",
    "x" * 5000,
    "binaries",
    "modelDescription.xml/",
    "modelDescription.xml/inside",
    "a\x00b",
    ".",
    "..",
    "/",
    "",
    "con\udcffname".encode("utf-8", "replace").decode(),
)
HOSTILE_VALUES = (
    "",
    "nan",
    "inf",
    "-1e999",
    "-1",
    "0",
    "1e308",
    str(10**30),
    "true",
    "../../escaped",
    "/etc/passwd",
    "\U0001d54f \u202e",
    "%s%s%n",
    "x" * 10_000,
    "&bomb;",
    "&outside;",
)
ENTITIES = (
    '<!DOCTYPE d [<!ENTITY a "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaa">'
    + "".join(f'<!ENTITY {c} "{f"&{p};" * 30}">' for p, c in zip("abcdefg", "bcdefgh", strict=True))
    + '<!ENTITY bomb "&h;&h;"><!ENTITY outside SYSTEM "file:///etc/passwd">]>'
)


@dataclass(frozen=True)
class Mutation:
    """Description of a mutation, and the resulting bytes."""

    kind: str
    data: bytes


def mutated(good: bytes, description: str, seed: int) -> Mutation:
    """Return an archive damaged in one of many ways.

    Parameters
    ----------
    good : bytes
        A zip file that is accepted.
    description : str
        Name of its main XML file.
    seed : int
        The same seed gives the same damage.
    """
    chance = random.Random(seed)
    kinds: list[tuple[str, Callable[[], bytes]]] = [
        ("bytes of the file", lambda: _bytes(good, chance)),
        ("an entry's name", lambda: _renamed(good, chance)),
        ("an entry left out", lambda: _without(good, chance)),
        ("an entry's content", lambda: _entry(good, chance)),
        ("an entry added", lambda: _added(good, chance)),
        *[
            ("the description", lambda: _described(good, description, chance)),
        ]
        * 5,
    ]
    kind, make = chance.choice(kinds)
    return Mutation(kind, make())


def _bytes(data: bytes, chance: random.Random) -> bytes:
    """Flip, cut, repeat, blank or insert."""
    text = bytearray(data)
    for _ in range(chance.choice((1, 1, 5, 50))):
        at = chance.randrange(len(text) or 1)
        much = chance.choice((1, 4, 64, 4096))
        how = chance.randrange(5)
        if how == 0 and text:
            text[at] ^= 1 << chance.randrange(8)
        elif how == 1:
            del text[at : at + much]
        elif how == 2:
            text[at:at] = text[at : at + much]
        elif how == 3:
            text[at : at + much] = bytes(len(text[at : at + much]))
        else:
            text[at:at] = chance.randbytes(much)
    return bytes(text[: chance.randrange(len(text) + 1)] if chance.random() < 0.1 else text)


def _rewritten(data: bytes, change: Callable[[list[tuple[str, bytes]]], None]) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = [(n, archive.read(n)) for n in archive.namelist()]
    change(entries)
    stream = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(stream, "w") as archive:
        warnings.simplefilter("ignore")  # two entries of one name are intended
        for name, content in entries:
            entry = zipfile.ZipInfo("x")
            entry.filename = name  # not by the constructor, which corrects some names
            archive.writestr(entry, content)
    return stream.getvalue()


def _renamed(data: bytes, chance: random.Random) -> bytes:
    def change(entries: list[tuple[str, bytes]]) -> None:
        k = chance.randrange(len(entries))
        other = chance.choice(entries)[0]
        entries[k] = (chance.choice((*HOSTILE_NAMES, other)), entries[k][1])

    return _rewritten(data, change)


def _without(data: bytes, chance: random.Random) -> bytes:
    def change(entries: list[tuple[str, bytes]]) -> None:
        del entries[chance.randrange(len(entries))]

    return _rewritten(data, change)


def _entry(data: bytes, chance: random.Random) -> bytes:
    def change(entries: list[tuple[str, bytes]]) -> None:
        k = chance.randrange(len(entries))
        entries[k] = (entries[k][0], _bytes(entries[k][1], chance))

    return _rewritten(data, change)


def _added(data: bytes, chance: random.Random) -> bytes:
    def change(entries: list[tuple[str, bytes]]) -> None:
        entries.insert(chance.randrange(len(entries) + 1), (chance.choice(HOSTILE_NAMES), b"evil"))

    return _rewritten(data, change)


def _described(data: bytes, description: str, chance: random.Random) -> bytes:
    def change(entries: list[tuple[str, bytes]]) -> None:
        k = next(k for k, (name, _) in enumerate(entries) if name == description)
        text = entries[k][1].decode("utf-8")
        for _ in range(chance.choice((1, 1, 2, 5))):
            text = _xml(text, chance)
        encoding = chance.choice(("utf-8",) * 8 + ("utf-16", "latin-1"))
        entries[k] = (description, text.encode(encoding, "replace"))

    return _rewritten(data, change)


def _xml(text: str, chance: random.Random) -> str:
    """Change one attribute or element, or the document's frame."""
    attributes = list(re.finditer(r'\s([\w:]+)="([^"]*)"', text))
    tags = list(re.finditer(r"<[^<>]*>", text))
    how = chance.randrange(8)
    if how <= 2 and attributes:
        found = chance.choice(attributes)
        value = chance.choice((*HOSTILE_VALUES, chance.choice(attributes)[2])).replace('"', "")
        return text[: found.start(2)] + value + text[found.end(2) :]
    if how == 3 and attributes:
        found = chance.choice(attributes)
        return text[: found.start()] + text[found.end() :]
    if how in (4, 5) and tags:
        found = chance.choice(tags)
        again = found[0] if how == 5 else ""
        return text[: found.start()] + again * 2 + text[found.end() :]
    if how == 6:
        head, mark, rest = text.partition("?>")
        return head + mark + ENTITIES + rest
    return text[: chance.randrange(len(text) + 1)]

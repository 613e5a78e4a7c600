"""Damaged and hostile files never cause a traceback, a hang, or a file outside the folder.

Each of a few thousand mutated FMUs and systems is given to the command line, like a user's file,
and is run if it can still be opened.
"""

from __future__ import annotations

import io
import os
import random
import re
import tempfile
import time
import warnings
import zipfile
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest import mock

from any_fmu import repacked
from diagnosed import run
from runner import PARTIAL, Row, seeds

from ballscrew.fmus.system_export import export_system
from ballscrew.orchestration.loop.catalogue import fmu

FIRST, FILES = 0, 2500
TIME_LIMIT = 5.0  # for a call of the FMU [s]
PATIENCE = 60.0  # for the entire command [s]
DESCRIPTIONS = {"fmu": "modelDescription.xml", "ssp": "SystemStructure.ssd"}
HOSTILE_NAMES = (
    "../escaped.txt", "/tmp/ballscrew-escaped.txt", "a/../../escaped.txt", "..\\escaped.txt",
    "C:escaped.txt", "C:\\escaped.txt", "resources/../../escaped.txt", "x" * 5000, "binaries",
    "modelDescription.xml/", "modelDescription.xml/inside", "a\x00b", ".", "..", "/", "",
    "con\udcffname".encode("utf-8", "replace").decode(),
)  # fmt: skip
HOSTILE_VALUES = (
    "", "nan", "inf", "-1e999", "-1", "0", "1e308", str(10**30), "true", "../../escaped",
    "/etc/passwd", "\U0001d54f \u202e", "%s%s%n", "x" * 10_000, "&bomb;", "&outside;",
)  # fmt: skip
ENTITIES = (
    '<!DOCTYPE d [<!ENTITY a "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaa">'
    + "".join(f'<!ENTITY {c} "{f"&{p};" * 30}">' for p, c in zip("abcdefg", "bcdefgh", strict=True))
    + '<!ENTITY bomb "&h;&h;"><!ENTITY outside SYSTEM "file:///etc/passwd">]>'
)


Entries = list[tuple[str, bytes]]


def mutated(good: bytes, description: str, seed: int) -> tuple[str, bytes]:
    """Kind of the damage, and the damaged archive; `description` names its main XML file."""
    chance = random.Random(seed)
    kinds = [
        ("bytes of the file", spoilt), ("an entry's name", rewritten(renamed)),
        ("an entry left out", rewritten(left_out)),
        ("an entry's content", rewritten(content_spoilt)), ("an entry added", rewritten(added)),
    ]  # fmt: skip
    kind, make = chance.choice(kinds + [("the description", rewritten(described, description))] * 5)
    return kind, make(good, chance)


def spoilt(data: bytes, chance: random.Random) -> bytes:
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


def rewritten(change: Callable[..., None], *more: str) -> Callable[..., bytes]:
    """A function that changes the entries of an archive."""

    def make(data: bytes, chance: random.Random) -> bytes:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = [(n, archive.read(n)) for n in archive.namelist()]
        change(entries, chance, *more)
        stream = io.BytesIO()
        with warnings.catch_warnings(), zipfile.ZipFile(stream, "w") as archive:
            warnings.simplefilter("ignore")  # two entries of one name are intended
            for name, content in entries:
                entry = zipfile.ZipInfo("x")
                entry.filename = name  # not by the constructor, which corrects some names
                archive.writestr(entry, content)
        return stream.getvalue()

    return make


def renamed(entries: Entries, chance: random.Random) -> None:
    k = chance.randrange(len(entries))
    other = chance.choice(entries)[0]
    entries[k] = (chance.choice((*HOSTILE_NAMES, other)), entries[k][1])


def left_out(entries: Entries, chance: random.Random) -> None:
    del entries[chance.randrange(len(entries))]


def content_spoilt(entries: Entries, chance: random.Random) -> None:
    k = chance.randrange(len(entries))
    entries[k] = (entries[k][0], spoilt(entries[k][1], chance))


def added(entries: Entries, chance: random.Random) -> None:
    entries.insert(chance.randrange(len(entries) + 1), (chance.choice(HOSTILE_NAMES), b"evil"))


def described(entries: Entries, chance: random.Random, description: str) -> None:
    k = next(k for k, (name, _) in enumerate(entries) if name == description)
    text = entries[k][1].decode("utf-8")
    for _ in range(chance.choice((1, 1, 2, 5))):
        text = xml_changed(text, chance)
    encoding = chance.choice(("utf-8",) * 8 + ("utf-16", "latin-1"))
    entries[k] = (description, text.encode(encoding, "replace"))


def xml_changed(text: str, chance: random.Random) -> str:
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


def good_files() -> dict[str, bytes]:
    """Files to be mutated: one FMU and one system of ours, without the rarer binaries."""
    with tempfile.TemporaryDirectory() as folder:
        own, system = Path(folder) / "pid.fmu", Path(folder) / "s.ssp"
        repacked(fmu("pid"), own, lambda name, data: None if name.endswith(".dll") else data)
        export_system(fmu("plant"), fmu("pid"), system, name="s")
        return {"fmu": own.read_bytes(), "ssp": system.read_bytes()}


def tasks(asked: Namespace) -> dict[str, tuple[int, dict[str, Path]]]:
    files = {}
    for suffix, data in good_files().items():
        files[suffix] = PARTIAL / f"good.{suffix}"
        files[suffix].parent.mkdir(parents=True, exist_ok=True)
        files[suffix].write_bytes(data)
    return {f"file {seed}": (seed, files) for seed in seeds(asked, FILES, FIRST)}


def trial(seed: int, good: dict[str, Path]) -> Row:
    """Give one mutated file to the command line, in a separate folder."""
    suffix = "ssp" if seed % 5 == 0 else "fmu"
    kind, data = mutated(good[suffix].read_bytes(), DESCRIPTIONS[suffix], seed)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        root = Path(folder)
        inner, scratch = root / "inner", root / "inner" / "tmp"
        scratch.mkdir(parents=True)
        (inner / f"bad.{suffix}").write_bytes(data)
        option = "--system" if suffix == "ssp" else "--controller"
        arguments = ["run", option, str(inner / f"bad.{suffix}"), "--stop", "0.003"]
        arguments += ["--time-limit", str(TIME_LIMIT), "--out", str(inner / "out")]
        what, code, said = "", -1, ""
        start = time.monotonic()
        # Each picture takes seconds and uses numbers only.
        pictures = mock.patch("ballscrew.orchestration.loop.pictures.run_figures", return_value={})
        with (
            pictures,
            mock.patch.dict(os.environ, {"TMPDIR": str(scratch)}),
            mock.patch.object(tempfile, "tempdir", str(scratch)),
        ):
            try:
                code, _, said = run(*arguments)
            except BaseException as error:
                what = f"{type(error).__name__}: {error}"
        seconds = time.monotonic() - start
        what = what or complaint(code, said, seconds, root)
    row = {"seed": seed, "kind": f"{suffix}: {kind}", "code": code}
    return row | {"seconds": round(seconds, 1), "complaint": what}


def complaint(code: int, said: str, seconds: float, root: Path) -> str:
    """What is wrong; empty if nothing is."""
    if "Traceback" in said:
        return f"a traceback: {said}"
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if code == 2 and said.count("\n") != 1:
        return f"not one line: {said}"
    if seconds > PATIENCE:
        return f"took {seconds:.0f} s"
    left = [p.name for p in (root / "inner" / "tmp").iterdir()]
    there = {p.name for p in root.iterdir()} | {p.name for p in (root / "inner").iterdir()}
    strange = there - {"inner", "tmp", "out", "bad.fmu", "bad.ssp"}
    if left or strange or Path("/tmp/ballscrew-escaped.txt").exists():
        return f"left behind: {left}, {strange}"
    return ""


def report(rows: Sequence[Row]) -> Row:
    wrong = [r for r in rows if r["complaint"]]
    codes, kinds = (Counter(r[k] for r in rows) for k in ("code", "kind"))
    return {
        "seeds": [rows[0]["seed"], rows[-1]["seed"] + 1],
        "files": len(rows),
        "refused": codes[2],
        "ran": codes[0] + codes[1],
        "by_kind": dict(sorted(kinds.items())),
        "wrong": wrong,
        "holds": not wrong,
    }


def says(report: Row) -> str:
    refused, ran, wrong = report["refused"], report["ran"], len(report["wrong"])
    return f"of {report['files']} files {refused} are refused, {ran} run; {wrong} complaints"

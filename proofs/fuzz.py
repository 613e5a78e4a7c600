"""Proof: damaged and hostile files never cause a traceback, a hang, or a file outside the folder.

Each of a few thousand mutated FMUs and systems is given to the command line, like a user's file,
and is run if it can still be opened. Writes ``docs/proof/fuzz.json``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from mutations import mutated
from provenance import provenance

TARGET = Path(__file__).resolve().parents[1] / "docs" / "proof" / "fuzz.json"
TIME_LIMIT = 5.0  # for a call of the FMU [s]
PATIENCE = 60.0  # for the entire command [s]
DESCRIPTIONS = {"fmu": "modelDescription.xml", "ssp": "SystemStructure.ssd"}


@dataclass(frozen=True)
class Outcome:
    """Result of a mutated file; `complaint` is empty if nothing was wrong."""

    seed: int
    kind: str
    code: int
    seconds: float
    complaint: str


def good_files() -> dict[str, bytes]:
    """Files to be mutated: one FMU and one system of ours, without the rarer binaries."""
    import zipfile

    from ballscrew.fmus.system_export import export_system
    from ballscrew.orchestration.loop.catalogue import fmu

    def lean(path: Path) -> bytes:
        stream = io.BytesIO()
        with zipfile.ZipFile(path) as old, zipfile.ZipFile(stream, "w") as new:
            for name in old.namelist():
                if not name.endswith(".dll"):
                    new.writestr(name, old.read(name), zipfile.ZIP_DEFLATED)
        return stream.getvalue()

    with tempfile.TemporaryDirectory() as folder:
        system = export_system(fmu("plant"), fmu("pid"), Path(folder) / "s.ssp", name="s")
        return {"fmu": lean(fmu("pid")), "ssp": system.read_bytes()}


def outcome(seed: int, good: dict[str, bytes]) -> Outcome:
    """Give one mutated file to the command line, in a separate folder."""
    from ballscrew.cli import main

    suffix = "ssp" if seed % 5 == 0 else "fmu"
    mutation = mutated(good[suffix], DESCRIPTIONS[suffix], seed)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        root = Path(folder)
        inner, scratch = root / "inner", root / "inner" / "tmp"
        scratch.mkdir(parents=True)
        (inner / f"bad.{suffix}").write_bytes(mutation.data)
        option = "--system" if suffix == "ssp" else "--controller"
        arguments = ["run", option, str(inner / f"bad.{suffix}"), "--stop", "0.003"]
        arguments += ["--time-limit", str(TIME_LIMIT), "--out", str(inner / "out")]
        said, complaint, code = io.StringIO(), "", -1
        start = time.monotonic()
        # Each picture takes seconds and uses numbers only.
        pictures = mock.patch("ballscrew.orchestration.loop.pictures.run_figures", return_value={})
        with (
            pictures,
            mock.patch.dict(os.environ, {"TMPDIR": str(scratch)}),
            mock.patch.object(tempfile, "tempdir", str(scratch)),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            try:
                code = main(arguments)
            except BaseException as error:
                complaint = f"{type(error).__name__}: {error}"
        seconds = time.monotonic() - start
        complaint = complaint or _complaint(code, said.getvalue(), seconds, root)
    return Outcome(seed, f"{suffix}: {mutation.kind}", code, seconds, complaint)


def _complaint(code: int, said: str, seconds: float, root: Path) -> str:
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=2500)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.files)
    good = good_files()
    outcomes = []
    with ProcessPoolExecutor() as pool:
        for result in pool.map(outcome, seeds, [good] * len(seeds), chunksize=5):
            outcomes.append(result)
            if result.complaint:
                print(f"seed {result.seed}, {result.kind}: {result.complaint}", file=sys.stderr)
            if len(outcomes) % 100 == 0:
                print(f"{len(outcomes)} of {options.files}", file=sys.stderr)
    bad = [o for o in outcomes if o.complaint]
    report = {
        **provenance("fuzz"),
        "seeds": [seeds.start, seeds.stop],
        "files": len(outcomes),
        "refused": sum(o.code == 2 for o in outcomes),
        "ran": sum(o.code in (0, 1) for o in outcomes),
        "longest_seconds": round(max(o.seconds for o in outcomes), 1),
        "by_kind": dict(sorted(Counter(o.kind for o in outcomes).items())),
        "complaints": [{"seed": o.seed, "kind": o.kind, "what": o.complaint} for o in bad],
    }
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(report, indent=1))
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())

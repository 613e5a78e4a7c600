"""Finished tasks of long work, one file each, kept in a folder until everything is done.

Each file has the digest of the work that it belongs to: another work in the same folder never
uses it, even after interrupted or parallel runs.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ...solver.files import write_atomically
from .workers import Workers


class KeptParts:
    """The parts of one work; `digest` is of everything that determines them.

    The folder is made with the first part: work that ends earlier leaves nothing.
    """

    def __init__(self, folder: Path, digest: str) -> None:
        self.folder = folder
        self.digest = digest

    def claim(self, work: str, resume: bool, refused: type[ValueError]) -> None:
        """Reject a folder that contains other parts, with one line of the type `refused`."""
        place = self.folder.parent
        found = {_digest(content) for path in self._files() if (content := _content(path))}
        if self.digest in found and not resume:
            raise refused(
                f"{place} contains an unfinished run of this {work}; add --resume to continue it"
            )
        if found and self.digest not in found:
            raise refused(f"{place} contains another {work}; choose another folder, or remove it")
        if resume and not found:
            raise refused(f"{place} contains no {work} to continue; remove --resume to start one")

    def read(self, name: str) -> Any:
        """Result of a task; None if it is not done, or if its file is incomplete."""
        content = _content(self.folder / name)
        return content["found"] if _digest(content) == self.digest else None

    def write(self, name: str, found: Any) -> None:
        """Keep what a task found; raises OSError."""
        content = {"of": self.digest, "found": found}
        write_atomically(self.folder / name, json.dumps(content).encode())

    def results(
        self,
        jobs: Mapping[str, tuple[Any, ...]],
        function: Callable[..., Any],
        workers: Workers,
        fits: Callable[[str, Any], bool] = lambda name, found: True,
    ) -> Iterator[tuple[str, Any]]:
        """Yield the name and result of each job: finished ones first, the others as they end.

        `jobs` are arguments by name; `fits` says whether a result belongs to its job.
        """
        missing = {}
        for name, job in jobs.items():
            found = self.read(name)
            if found is not None and fits(name, found):
                yield name, found
            else:
                missing[name] = job
        for name, found in workers.map(function, iter(missing.items())):
            self.write(name, found)
            yield name, found

    def discard(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("*.json"))


def _content(path: Path) -> Any:
    try:
        return json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None


def _digest(content: Any) -> str:
    """The digest in a file; empty for a file of another version or another program."""
    known = isinstance(content, dict) and set(content) == {"of", "found"}
    return str(content["of"]) if known else ""

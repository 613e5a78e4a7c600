"""Shared parts: a cache folder of the test run's own, FMUs made once, reference courses."""

from __future__ import annotations

import base64
import os
import pickle
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from matplotlib.figure import Figure

# What tests derive goes to a folder of their own that outlives a run: warm runs are fast, and
# nothing of the user's is touched. Set before anything of the package is imported.
# The worlds that proofs are made in are compiled by numba, and run for a moment each.
os.environ.setdefault("NUMBA_OPT", "1")
# Matrices are small here, and each worker is a thread already: more cost three times as much.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault(
    "BALLSCREW_CACHE", str(Path(tempfile.gettempdir()) / f"ballscrew-tests-{os.getuid()}")
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The test that takes longest begins first, so that no worker waits for it at the end."""
    items.sort(key=lambda item: "test_the_python_on_the_first_page" not in item.nodeid)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What was not tested, for want of data or of a program, as one list at the end."""
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    if reasons:
        terminalreporter.section("not tested, for want of data or of a program")
        for reason, cases in sorted(reasons.items()):
            terminalreporter.line(f"{cases} case{'s' * (cases > 1)}: {reason}")


@pytest.fixture(scope="session", autouse=True)
def temporary_files_go_with_the_run() -> Iterator[None]:
    """What hosts unpack, and killed commands leave, is removed at the end."""
    with (
        tempfile.TemporaryDirectory(prefix="tests-", ignore_cleanup_errors=True) as folder,
        pytest.MonkeyPatch.context() as patch,
    ):
        Path(folder).chmod(0o711)  # some tests run commands as another user
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", None)
        yield


_savefig = Figure.savefig
BLANK = {
    "png": base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2FAAAAABJRU5ErkJggg=="
    ),
    "svg": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
}


@pytest.fixture(scope="session", autouse=True)
def pictures_are_blank() -> Iterator[None]:
    """Drawing costs more than most runs; who looks at pictures asks for `drawn`."""

    def write_blank(self, stream, format, metadata=None):
        stream.write(BLANK[format])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", write_blank)
        yield


@pytest.fixture(scope="session")
def drawing() -> Callable[[], AbstractContextManager[None]]:
    """``with drawing():`` pictures are drawn."""

    @contextmanager
    def draw() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Figure, "savefig", _savefig)
            yield

    return draw


@pytest.fixture
def drawn(drawing) -> Iterator[None]:
    with drawing():
        yield


@pytest.fixture(scope="session")
def fmus() -> dict[str, Path]:
    """Paths of exported FMUs by name, each made when it is asked for."""
    from ballscrew.orchestration.loop.catalogue import fmu

    class Made(dict[str, Path]):
        def __missing__(self, name: str) -> Path:
            return self.setdefault(name, fmu(name))

    return Made()


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Callable[..., Path]:
    """``native(name, fmi=2)`` is the path of the native FMU of a component of the catalogue.

    All workers take the one that is made first: each is compiled once.
    """
    from ballscrew.fmus.native.export import write_native
    from ballscrew.orchestration.loop.catalogue import catalogued_model
    from ballscrew.solver.compilers import compiler_for, own_platform

    if not own_platform() or not compiler_for(own_platform()):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "native"
    folder.mkdir(exist_ok=True)

    def get(name: str, fmi: int = 2) -> Path:
        path = folder / f"{name}-{fmi}.fmu"  # written whole or not at all
        return path if path.is_file() else write_native(catalogued_model(name), path, fmi).path

    return get


PATIENCE = 600.0  # s, for what another process of the test run makes


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """Function of a name and a function: what that returns, from this or another process."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    known = {}

    def get(name, make):
        if name not in known:
            known[name] = _made_or_read(shared / f"{name.replace(' ', '-')}.pickle", make)
        return known[name]

    return get


def _made_or_read(path, make):
    try:
        os.close(os.open(path.with_suffix(".taken"), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        end = time.monotonic() + PATIENCE
        while not path.exists():
            assert time.monotonic() < end, f"the process that makes {path.name} has not finished"
            time.sleep(0.1)
        return pickle.loads(path.read_bytes())
    try:
        found = make()
    except BaseException:
        path.with_suffix(".taken").unlink()
        raise
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(found))
    part.rename(path)
    return found

"""What takes long is done once, by whichever of the test run's processes needs it first."""

import os
import pickle
import time

import pytest

PATIENCE = 600.0  # s


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

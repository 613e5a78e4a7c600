"""One diagnosis that the tests of the command and of the report share."""

from __future__ import annotations

import pytest
from axis_records import write_strong
from diagnosed import Diagnosed, run
from worlds import layout as at


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnosed:
    """A record with a hidden load, diagnosed by the command."""
    folder = tmp_path_factory.mktemp("diagnosed")
    record, prior_model = write_strong({at.LOAD: 0.4}, folder / "data")
    out = folder / "out"
    given = ("diagnose", record, "--params", prior_model, "--out", out)
    return Diagnosed(record, prior_model, out, *run(*given))

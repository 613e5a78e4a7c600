"""One diagnosis that the tests of the command share."""

from __future__ import annotations

import pytest
from diagnosed import Diagnosed, run
from slide_records import write_slide


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnosed:
    """The record of a slide with a ripple, diagnosed by the command."""
    folder = tmp_path_factory.mktemp("diagnosed")
    record, prior_model = write_slide(folder, "torque_ripple")
    out = folder / "out"
    given = ("diagnose", record, "--params", prior_model, "--out", out)
    return Diagnosed(record, prior_model, out, *run(*given))

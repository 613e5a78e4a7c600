"""One diagnosis that the tests of the command and of the report share."""

from __future__ import annotations

import pytest
from diagnosed import Diagnosed, run
from hidden_cases import draw_case, write_case


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Diagnosed:
    """A record with a hidden load, diagnosed by the command."""
    folder = tmp_path_factory.mktemp("diagnosed")
    files = write_case(draw_case(("load_bias",), 1), folder / "data")
    out = folder / "out"
    given = ("diagnose", files.record, "--params", files.parameters, "--out", out)
    return Diagnosed(files.record, files.parameters, out, *run(*given))

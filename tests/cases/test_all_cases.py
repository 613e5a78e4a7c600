"""Every case has a test of its own, or says why it has none yet."""

from pathlib import Path

import pytest
from cases import CASES

NOT_YET = {"identify_exact_record_not_trusted"}


def test_every_case_has_a_test():
    if not CASES.is_dir():
        pytest.skip("the cases are not here; set BALLSCREW_CASES to their folder")
    folders = {p.name for p in CASES.iterdir() if p.is_dir()}
    tested = {p.stem.removeprefix("test_") for p in Path(__file__).parent.glob("test_*.py")}
    assert folders - tested == NOT_YET

"""Cases: the same bytes from the same seed."""

from __future__ import annotations

from pathlib import Path

import pytest
from worlds import draw_case, write_case

SEED = 7


@pytest.mark.ci
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path):
    def written(seed, name):
        (folder := tmp_path / name).mkdir()
        paths, believed = write_case(draw_case("linear_drive", ("compliance",), seed), folder)
        return [p.read_bytes() for p in (*paths, believed)]

    first = written(SEED, "a")
    assert first == written(SEED, "b")
    assert first[0] != written(SEED + 1, "c")[0]

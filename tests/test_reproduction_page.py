"""The page `docs/reproduction.md`: it says what its figures say, and they are what is computed."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest
import reproduction
from thesis.commands import REPEATS
from thesis.loops import SEEN
from thesis.printed import (
    SYSTEM_2,
)
from thesis.solvers import by_scipy

pytestmark = pytest.mark.ci


@cache
def report() -> dict[str, Any]:
    return json.loads(reproduction.FIGURES.read_text(encoding="utf-8"))


def figures() -> dict[str, Any]:
    return report()["figures"]


def test_the_page_is_byte_for_byte_what_the_stored_figures_give():
    assert reproduction.PAGE.read_bytes() == reproduction.page(report()).encode()


def test_loose_tolerances_make_the_second_loop_swing_and_tight_ones_do_not():
    # What a loose solver finds changes with the last bit, thus with the processor: nine loops.
    sigma0, sigma1 = SYSTEM_2
    near = [(sigma0 * (1.0 + k * 1e-13), sigma1) for k in range(9)]
    loose = [by_scipy(*system, "RK45", 1e-3, 1e-6) for system in near]
    assert sum(end.swing > SEEN for end in loose) > len(near) / 2
    tight = by_scipy(sigma0, sigma1, "BDF", 1e-6, 1e-9)
    assert tight.kind == "stands"


@pytest.mark.parametrize("part", ["parameters", "nctf"])
def test_one_part_computed_anew_prints_the_lines_of_the_page(part, capsys):
    reproduction.repeat(part)
    told = capsys.readouterr().out.splitlines()
    lines = [label for label, command in REPEATS.items() if command.endswith(f"--only {part}")]
    assert [line.split()[0] for line in told] == lines
    of = dict(reproduction.labelled(figures()))
    for label, line in zip(lines, told, strict=True):
        assert line.endswith(f", here {of[label].here}: {of[label].verdict}")

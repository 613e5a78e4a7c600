"""The page `docs/reproduction.md`: it says what its figures say, and they are what is computed."""

from __future__ import annotations

import json
import re
import shlex
from functools import cache
from typing import Any

import numpy as np
import pytest
import reproduction
from thesis.commands import REPEATS
from thesis.loops import SEEN, growth, loop_run
from thesis.plane import runaway_edge
from thesis.printed import (
    LONG,
    SIGMA1,
    SYSTEM_2,
)
from thesis.solvers import by_scipy

from ballscrew.cli import main
from ballscrew.orchestration.loop.metrics import metrics

pytestmark = pytest.mark.ci


@cache
def report() -> dict[str, Any]:
    return json.loads(reproduction.FIGURES.read_text(encoding="utf-8"))


def figures() -> dict[str, Any]:
    return report()["figures"]


def test_the_page_is_byte_for_byte_what_the_stored_figures_give():
    assert reproduction.PAGE.read_bytes() == reproduction.page(report()).encode()


def test_the_nominal_nctf_exponent_computed_again_is_the_one_on_the_page():
    _, grown = growth("nctf", None, LONG, tolerance=1e-10)
    stored = figures()["spectra"]["nctf_at_300_s"]["lambda1_times_t_bits"]
    assert grown[-1] == pytest.approx(stored, rel=1e-5)


def test_loose_tolerances_make_the_second_loop_swing_and_tight_ones_do_not():
    # What a loose solver finds changes with the last bit, thus with the processor: nine loops.
    sigma0, sigma1 = SYSTEM_2
    near = [(sigma0 * (1.0 + k * 1e-13), sigma1) for k in range(9)]
    loose = [by_scipy(*system, "RK45", 1e-3, 1e-6) for system in near]
    assert sum(end.swing > SEEN for end in loose) > len(near) / 2
    tight = by_scipy(sigma0, sigma1, "BDF", 1e-6, 1e-9)
    assert tight.kind == "stands"


def test_the_edge_of_runaway_computed_again_is_the_one_on_the_page():
    stored = figures()["plane"]["edges"]["estimated"]["runaway_by_sigma1"]
    again = runaway_edge(SIGMA1)
    assert again == pytest.approx(stored[f"{SIGMA1:g}"], abs=2e-3)


def test_the_voltages_of_both_nominal_loops_computed_again_are_those_on_the_page():
    for controller, part in (("iol", "linearization"), ("nctf", "nctf")):
        found = metrics(loop_run(controller, stop=1.0))
        assert found.peak_voltage == pytest.approx(figures()[part]["peak_voltage"], rel=1e-6)


@pytest.mark.parametrize("part", ["parameters", "nctf"])
def test_one_part_computed_anew_prints_the_lines_of_the_page(part, capsys):
    reproduction.repeat(part)
    told = capsys.readouterr().out.splitlines()
    lines = [label for label, command in REPEATS.items() if command.endswith(f"--only {part}")]
    assert [line.split()[0] for line in told] == lines
    of = dict(reproduction.labelled(figures()))
    for label, line in zip(lines, told, strict=True):
        assert line.endswith(f", here {of[label].here}: {of[label].verdict}")


def test_the_exponents_that_repeat_the_second_system_are_those_of_the_page(capsys, tmp_path):
    arguments = shlex.split(REPEATS["E9"])[1:-1]
    assert main([*arguments, str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    two = figures()["spectra"]["system_2_estimated"]
    assert two["verdict"] in told
    limits = [float(x) for x in re.findall(r"^ +\S+ +(\S+) \+-", told, re.M)]
    np.testing.assert_allclose(limits, two["asymptotic_bits_per_s"], rtol=1e-3, atol=1e-6)

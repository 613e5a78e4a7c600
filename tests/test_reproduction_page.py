"""The page `docs/reproduction.md`: it says what its figures say, and they are what is computed."""

from __future__ import annotations

import json
import re
from functools import cache
from typing import Any

import pytest
import reproduction
from thesis.claim import Claim
from thesis.loops import SEEN, end_of, growth, hats, loop_run
from thesis.plane import cycle_edge, runaway_edge
from thesis.printed import (
    CYCLE,
    LARGEST_1,
    LONG,
    PERCENT,
    ROWS,
    RUNAWAY,
    SIGMA0,
    SIGMA1,
    STOP,
    SYSTEM_1,
    SYSTEM_2,
)
from thesis.solvers import by_scipy

from ballscrew.controllers.nctf import design
from ballscrew.orchestration.metrics import metrics


@cache
def report() -> dict[str, Any]:
    return json.loads(reproduction.FIGURES.read_text(encoding="utf-8"))


def figures() -> dict[str, Any]:
    return report()["figures"]


def claims() -> list[Claim]:
    return [c for _, make in reproduction.SECTIONS for c in make(figures())]


def test_the_page_is_byte_for_byte_what_the_stored_figures_give():
    assert reproduction.PAGE.read_bytes() == reproduction.page(report()).encode()


def test_only_what_the_thesis_prints_is_counted():
    own = [c for c in claims() if not c.printed]
    assert own
    assert {c.verdict for c in own} == {"not counted"}
    text = reproduction.PAGE.read_text(encoding="utf-8")
    agree, differ = (int(n) for n in re.search(r"(\d+) agree, (\d+) differ", text).groups())
    assert (agree, differ) == (text.count("| agrees |"), text.count("| **differs** |"))
    assert agree + differ + len(own) == len(claims())


def test_every_claim_that_differs_is_explained_with_a_number():
    differing = [c for c in claims() if not c.agrees]
    assert differing
    assert [c.says for c in differing if not re.search(r"\d", c.why)] == []


def test_both_critical_values_and_every_row_of_the_tables_are_on_the_page():
    text = reproduction.PAGE.read_text(encoding="utf-8")
    for value in (RUNAWAY, CYCLE, LARGEST_1):
        assert str(value) in text
    for percent, value in zip(PERCENT, ROWS, strict=True):
        assert f"| {percent} % | {value:.4f} |" in text


def test_the_nominal_nctf_exponent_computed_again_is_the_one_on_the_page():
    _, grown = growth("nctf", None, LONG, tolerance=1e-10)
    stored = figures()["spectra"]["nctf_at_300_s"]["lambda1_times_t_bits"]
    assert grown[-1] == pytest.approx(stored, rel=1e-5)


def test_the_first_linearizing_loops_exponent_computed_again_is_the_one_on_the_page():
    values = hats(*SYSTEM_1)
    _, grown = growth("iol", values, STOP, tolerance=1e-10)
    stored = figures()["spectra"]["system_1_estimated"]["lambda1_times_t_bits"]
    assert grown[-1] == pytest.approx(stored, rel=1e-3)


def test_the_second_linearizing_loop_stands_where_the_page_says():
    end = end_of(*SYSTEM_2)
    stored = figures()["loose_solvers"]["systems_here"][1]
    assert (end.kind, stored["kind"]) == ("stands", "stands")
    assert end.offset == pytest.approx(stored["offset"], rel=1e-3)


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


def test_the_edge_of_swinging_computed_again_is_the_one_on_the_page():
    stored = figures()["plane"]["edges"]["estimated"]["cycle_by_sigma0"]["+0.5"]
    again = cycle_edge(SIGMA0 + 0.5)
    assert again == pytest.approx(stored, abs=0.01)


def test_the_stopping_time_of_a_perturbed_plant_computed_again_is_the_one_on_the_page():
    stored = figures()["tables"]["sigma0_alone"][0]["A"]
    assert design({"sigma1": 0.7 * SIGMA1}).stopping_time == pytest.approx(stored, rel=1e-6)


def test_the_voltages_of_both_nominal_loops_computed_again_are_those_on_the_page():
    for controller, part in (("iol", "linearization"), ("nctf", "nctf")):
        found = metrics(loop_run(controller, stop=1.0))
        assert found.peak_voltage == pytest.approx(figures()[part]["peak_voltage"], rel=1e-6)

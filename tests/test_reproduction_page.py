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
from thesis import pictures
from thesis.claim import Claim
from thesis.commands import REPEATS
from thesis.loops import SEEN, end_of, growth, hats, loop_run
from thesis.plane import cycle_edge, runaway_edge
from thesis.printed import (
    CYCLE,
    LARGEST_1,
    LONG,
    NOMINAL_VOLTAGE,
    PEAK,
    PERCENT,
    ROWS,
    RUNAWAY,
    SIGMA0,
    SIGMA1,
    SPECTRUM_2,
    STOP,
    SYSTEM_1,
    SYSTEM_2,
)
from thesis.solvers import by_scipy

from ballscrew.cli import command_parser, main
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


def test_every_line_has_a_command_that_is_on_the_page():
    text = reproduction.PAGE.read_text(encoding="utf-8")
    assert [label for label, _ in reproduction.labelled(figures())] == sorted(
        REPEATS, key=lambda label: (label[0], int(label[1:]))
    )
    assert [c for c in REPEATS.values() if f"`{c}`" not in text] == []


@pytest.mark.parametrize("command", sorted(set(REPEATS.values())))
def test_a_command_of_a_line_is_one_that_the_program_takes(command):
    program, *arguments = shlex.split(command)
    if program == "ballscrew":
        assert command_parser().parse_args(arguments).action
    else:
        assert (program, arguments.pop(0)) == ("python", "proofs/reproduction.py")
        assert reproduction.parser().parse_args(arguments).only in reproduction.PARTS


@pytest.mark.parametrize("part", ["parameters", "linearization", "nctf"])
def test_one_part_computed_anew_prints_the_lines_of_the_page(part, capsys):
    reproduction.repeat(part)
    told = capsys.readouterr().out.splitlines()
    lines = [label for label, command in REPEATS.items() if command.endswith(f"--only {part}")]
    assert [line.split()[0] for line in told] == lines
    of = dict(reproduction.labelled(figures()))
    for label, line in zip(lines, told, strict=True):
        assert line.endswith(f", here {of[label].here}: {of[label].verdict}")


@pytest.mark.parametrize("controller", ["iol", "nctf"])
def test_the_run_that_repeats_a_nominal_step_prints_the_figures_of_the_page(
    controller, capsys, tmp_path
):
    command = REPEATS["C4" if controller == "iol" else "D10"]
    arguments = shlex.split(command)[1:-1]
    assert main([*arguments, str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    part = figures()["linearization" if controller == "iol" else "nctf"]
    shown = float(re.search(r"peak voltage\s+(\S+) V", told)[1])
    assert shown == pytest.approx(part["peak_voltage"], rel=1e-5)
    shown = float(re.search(r"settling time\s+(\S+) s", told)[1])
    assert shown == pytest.approx(part["settling_time_2pct"], rel=1e-5)


def test_the_exponents_that_repeat_the_second_system_are_those_of_the_page(capsys, tmp_path):
    arguments = shlex.split(REPEATS["E9"])[1:-1]
    assert main([*arguments, str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    two = figures()["spectra"]["system_2_estimated"]
    assert two["verdict"] in told
    limits = [float(x) for x in re.findall(r"^ +\S+ +(\S+) \+-", told, re.M)]
    np.testing.assert_allclose(limits, two["asymptotic_bits_per_s"], rtol=1e-3, atol=1e-6)


def test_the_gains_in_the_commands_of_perturbed_plants_are_those_of_the_design():
    for label, share in (("G5", 0.7), ("G6", 1.3)):
        made = design({"sigma0": share * SIGMA0, "sigma1": share * SIGMA1}).parameters()
        given = dict(re.findall(r"controller\.(\w+)=(\S+)", REPEATS[label]))
        assert {n: float(v) for n, v in given.items()} == {
            n: pytest.approx(made[n], rel=1e-5) for n in ("c", "Kp", "Ki")
        }


def test_all_figures_from_3_4_on_are_on_the_page_and_small():
    text = reproduction.PAGE.read_text(encoding="utf-8")
    named = set()
    for name, caption in pictures.CAPTIONS.items():
        assert f"(images/reproduction/{name}.png)" in text
        assert (pictures.FOLDER / f"{name}.png").stat().st_size < pictures.MOST_BYTES
        first, last = re.match(r"Figs?\. 3\.(\d+)(?: (?:and|to) 3\.(\d+))?\. ", caption).groups()
        named |= set(range(int(first), int(last or first) + 1))
    assert named == set(range(4, 25)) - {6}  # which is a block diagram, and the page says so
    assert set(pictures.PICTURES) == set(pictures.CAPTIONS)


def panels_of(name: str, folder) -> dict[str, Any]:
    """A picture made anew: its panels by title."""
    figure = pictures.save(name, folder)
    assert (folder / f"{name}.png").stat().st_size < pictures.MOST_BYTES
    return {axes.get_title(): axes for axes in figure.axes}


def marked(axes: Any, y: float) -> bool:
    """Whether a black line or mark stands at this height."""
    return any(
        line.get_color() == "black" and np.all(np.asarray(line.get_ydata()) == y)
        for line in axes.lines
        if len(line.get_ydata())
    )


@pytest.mark.usefixtures("drawn")
def test_the_voltage_is_drawn_as_stored_with_what_the_thesis_reads(tmp_path):
    voltage = panels_of("linearization", tmp_path)["Fig. 3.5: motor voltage"]
    peak = max(line.get_ydata().max() for line in voltage.lines if len(line.get_ydata()) > 100)
    assert peak == pytest.approx(figures()["linearization"]["peak_voltage"], rel=1e-4)
    assert marked(voltage, PEAK[1])
    assert marked(voltage, NOMINAL_VOLTAGE)


@pytest.mark.usefixtures("drawn")
def test_the_exponents_are_drawn_as_stored_with_what_the_thesis_prints(tmp_path):
    panel = panels_of("system_2", tmp_path)["Fig. 3.17: exponents"]
    assert all(marked(panel, value) for value in SPECTRUM_2)
    ends = [line.get_ydata()[-1] for line in panel.lines if len(line.get_ydata()) > 100]
    stored = figures()["spectra"]["system_2_estimated_long"]["exponents_at_300_s"]
    # at 300 s the two slow ones still depend on the accuracy, see the page
    np.testing.assert_allclose(sorted(ends), sorted(stored), rtol=0.1)


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(("name", "share"), [("nctf_70", "70"), ("nctf_130", "130")])
def test_the_loops_of_perturbed_plants_are_drawn_as_stored(name, share, tmp_path):
    (panel,) = [a for title, a in panels_of(name, tmp_path).items() if "exponents" in title]
    ends = [line.get_ydata()[-1] for line in panel.lines if len(line.get_ydata()) > 100]
    stored = figures()["tables"]["systems"][share]["exponents_bits_per_s"]
    np.testing.assert_allclose(sorted(ends), sorted(stored), rtol=0.01)


def test_a_cell_of_the_plane_is_drawn_by_the_rule_of_the_page():
    assert pictures.kinds_of([SIGMA0], [SIGMA1, SYSTEM_2[1]]).tolist() == [
        [("stands", "swings", "diverges").index(end_of(SIGMA0, s1).kind)]
        for s1 in (SIGMA1, SYSTEM_2[1])
    ]

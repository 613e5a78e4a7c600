"""The verdict against exact solutions: wrong results are never called trusted."""

from dataclasses import replace

import numpy as np
import pytest
import small_fmus
from runner import stored
from verdict import linear, loops, nonlinear
from verdict.parts import WRONG, ComponentSlave, summary

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.master.jumps import jumps
from ballscrew.orchestration.master.master import run_loop
from ballscrew.orchestration.master.reference_signal import Reference
from ballscrew.orchestration.master.sides import Sides
from ballscrew.orchestration.master.verdict import Rung, Verdict, verdict_of


def test_wrong_results_of_random_stiff_loops_are_not_trusted_and_most_right_ones_are():
    """Against matrix exponentials; a thousand of them: proofs/verdict/loops.py."""
    found = summary([linear.outcome(seed) for seed in range(40)])
    assert found["wrong"] >= 12
    assert found["wrong_called_trusted"] == []
    assert found["right"] >= 6
    assert found["right_called_trusted"] >= 0.7 * found["right"]


@pytest.mark.parametrize("family", range(len(nonlinear.FAMILIES)))
def test_wrong_results_of_loops_that_stick_hit_switch_or_sample_are_not_trusted(family):
    seeds = range(family, 5 * len(nonlinear.FAMILIES), len(nonlinear.FAMILIES))
    found = summary([nonlinear.outcome(seed) for seed in seeds])
    assert found["wrong"] + found["right"] >= 3
    assert found["wrong_called_trusted"] == []
    assert found["right_called_trusted"] == found["right"]


@pytest.mark.parametrize(("seed", "least"), [(30_218, WRONG / 2), (30_066, WRONG), (40_186, WRONG)])
def test_relays_that_switch_late_alike_with_other_steps_are_not_trusted(seed, least):
    """The first cannot save its state: with all steps it is late; the others with longer ones."""
    late = nonlinear.outcome(seed)
    assert late["error"] > least
    assert not late["trusted"]


@pytest.mark.parametrize(("gap", "trusted"), [(0.55, True), (0.500_01, False), (0.499_99, False)])
def test_a_jump_closer_to_a_communication_point_than_its_time_is_known_is_not_trusted(gap, trusted):
    """A mass that nothing drives hits the stop at t = gap; the communication points are tenths."""
    still = {"k": 0.0, "c": 0.0, "shake": 0.0}
    parts = {
        "plant": ("stops", {**still, "gap": gap, "v_start": 1.0}),
        "controller": ("pid", {"Kp": 0.0, "Kd": 0.0}),
    }
    sides = (
        ComponentSlave(name, nonlinear.kernel_of(kind, False, False), values)
        for name, (kind, values) in parts.items()
    )
    run = run_loop(Sides(*sides, Reference.constant(0.0), 1.0), 0.1)
    assert run.verdict.trusted == trusted
    assert run.verdict.error_estimate["v"] == pytest.approx(0.0 if trusted else 1.5, abs=1e-9)


@pytest.mark.parametrize(("early", "trusted"), [(1e-12, True), (1e-7, False)])
def test_what_ticks_exactly_at_a_communication_point_is_known_there(tmp_path, early, trusted):
    """A counter with a period of 50 steps; 1e-7 s before the point, it may belong after it."""
    step = f"{small_fmus.PLANT_STEP} S[2] = floor((t + h + {early}) / 0.05);"
    counts = {"more": [("n", "output", None, "")], "more_out": "$n$ = S[2];", "step": step}
    plant, controller = str(tmp_path / "plant.fmu"), str(tmp_path / "controller.fmu")
    small_fmus.plant(plant, **counts)
    ports = [*((name, "input", 0, "") for name in ("x", "v", "x_d")), ("u", "output", None, "")]
    small_fmus.build(controller, "pd", ports, out="$u$ = 20 * ($x_d$ - $x$) - 2 * $v$;")
    run = run_closed_loop(Loop(controller, plant, stop=0.5, step=1e-3, isolate=False)).run
    assert run.outputs["n"][[49, 50, -1]].tolist() == [0.0, 1.0, 10.0]
    assert run.verdict.trusted == trusted
    assert run.verdict.error_estimate["n"] == (0.0 if trusted else 1.0)


@pytest.mark.ci
def test_a_body_that_breaks_loose_at_the_start_itself_is_trusted(native):
    """Its flag of sticking jumps right after the start, whose value is given."""
    study = Loop("pid", str(native("plant_classical")), stop=0.05, step=1e-3)
    run = run_closed_loop(study).run
    assert run.outputs["stuck"][:3].tolist() == [1.0, 0.0, 0.0]
    assert run.verdict.trusted
    assert run.verdict.error_estimate["stuck"] == 0.0


def test_what_dies_out_after_the_start_asks_for_no_shorter_steps():
    """The current of a motor after the first command, which is steady after a few steps."""
    run = run_closed_loop(Loop("pid", stop=0.5, step=1e-3)).run
    assert run.verdict.trusted
    assert run.verdict.reason.endswith("steps down to 0.001 s")
    dies_out = np.array([0.0, 1.0, 0.6, 0.5, 0.48, 0.47])
    switches_later = np.array([0.0, 1.0, 0.6, -0.4, -0.405, -0.407])
    assert not jumps(dies_out[:, None]).any()
    assert jumps(switches_later[:, None]).tolist() == [False, False, True, False, False]


@pytest.mark.ci
@pytest.mark.parametrize("kind", loops.OUTCOMES)
def test_a_sample_of_the_kept_proof_comes_out_the_same_again(kind):
    rows = [row for row in stored("trusted_loops")["again"] if row["kind"] == kind]
    assert len(rows) == 5
    for row in rows:
        again = loops.trial(kind, row["seed"])
        assert again["trusted"] == row["trusted"]
        assert again["error"] == pytest.approx(row["error"], rel=1e-3, abs=1e-9)


# the numbers of a verdict: x goes from 0 to 1, v from 3 to 1, w stays at 5 and z at 0

NAMES = ["x", "v", "w", "z"]
TIME = np.linspace(0.0, 1.0, 11)
RUN = np.column_stack([TIME, 3 - 2 * TIME, 5 + 0 * TIME, 0 * TIME])


def rung(**moved):
    """The run, with its outputs moved in some rows."""
    other = RUN.copy()
    other[3:5] += [moved.get(name, 0.0) for name in NAMES]
    return Rung(0.1, TIME, other)


FIRST = Verdict(False, "", "shorter", {}, 0.3)


@pytest.mark.parametrize(
    ("moved", "trusted", "worst"),
    [
        ({"x": 0.00499}, True, "x"),
        ({"x": -0.00501}, False, "x"),
        ({"x": 0.003, "v": 0.0101}, False, "v"),
        ({"x": 0.003, "v": 0.0099}, True, "v"),
        ({"w": 2.4e-8}, True, "w"),  # of a millionth of its size
        ({"w": 2.6e-8}, False, "w"),
        ({"z": 0.0049}, True, "z"),  # of one
        ({"z": 0.0051}, False, "z"),
        ({"v": np.inf}, False, "v"),
    ],
)
def test_a_hundredth_of_the_range_is_allowed_for_the_estimate(moved, trusted, worst):
    """Of a run and one with half of its step: their difference, and as much again."""
    found = verdict_of(FIRST, NAMES, rung(), [rung(), rung(**moved)])
    assert found.trusted is trusted
    assert worst in found.reason
    assert found.advice == ("" if trusted else "shorter")
    expected = [2 * abs(moved.get(n, 0.0)) for n in NAMES]
    assert list(found.error_estimate.values()) == pytest.approx(expected, rel=1e-6)
    assert found.contraction == 0.3


@pytest.mark.parametrize(("left", "trusted"), [(0.49, True), (0.51, False)])
def test_a_correction_that_leaves_more_than_half_of_the_residual_shows_nothing(left, trusted):
    """What a run with one step leaves, where it is a geometric sum of corrections."""
    first, moved = Verdict(False, "", "shorter", {}, left), 0.001
    found = verdict_of(first, NAMES, rung(), [rung(), rung(x=moved)], otherwise=True)
    assert found.trusted is trusted
    if trusted:
        assert found.error_estimate["x"] == pytest.approx(moved + moved / (1.0 - left), rel=1e-9)


@pytest.mark.parametrize(
    ("before", "last", "to_come"),
    [
        (0.004, 0.002, 0.002),
        (0.006, -0.002, 0.002),  # faster than by halves: as much again, not less
        (0.003, 0.002, 0.004),
        (0.003, 0.00209, 0.00209 * 0.00209 / 0.00091),
        (0.003, 0.00211, None),
        (1e-9, 0.9e-4, 0.9e-4),  # round-off
        (1e-9, 1.1e-4, None),
        (0.0, 0.0, 0.0),
    ],
)
@pytest.mark.parametrize("run", [0.0, 0.003])
def test_what_all_halvings_to_come_may_move_follows_from_the_last_two(before, last, to_come, run):
    rungs = [rung(), rung(x=before), rung(x=before + last)]
    found = verdict_of(FIRST, NAMES, rung(x=before + last + run), rungs)
    assert found.trusted is (to_come is not None)
    assert ("do not converge" in found.reason) is (to_come is None)
    expected = run + (abs(last) if to_come is None else to_come)
    assert found.error_estimate["x"] == pytest.approx(expected, abs=1e-12)


def test_after_a_quarter_of_the_step_the_last_move_counts_twice():
    """Even if it is larger than the one before."""
    rungs = [
        replace(rung(x=x), step=step) for x, step in ((0.0, 0.1), (1e-3, 0.05), (3.9e-3, 0.025))
    ]
    found = verdict_of(FIRST, NAMES, rungs[0], rungs)
    assert found.error_estimate["x"] == pytest.approx(3.9e-3 + 2 * 2.9e-3)
    assert found.trusted


def test_parts_of_jumps_count_and_what_ends_early_is_not_compared():
    found = verdict_of(FIRST, NAMES, rung(), [rung(), rung()], np.array([0.0101, 0.0, 0.0, 0.0]))
    assert (found.trusted, found.error_estimate["x"]) == (False, 0.0101)
    short = Rung(0.1, np.linspace(0.0, 0.5, 6), RUN[:6])
    assert not verdict_of(FIRST, NAMES, rung(), [rung(), short]).trusted


@pytest.mark.parametrize(("late", "trusted"), [(1, True), (30, False)])
def test_a_flag_is_judged_by_the_share_of_time_that_it_is_wrong(late, trusted):
    """Where all else agrees: at the point where it changes it is wrong by all of its range."""
    time = np.linspace(0.0, 1.0, 1001)
    run, half = (
        Rung(1e-3, time, np.column_stack([time, (time > t).astype(float)]))
        for t in (0.5, 0.5 + 1e-3 * late)
    )
    found = verdict_of(FIRST, ["x", "stuck"], run, [half, half])
    assert found.trusted is trusted
    assert found.error_estimate["stuck"] == pytest.approx(1e-3 * late, rel=1e-2)

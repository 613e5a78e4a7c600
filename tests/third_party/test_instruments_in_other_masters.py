"""Loops with instruments in masters that are not ours.

Their exchanges put a communication step into each hop, so that they go to the loop of the equations
in the first order. Two sampled parts in a row are another matter. Both sample at the same instant;
in a Jacobi master the second then has what the first put out at the instant before, however short
the step is, and such loops go to the loop in which that signal is one period older. In a
Gauss-Seidel master they go to the loop itself.
"""

from dataclasses import replace

import numpy as np
import pytest
from instrument_loops import apart, exact_course, exported
from wired_loop import WiredLoop, run_in

from ballscrew.fmus.system_reading import read_system
from ballscrew.orchestration.loop.catalogue import component
from ballscrew.plant.instruments.encoder import position_encoder
from ballscrew.plant.instruments.velocity_estimate import velocity_estimate
from ballscrew.solver.component import DiscreteState, symbol

pytestmark = pytest.mark.ci
# Without them an error of the coupling would be lost among the steps of the encoder.
FAITHFUL = {"resolution": 1e-12, "first_harmonic": 0.0, "second_harmonic": 0.0}
VALUES = {f"position_encoder_{n}": v for n, v in FAITHFUL.items()}
STOP = 0.0025  # seconds, fifty samples of the NCTF loop


def courses(host, path, period, stop, **options):
    """Position and velocity at each sample, with steps of 1/8 and of 1/16 of a period."""
    system = read_system(path)
    try:
        starts = [(e.name, n, v) for e in system.elements for n, v in e.start_values.items()]
        starts += [("position_encoder", n, v) for n, v in FAITHFUL.items()]
        fmus = {e.name: str(e.fmu) for e in system.elements}
        ends = [(c.source, c.target) for c in system.connections]
        wires = [tuple((end.element, end.connector) for end in pair) for pair in ends]
        found = []
        for n in (8, 16):
            steps = round(stop * n / period)
            loop = WiredLoop(fmus, wires, starts, ["x", "v"], period / n, steps)
            found.append(np.array(run_in(host, loop, **options))[::n])
    finally:
        system.remove()
    return found


def errors(found, exact):
    """Position and velocity, as shares of their ranges, of the coarse and the fine course."""
    return [apart(course, exact[:, :2]) for course in found]


@pytest.mark.parametrize("host", ["libcosim", "ecos"])
def test_a_loop_with_one_sampled_part_goes_to_the_loop_of_the_equations(tmp_path, host):
    path = exported(tmp_path / "loop.ssp", "pid_sampled", ["position_encoder"])
    exact = exact_course("pid_sampled", [position_encoder()], 0.05, VALUES)
    coarse, fine = errors(courses(host, path, 1e-3, 0.05), exact)
    assert coarse[0] < 4e-3
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(1.0, abs=0.02)


def later():
    """The velocity estimate with its output one period older."""
    estimate = velocity_estimate()
    older = DiscreteState("v_late", "m/s", "velocity one sample before", symbol("v_held"))
    outputs = (replace(estimate.outputs[0], value=symbol("v_late")),)
    return replace(estimate, discrete=(*estimate.discrete, older), outputs=outputs)


@pytest.mark.parametrize(
    ("host", "options", "limit", "other"),
    [
        ("libcosim", {}, later, velocity_estimate),
        ("ecos", {}, later, velocity_estimate),
        ("container", {"sequential": True}, velocity_estimate, later),
    ],
)
def test_two_sampled_parts_in_a_row_go_to_a_loop_that_depends_on_the_scheme(
    tmp_path, host, options, limit, other
):
    chain = ["position_encoder", "velocity_estimate"]
    controller = component("nctf+sampled")
    period = 5e-5  # half of the loop's fastest time constant
    fast = replace(controller.sample_time, default=period)
    controller = replace(controller, sample_time=fast)
    path = exported(tmp_path / "loop.ssp", controller, chain)

    found = courses(host, path, period, STOP, **options)

    def exact(estimate):
        at = replace(estimate.sample_time, default=period)
        parts = [position_encoder(), replace(estimate, sample_time=at)]
        return exact_course(controller, parts, STOP, VALUES)

    coarse, fine = errors(found, exact(limit()))
    np.testing.assert_allclose(np.log2(coarse / fine), 1.0, atol=0.05)
    assert (errors(found, exact(other()))[1] > 5 * fine).all()

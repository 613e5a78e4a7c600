"""Loops with instruments in masters that are not ours.

Their exchanges put a communication step into each hop, so that they go to the loop of the equations
in the first order. Two sampled parts in a row are another matter. Both sample at the same instant;
in a Jacobi master the second then has what the first put out at the instant before, however short
the step is, and such loops go to the loop in which that signal is one period older. In a
Gauss-Seidel master they go to the loop itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from instrument_loops import apart, exact_course, exported
from wired_loop import WiredLoop, missing_for_ecos, run_in

from ballscrew.fmus.catalogue import component
from ballscrew.fmus.system_reading import read_system
from ballscrew.instruments.position_encoder import position_encoder
from ballscrew.instruments.velocity_estimate import velocity_estimate
from ballscrew.solver.component import DiscreteState, symbol

# Without them an error of the coupling would be lost among the steps of the encoder.
FAITHFUL = {"resolution": 1e-12, "first_harmonic": 0.0, "second_harmonic": 0.0}
STOP = 0.0025  # seconds, fifty samples of nctf_sampled
VALUES = {f"position_encoder_{n}": v for n, v in FAITHFUL.items()}


def course_in(host, path, step, stop, every, **options):
    """Position and velocity at each sample, of an .ssp in a third-party master."""
    if host == "ecos" and missing_for_ecos():
        pytest.skip(missing_for_ecos())
    system = read_system(path)
    try:
        starts = [(e.name, n, v) for e in system.elements for n, v in e.start_values.items()]
        loop = WiredLoop(
            {e.name: str(e.fmu) for e in system.elements},
            [
                ((c.source.element, c.source.connector), (c.target.element, c.target.connector))
                for c in system.connections
            ],
            starts + [("position_encoder", n, v) for n, v in FAITHFUL.items()],
            ["x", "v"],
            step,
            round(stop / step),
        )
        return np.array(run_in(host, loop, **options))[::every]
    finally:
        system.remove()


def courses(path, host, period, stop, **options):
    """With steps of an eighth and a sixteenth of a period."""
    return [course_in(host, path, period / n, stop, n, **options) for n in (8, 16)]


def errors(found, exact):
    """Position and velocity, as shares of their ranges, of the coarse and the fine course."""
    return [apart(course, exact[:, :2]) for course in found]


@pytest.mark.parametrize("host", ["libcosim", "ecos"])
def test_a_loop_with_one_sampled_part_goes_to_the_loop_of_the_equations(tmp_path, host):
    path = exported(tmp_path / "loop.ssp", "pid_sampled", ["position_encoder"])
    exact = exact_course("pid_sampled", [position_encoder()], 0.05, VALUES)
    coarse, fine = errors(courses(path, host, 1e-3, 0.05), exact)
    assert coarse[0] < 4e-3
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(1.0, abs=0.02)


def later():
    """The velocity estimate with its output one period older."""
    estimate = velocity_estimate()
    older = DiscreteState("v_late", "m/s", "velocity one sample before", symbol("v_held"))
    return replace(
        estimate,
        discrete=(*estimate.discrete, older),
        outputs=(replace(estimate.outputs[0], value=symbol("v_late")),),
    )


@pytest.mark.parametrize(
    ("host", "options", "limit"),
    [
        pytest.param("libcosim", {}, later, id="libcosim"),
        pytest.param("ecos", {}, later, id="ecos"),
        pytest.param("container", {"sequential": True}, velocity_estimate, id="container"),
    ],
)
def test_two_sampled_parts_in_a_row_go_to_a_loop_that_depends_on_the_scheme(
    tmp_path, host, options, limit
):
    path = exported(
        tmp_path / "loop.ssp", "nctf_sampled", ["position_encoder", "velocity_estimate"]
    )
    period = component("nctf_sampled").sample_time.default

    found = courses(path, host, period, STOP, **options)

    def exact(estimate):
        at = replace(estimate.sample_time, default=period)
        chain = [position_encoder(), replace(estimate, sample_time=at)]
        return exact_course("nctf_sampled", chain, STOP, VALUES)

    coarse, fine = errors(found, exact(limit()))
    np.testing.assert_allclose(np.log2(coarse / fine), 1.0, atol=0.05)
    other = velocity_estimate if limit is later else later
    assert (errors(found, exact(other()))[1] > 5 * fine).all()

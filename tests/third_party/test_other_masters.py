"""Masters that are not ours run the exported loops: libcosim, Ecos and an FMU container.

The first two and the container's parallel schedule are Jacobi masters: every part steps from the
inputs that the last communication point left. The container's sequential schedule is Gauss-Seidel:
the controller's step gets what the plant's step has just put out. At the start all of them exchange
values until the controller answers to the plant's initial state, as our master does.
"""

import functools

import numpy as np
import pytest
from wired_loop import OUTPUTS, run_in, wired

from ballscrew.orchestration.loop.closed_loop import run_closed_loop
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.loop.whole_loop import run_monolithic
from ballscrew.orchestration.master.couplings import Coupling
from ballscrew.orchestration.master.reference_signal import Reference

pytestmark = pytest.mark.ci
GOAL = Reference.constant(0.08)
NCTF_STOP = 0.5  # seconds
IOL_STOP = 1.0  # the error is largest at 0.36 s, also of a run over 20 s


@functools.cache
def ours(coupling):
    """The plant's course under NCTF in our master, with this coupling."""
    how = {"step": 1e-4, "coupling": coupling, "corrections": 0}
    return table(run_closed_loop(Loop("nctf", reference=GOAL, stop=NCTF_STOP, **how)).run)


def table(run):
    return np.column_stack([run.outputs[name] for name in OUTPUTS])


def apart(a, b):
    assert a.shape == b.shape
    return np.abs(a - b).max()


HOSTS = [
    *(pytest.param(host, {}, id=host) for host in ("libcosim", "container", "ecos")),
    pytest.param("container", {"sequential": True}, id="container-sequential"),
]


@pytest.mark.parametrize(("host", "options"), HOSTS)
def test_nctf_in_a_stranger_s_master_agrees_with_ours_of_the_same_scheme(fmus, host, options):
    loop = wired(fmus["plant"], fmus["nctf"], 1e-4, NCTF_STOP, law=False)
    course = np.array(run_in(host, loop, **options))
    schemes = [Coupling.JACOBI, Coupling.GAUSS_SEIDEL]
    same, other = schemes[::-1] if options else schemes
    assert apart(course, ours(same)) < 1e-9
    assert apart(course, ours(other)) > 0.1  # A: no doubt which


def position_error(fmus, host, step, *, law=True, **options):
    """Largest error of the IOL loop's position [m] against the whole loop in one solver."""
    loop = wired(fmus["plant"], fmus["iol"], step, IOL_STOP, law=law)
    course = np.array(run_in(host, loop, **options))
    exact = run_monolithic(Loop("iol", reference=GOAL, stop=IOL_STOP), step)
    return apart(course[:, :1], table(exact)[:, :1])


@pytest.mark.parametrize(("host", "options"), HOSTS)
def test_iol_with_the_law_wired_is_right_in_masters_that_know_nothing_of_it(fmus, host, options):
    coarse, fine = (7.2e-5, 3.0e-6) if options else (4.2e-4, 1.8e-5)
    errors = [position_error(fmus, host, step, **options) for step in (1e-3, 2e-4)]
    assert errors == pytest.approx([coarse, fine], rel=0.02)
    assert np.log(errors[0] / errors[1]) / np.log(5) == pytest.approx(2.0, abs=0.1)


def test_iol_without_the_law_is_centimetres_off_in_the_same_master(fmus):
    assert position_error(fmus, "libcosim", 2e-4, law=False) > 0.03

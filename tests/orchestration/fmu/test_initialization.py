"""Instances that feed each other agree when initialization ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from ballscrew.orchestration.fmu.fmu_instance import StepFailed
from ballscrew.orchestration.fmu.group import Feed, Group


class Static:
    """y = D w + d; tells, or not, on which inputs each output depends.

    Refuses inputs before initialization mode, and an output that is read there before an input that
    it is said to depend on.
    """

    sample_time, can_save = 0.0, False

    def __init__(self, name, gains, offsets, told=True):
        self.name, self.gains, self.offsets, self.told = name, gains, offsets, told
        self.inputs = [f"w{k}" for k in range(gains.shape[1])]
        self.outputs = [f"y{k}" for k in range(gains.shape[0])]
        self.mode, self.w, self.fresh = "instantiated", np.zeros(gains.shape[1]), set()
        self.y = np.zeros(gains.shape[0])

    def nominal(self, name):
        return 1.0

    def is_real(self, name):
        return True

    def follows_at_once(self, name):
        return True

    def initially_from(self, name):
        if not self.told:
            return self.inputs
        row = self.gains[self.outputs.index(name)]
        return [w for w, gain in zip(self.inputs, row, strict=True) if gain]

    def enter_initialization(self, values, stop):
        assert not set(values) & set(self.inputs)
        self.mode = "initialization"

    def leave_initialization(self):
        self.mode = "steps"
        self.y = self.gains @ self.w + self.offsets

    def writer(self, names):
        at = [self.inputs.index(n) for n in names]

        def write(values):
            assert self.mode != "instantiated"
            self.w[at] = values
            self.fresh |= set(names)

        return write

    def reader(self, names):
        at = [self.outputs.index(n) for n in names]

        def read():
            assert self.mode != "instantiated"
            if self.told and self.mode == "initialization":
                assert all(set(self.initially_from(n)) <= self.fresh for n in names)
            self.y = self.gains @ self.w + self.offsets
            return self.y[at].copy()

        return read


def joined(members, sources):
    """A network without inputs of its own; `sources` of all inputs, one after the other."""
    ports = [f"{m.name}.{y}" for m in members for y in m.outputs]
    inputs = [(m.name, w) for m in members for w in m.inputs]
    feeds = [Feed(ports[source], *w) for source, w in zip(sources, inputs, strict=True)]
    return Group("network", {m.name: m for m in members}, feeds, [])


def exact(members, sources):
    """All outputs, by the equations of the whole."""
    gains, offsets = block_diag(*(m.gains for m in members)), [m.offsets for m in members]
    one = np.eye(len(gains))
    return np.linalg.solve(one - gains @ one[sources], np.concatenate(offsets))


@st.composite
def networks(draw, ring):
    """Members with random gains; without a ring none but from outputs before theirs."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.integers(2, 4))
    members, sources = [], []
    sizes = [(draw(st.integers(0, 2)), draw(st.integers(1, 3))) for _ in range(count)]
    first = np.cumsum([0, *(ny for _, ny in sizes)])
    for k, (nw, ny) in enumerate(sizes):
        nw = nw if ring or k else 0
        gains = random.uniform(-1.5, 1.5, (ny, nw)) * (random.random((ny, nw)) < 0.7)
        members.append(Static(f"m{k}", gains, random.normal(size=ny), told=not ring))
        sources += [int(random.integers(first[-1] if ring else first[k])) for _ in range(nw)]
    return members, sources, draw(st.permutations(range(count)))


@settings(max_examples=60, deadline=None)
@given(networks(ring=False))
def test_without_a_ring_outputs_are_read_after_the_inputs_that_they_depend_on(network):
    members, sources, order = network
    group = joined(members, sources)
    shuffled = Group("n", {members[k].name: members[k] for k in order}, group._feeds, [])
    shuffled.enter_initialization({}, 1.0)
    shuffled.leave_initialization()
    np.testing.assert_allclose(
        np.concatenate([m.y for m in members]), exact(members, sources), atol=1e-12
    )


@settings(max_examples=60, deadline=None)
@given(networks(ring=True))
def test_an_algebraic_loop_is_solved(network):
    members, sources, _ = network
    truth = exact(members, sources)
    if not np.abs(truth).max() < 1e3:
        return  # close to a loop without a solution
    group = joined(members, sources)
    group.enter_initialization({}, 1.0)
    group.leave_initialization()
    np.testing.assert_allclose(np.concatenate([m.y for m in members]), truth, atol=1e-8, rtol=1e-8)


def test_a_loop_without_a_solution_is_named():
    one = Static("one", np.array([[1.0]]), np.array([1.0]), told=False)  # y = y + 1
    group = joined([one], [0])
    group.enter_initialization({}, 1.0)
    with pytest.raises(StepFailed, match=r"algebraic loop through one\.y0 has no solution"):
        group.leave_initialization()

"""Several FMUs as one FMU instance, and the initialization of connected FMUs.

In initialization mode, inputs can be set and outputs can be read repeatedly (FMI 2.0.5, 4.2.4;
3.0.2, 2.3.3): the start of an FMU may depend on them. An output is read when all inputs that it
depends on are set. If outputs depend on each other in a ring, or an FMU does not declare its
dependencies, the ring is iterated. Then the FMUs leave the mode one after the other, each with the
newest values of the FMUs before it, and values that are computed only then are passed on again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...solver.arrays import Vector
from .fmu_instance import Instance, Reader, StepFailed, Value, Writer
from .wiring import CONTROLLER, PLANT, Wiring

SETTLED = 1e-12  # largest last change, as a share of a value or of its nominal value
STALE, BACK = range(2)  # flags, see `Group`
SWEEPS = 3  # enough for a ring that is not an algebraic loop


class Feed(NamedTuple):
    """Source of a member's input."""

    source: str  # a member's output as ``member.port``, or an input of the group
    member: str
    port: str


@dataclass(frozen=True)
class Member:
    """An initialized member."""

    instance: Instance
    feeds: Sequence[Feed]
    write: Writer
    read: Reader
    sources: npt.NDArray[np.intp]  # place of each feed among the group's values
    outputs: slice  # places of its outputs among them


def initialize(
    plant: Instance,
    controller: Instance,
    wiring: Wiring,
    values: tuple[Mapping[str, Value], Mapping[str, Value]],
    stop: float,
    reference: Vector,
) -> None:
    """Initialize a plant and its controller together.

    `values` are those of plant and controller: parameters, start values, and inputs that are not
    connected; `reference` has the set-points at the start. Raises `StepFailed` if a part rejects
    its values, or an algebraic loop has no solution.
    """
    goals = [f"set-point of {r}" for r in wiring.references]
    feeds = [Feed(f"{PLANT}.{y}", CONTROLLER, port) for y, port in wiring.signals]
    feeds += [Feed(f"{CONTROLLER}.{u}", PLANT, port) for u, port in wiring.commands]
    feeds += [Feed(f"set-point of {r}", CONTROLLER, r) for r in wiring.references]
    both = Group("loop", {PLANT: plant, CONTROLLER: controller}, feeds, goals)
    own = zip((PLANT, CONTROLLER), values, strict=True)
    both.enter_initialization({f"{side}.{n}": v for side, vs in own for n, v in vs.items()}, stop)
    both.writer(goals)(reference)
    both.leave_initialization()


class Group(Instance):
    """Connected FMU instances as one FMU instance.

    They are stepped one after the other, each with the newest values of those before it: in the
    order of the signals, and in every second step in reverse order. Held values are too early
    for a member in one of the two steps and too late in the other, so that the first order of
    that error cancels. A part with direct feedthrough or with samples is before the parts that it
    feeds in both orders: it may jump at the start of a step. Outputs are named ``member.port``.

    The members are not initialized yet; `inputs` are the group's, as named by the feeds.

    Attributes
    ----------
    values : ndarray
        Inputs of the group, then outputs of its members; `place` has their places by name.
    parts, there, back : list of Member
        In the order of the signals, and in the two alternating orders of the steps.
    flags : ndarray of int, shape (2,)
        Whether inputs were set since outputs were read, and whether the next step is in reverse.
    lags : bool
        Whether outputs of parts with direct feedthrough are outdated after a step.
    """

    sample_time, stop = 0.0, math.inf
    parts: Sequence[Member] = ()
    there: Sequence[Member] = ()
    back: Sequence[Member] = ()
    lags = _initializing = False

    def __init__(
        self, name: str, members: Mapping[str, Instance], feeds: list[Feed], inputs: list[str]
    ) -> None:
        self.name, self.inputs, self._feeds = name, inputs, feeds
        self.steps_vary = all(getattr(p, "steps_vary", True) for p in members.values())
        self._at_once = {m for m, p in members.items() if any(map(p.follows_at_once, p.outputs))}
        # member and port of each output, and of what each input feeds
        self._ports = {f"{m}.{y}": [(m, y)] for m, p in members.items() for y in p.outputs}
        of_inputs = {n: [(f.member, f.port) for f in feeds if f.source == n] for n in inputs}
        order = self._ordered(list(members), {*members}, self._at_once)
        self._members = {m: members[m] for m in order}
        self.outputs = [f"{m}.{y}" for m, p in self._members.items() for y in p.outputs]
        self.place = {n: k for k, n in enumerate([*self.inputs, *self.outputs])}
        # outputs that feed their own member or an earlier one
        before = {m: order[k:] for k, m in enumerate(order)}
        back = {f.source for f in feeds if self._source(f) in before[f.member]}
        self._ring = [n for n in self.outputs if n in back]
        self._ports |= of_inputs
        self.values = np.zeros(len(self.place))
        self.flags = np.ones(2, dtype=np.int64)

    @property
    def can_save(self) -> bool:
        return all(p.can_save for p in self._members.values())

    def _places(self, names: Iterable[str]) -> npt.NDArray[np.intp]:
        return np.array([self.place[n] for n in names], dtype=np.intp)

    def _source(self, feed: Feed) -> str:
        """The member that a feed comes from; empty for an input of the group."""
        return "" if feed.source in self.inputs else self._ports[feed.source][0][0]

    def nominal(self, name: str) -> float:
        member, port = self._ports[name][0]
        return self._members[member].nominal(port)

    def is_real(self, name: str) -> bool:
        return all(self._members[member].is_real(port) for member, port in self._ports[name])

    def follows_at_once(self, name: str) -> bool:
        member, port = self._ports[name][0]
        return self._members[member].follows_at_once(port)

    def initially_from(self, name: str) -> Sequence[str]:
        sources = [name]
        for source in sources:  # it grows meanwhile
            if source not in self.inputs:
                member, port = self._ports[source][0]
                ports = self._members[member].initially_from(port)
                found = (f.source for f in self._feeds if f.member == member and f.port in ports)
                sources += [s for s in dict.fromkeys(found) if s not in sources]
        return [n for n in self.inputs if n in sources]

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """Let every member enter the mode; values are named ``member.variable``."""
        self.stop = stop
        self.values[:] = np.nan  # not known yet
        parts, begin = [], len(self.inputs)
        for name, instance in self._members.items():
            own = {k[len(name) + 1 :]: v for k, v in values.items() if k.startswith(name + ".")}
            instance.enter_initialization(own, stop)
            feeds = [f for f in self._feeds if f.member == name]
            write = instance.writer([f.port for f in feeds])
            read = instance.reader(instance.outputs)
            sources = self._places(f.source for f in feeds)
            outputs = slice(begin, begin + len(instance.outputs))
            parts.append(Member(instance, feeds, write, read, sources, outputs))
            begin = outputs.stop
        self.parts, self._initializing = parts, True
        self.flags[STALE] = True

    def leave_initialization(self) -> None:
        """Let one member after the other leave the mode."""
        self._settle()
        for part in self.parts:
            self._feed(part)
            part.instance.leave_initialization()
            self.values[part.outputs] = part.read()
        self._initializing = False
        self._iterate()
        self.flags[STALE] = False
        self._choose_steps()
        # the shortest: every communication step then ends at samples of the fastest member
        periods = [p.sample_time for p in self._members.values() if p.sample_time > 0]
        self.sample_time = min(periods, default=0.0)

    def _choose_steps(self) -> None:
        """Choose the orders of the steps; the sampled members are known now."""
        hard = self._at_once | {m for m, p in self._members.items() if p.sample_time > 0}
        order = self._ordered(list(self._members), {*self._members}, hard)
        back = self._ordered(order[::-1], hard, cut=-1)
        parts = dict(zip(self._members, self.parts, strict=True))
        self.there, self.back = [parts[m] for m in order], [parts[m] for m in back]
        self.flags[BACK] = False
        # a part with direct feedthrough that is stepped before its source has an outdated output
        self.lags = any(
            way.index(source) > way.index(f.member)
            for f in self._feeds
            if f.member in self._at_once and (source := self._source(f))
            for way in (order, back)
        )

    def _ordered(self, members: list[str], *after: set[str], cut: int = 0) -> list[str]:
        """The order in which each member comes after the members of `after` that feed it.

        If that is impossible, those of the next set count; at last a ring is cut at this member.
        """
        left, ordered = list(members), list[str]()
        fed = {(f.member, self._source(f)) for f in self._feeds}
        while left:
            waits = {m: {s for n, s in fed if n == m} - {m, "", *ordered} for m in left}
            ready = [m for some in after for m in left if not waits[m] & some]
            ordered.append([*ready, left[cut]][0])
            left.remove(ordered[-1])
        return ordered

    def _settle(self) -> None:
        """Set inputs and read outputs in the order in which they depend on each other."""
        known = np.isfinite(self.values)
        known[len(self.inputs) :] = False
        ring = False
        while not known[len(self.inputs) :].all():
            if not sum(self._read(part, known) for part in self.parts):
                ring = True  # begin with the present outputs of one member
                self._read(next(p for p in self.parts if not known[p.outputs].all()), known, True)
        if ring:
            self._iterate()

    def _read(self, part: Member, known: npt.NDArray[np.bool_], all_: bool = False) -> int:
        """Read outputs of a member that are not known and need no others, or all; their number."""
        waits = {f.port for f, k in zip(part.feeds, known[part.sources], strict=True) if not k}
        first, fmu = part.outputs.start, part.instance
        ready = {
            place: y
            for place, y in enumerate(fmu.outputs, first)
            if not known[place] and (all_ or waits.isdisjoint(fmu.initially_from(y)))
        }
        if ready:
            self._feed(part)
            self.values[[*ready]] = fmu.reader([*ready.values()])()
            known[[*ready]] = True
        return len(ready)

    def _iterate(self) -> None:
        """Feed and read all members until nothing changes; solve a ring that does not settle."""
        ring, names = self._places(self._ring), self._ring
        nominal = np.array([self.nominal(n) for n in names])

        def missed(values: Vector) -> Vector:
            """What a sweep from these values of the ring changes in them."""
            self.values[ring] = values
            self._sweep()
            return np.asarray(self.values[ring] - values)

        def settled(change: Vector) -> bool:
            after = self.values[ring]
            small = np.abs(change) <= SETTLED * np.maximum(np.abs(after), nominal)
            return bool(np.all(small | ~np.isfinite(after)))

        for _ in range(SWEEPS):
            if settled(missed(self.values[ring])):
                return
        if not (np.isfinite(self.values[ring]).all() and all(map(self.is_real, names))):
            return
        from scipy.optimize import root

        with np.errstate(all="ignore"):
            values = root(missed, self.values[ring], options={"xtol": 1e-14}).x
        if not settled(change := missed(values)):
            raise StepFailed(
                f"the algebraic loop through {', '.join(names)} has no solution at the "
                f"start: inputs and outputs differ by {np.max(np.abs(change)):.3g}",
                "each of its FMUs has direct feedthrough: check signs and "
                "gains, or add a delay to the loop",
            )

    def _sweep(self) -> None:
        """Feed one member after the other, and read its outputs."""
        for part in self.parts:
            self._feed(part)
            self.values[part.outputs] = part.read()

    def _feed(self, part: Member) -> None:
        values = self.values[part.sources]
        known = np.isfinite(values)
        if known.all() or not self._initializing:
            part.write(values)
        else:
            ports = [f.port for f, k in zip(part.feeds, known, strict=True) if k]
            part.instance.writer(ports)(values[known])

    def writer(self, names: Sequence[str]) -> Writer:
        at = self._places(names)

        def write(values: Vector) -> None:
            self.values[at] = values
            self.flags[STALE] = True

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        at = self._places(names)

        def read() -> Vector:
            if self.flags[STALE]:
                self._settle() if self._initializing else self._sweep()
                self.flags[STALE] = False
            return np.asarray(self.values[at])

        return read

    def reopened(self) -> Group:
        members = {name: p.reopened() for name, p in self._members.items()}
        return Group(self.name, members, self._feeds, self.inputs)

    def close(self) -> None:
        for instance in self._members.values():
            instance.close()

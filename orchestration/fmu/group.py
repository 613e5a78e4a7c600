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
from typing import Any

import numpy as np
import numpy.typing as npt

from .fmu_instance import FmuInstance, Instance, Reader, StepFailed, Value, Writer
from .wiring import Wiring

Vector = npt.NDArray[np.float64]
SETTLED = 1e-12  # largest last change, as a share of a value or of its nominal value
STALE, BACK = range(2)  # flags, see `Group`
SWEEPS = 3  # enough for a ring that is not an algebraic loop


@dataclass(frozen=True)
class Feed:
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
    connected; `reference` has the set-points at the start. StepFailed: a part rejects its values,
    or an algebraic loop has no solution.
    """
    goals = [f"set-point {k}" for k in range(len(wiring.references))]
    feeds = [
        *(Feed(f"plant.{y}", "controller", port) for y, port in wiring.signals),
        *(Feed(f"controller.{u}", "plant", port) for u, port in wiring.commands),
        *(Feed(goal, "controller", r) for goal, r in zip(goals, wiring.references, strict=True)),
    ]
    both = Group("loop", {"plant": plant, "controller": controller}, feeds, goals)
    own = zip(("plant", "controller"), values, strict=True)
    both.enter_initialization({f"{side}.{n}": v for side, vs in own for n, v in vs.items()}, stop)
    both.writer(goals)(reference)
    both.leave_initialization()


class Group:
    """Connected FMU instances as one FMU instance.

    They are stepped one after the other, each with the newest values of those before it: in the
    order of the signals, and in every second step in reverse order. Held values are too early
    for a member in one of the two steps and too late in the other, so that the first order of
    that error cancels. A part with direct feedthrough or with samples is before the parts that it
    feeds in both orders: it may jump at the start of a step. Outputs are named ``member.port``.

    Parameters
    ----------
    name : str
    members : mapping of str to Instance
        Not initialized yet.
    feeds : sequence of Feed
    inputs : sequence of str
        The group's inputs, as named by the feeds.
    turned : bool
        Whether the first step is in reverse order.

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

    def __init__(
        self,
        name: str,
        members: Mapping[str, Instance],
        feeds: Sequence[Feed],
        inputs: Sequence[str],
        turned: bool = False,
    ) -> None:
        self.name = name
        self._turned = turned
        self.inputs: Sequence[str] = list(inputs)
        self.can_save = all(p.can_save for p in members.values())
        self.steps_vary = all(getattr(p, "steps_vary", True) for p in members.values())
        self.sample_time, self.stop = 0.0, math.inf
        self._feeds = list(feeds)
        at_once = {m for m, p in members.items() if any(map(p.follows_at_once, p.outputs))}
        order = _in_order(list(members), feeds, at_once)
        self._members = {m: members[m] for m in order}
        self.outputs: Sequence[str] = [
            f"{m}.{port}" for m, p in self._members.items() for port in p.outputs
        ]
        self.place = {n: k for k, n in enumerate([*self.inputs, *self.outputs])}
        self.values = np.zeros(len(self.place))
        self.parts: list[Member] = []
        self.there: list[Member] = []
        self.back: list[Member] = []
        self.lags = False
        self._initializing = False
        self.flags = np.ones(2, dtype=np.int64)

    def nominal(self, name: str) -> float:
        if name in self.inputs:
            fed = next(f for f in self._feeds if f.source == name)
            return self._members[fed.member].nominal(fed.port)
        member, port = self._split(name)
        return self._members[member].nominal(port)

    def is_real(self, name: str) -> bool:
        if name in self.inputs:
            fed = [f for f in self._feeds if f.source == name]
            return all(self._members[f.member].is_real(f.port) for f in fed)
        member, port = self._split(name)
        return self._members[member].is_real(port)

    def follows_at_once(self, name: str) -> bool:
        member, port = self._split(name)
        return self._members[member].follows_at_once(port)

    def _split(self, name: str) -> tuple[str, str]:
        """Member and port; either may have dots in its name."""
        for member in self._members:
            if name.startswith(member + "."):
                return member, name[len(member) + 1 :]
        raise KeyError(name)

    def initially_from(self, name: str) -> Sequence[str]:
        member, port = self._split(name)
        ports, found, waiting = {(member, port)}, set(), [(member, port)]
        while waiting:
            member, port = waiting.pop()
            inputs = self._members[member].initially_from(port)
            for feed in self._feeds:
                if feed.member != member or feed.port not in inputs:
                    continue
                if feed.source in self.inputs:
                    found.add(feed.source)
                elif (before := self._split(feed.source)) not in ports:
                    ports.add(before)
                    waiting.append(before)
        return sorted(found)

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """Let every member enter the mode; values are named ``member.variable``."""
        self.parts, self.stop = [], stop
        self.values[:] = np.nan  # not known yet
        begin = len(self.inputs)
        for name, instance in self._members.items():
            own = {k[len(name) + 1 :]: v for k, v in values.items() if k.startswith(name + ".")}
            instance.enter_initialization(own, stop)
            feeds = [f for f in self._feeds if f.member == name]
            end = begin + len(instance.outputs)
            self.parts.append(
                Member(
                    instance,
                    feeds,
                    instance.writer([f.port for f in feeds]),
                    instance.reader(instance.outputs),
                    np.array([self.place[f.source] for f in feeds], dtype=np.intp),
                    slice(begin, end),
                )
            )
            begin = end
        self._initializing = True
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
        self.sample_time = min(
            (p.sample_time for p in self._members.values() if p.sample_time > 0), default=0.0
        )

    def _choose_steps(self) -> None:
        """Choose the orders of the steps; the sampled members are known now."""
        at_once = {m for m, p in self._members.items() if any(map(p.follows_at_once, p.outputs))}
        hard = at_once | {m for m, p in self._members.items() if p.sample_time > 0}
        order = _in_order(list(self._members), self._feeds, hard)
        back = _reversed(order, self._feeds, hard)
        parts = dict(self._named_parts())
        self.there, self.back = [parts[m] for m in order], [parts[m] for m in back]
        self.flags[BACK] = self._turned
        # a part with direct feedthrough that is stepped before its source has an outdated output
        self.lags = any(
            f.member in at_once
            and f.source not in self.inputs
            and way.index(self._split(f.source)[0]) > way.index(f.member)
            for f in self._feeds
            for way in (order, back)
        )

    def _settle(self) -> None:
        """Set inputs and read outputs in the order in which they depend on each other."""
        missing = {name: dict.fromkeys(part.instance.outputs) for name, part in self._named_parts()}
        ring = False
        while any(missing.values()):
            found = [self._read(name, part, missing, False) for name, part in self._named_parts()]
            if not any(found):  # a ring: begin with the present outputs of one member
                ring = True
                name, part = next((n, p) for n, p in self._named_parts() if missing[n])
                self._read(name, part, missing, True)
        if ring:
            self._iterate()

    def _named_parts(self) -> Iterable[tuple[str, Member]]:
        return zip(self._members, self.parts, strict=True)

    def _read(
        self, name: str, part: Member, missing: Mapping[str, dict[str, None]], all_: bool
    ) -> bool:
        """Read a member's missing outputs that need no others, or all; return whether any was."""
        waits = {f.port for f in part.feeds if not self._is_known(f.source, missing)}
        ready = [
            port
            for port in missing[name]
            if all_ or waits.isdisjoint(part.instance.initially_from(port))
        ]
        if ready:
            self._feed(part)
            values = part.instance.reader(ready)()
            self.values[[self.place[f"{name}.{port}"] for port in ready]] = values
            for port in ready:
                del missing[name][port]
        return bool(ready)

    def _is_known(self, source: str, missing: Mapping[str, dict[str, None]]) -> bool:
        if source in self.inputs:
            return bool(np.isfinite(self.values[self.place[source]]))
        member, port = self._split(source)
        return port not in missing[member]

    def _iterate(self) -> None:
        """Feed and read all members until nothing changes; solve a ring that does not settle.

        Raises
        ------
        StepFailed
            If it has no solution.
        """
        ring = self._ring()
        for _ in range(SWEEPS):
            before = self.values[ring]
            self._sweep()
            if self._agree(before, ring):
                return
        before = self.values[ring]
        names = [n for n, place in self.place.items() if place in ring]
        if np.isfinite(before).all() and all(map(self.is_real, names)):
            self._solve(ring)
            before = self.values[ring]
            self._sweep()
        if not self._agree(before, ring):
            missed = np.max(np.abs(self.values[ring] - before))
            raise StepFailed(
                f"the algebraic loop through {', '.join(names)} has no solution at the "
                f"start: inputs and outputs differ by {missed:.3g}",
                "each of its FMUs has direct feedthrough: check signs and "
                "gains, or add a delay to the loop",
            )

    def _ring(self) -> list[int]:
        """Places of the outputs that feed their own member or an earlier one."""
        order = list(self._members)
        back = {
            self.place[f.source]
            for f in self._feeds
            if f.source not in self.inputs
            and order.index(self._split(f.source)[0]) >= order.index(f.member)
        }
        return sorted(back)

    def _agree(self, before: Vector, ring: Sequence[int]) -> bool:
        after = self.values[ring]
        names = [*self.inputs, *self.outputs]
        size = np.maximum(np.abs(after), [self.nominal(names[place]) for place in ring])
        same = np.abs(after - before) <= SETTLED * size
        return bool(np.all(same | ~np.isfinite(after)))

    def _solve(self, ring: Sequence[int]) -> None:
        from scipy.optimize import root

        def missed(values: Vector) -> Vector:
            self.values[ring] = values
            self._sweep()
            change: Vector = self.values[ring] - values
            return change

        with np.errstate(all="ignore"):
            self.values[ring] = root(missed, self.values[ring], options={"xtol": 1e-14}).x

    def _sweep(self) -> None:
        """Feed one member after the other, and read its outputs."""
        for part in self.parts:
            self._feed(part)
            self.values[part.outputs] = part.read()

    def _feed(self, part: Member) -> None:
        values = self.values[part.sources]
        if self._initializing and not np.isfinite(values).all():  # some are not known yet
            known = np.isfinite(values)
            ports = [f.port for f, k in zip(part.feeds, known, strict=True) if k]
            part.instance.writer(ports)(values[known])
        else:
            part.write(values)

    def writer(self, names: Sequence[str]) -> Writer:
        at = np.array([self.place[n] for n in names], dtype=np.intp)

        def write(values: Vector) -> None:
            self.values[at] = values
            self.flags[STALE] = True

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        at = np.array([self.place[n] for n in names], dtype=np.intp)

        def read() -> Vector:
            if self.flags[STALE]:
                self._settle() if self._initializing else self._sweep()
                self.flags[STALE] = False
            values: Vector = self.values[at]
            return values

        return read

    def step(self, t: float, h: float) -> None:
        for part in self.back if self.flags[BACK] else self.there:
            self._feed(part)
            part.instance.step(t, h)
            self.values[part.outputs] = part.read()
        self.flags[:] = self.lags, not self.flags[BACK]

    def is_compiled(self) -> bool:
        """Whether compiled code can call its members itself; see `c/group.c`."""
        return all(
            isinstance(p.instance, FmuInstance)
            and p.instance.is_compiled([*(f.port for f in p.feeds), *p.instance.outputs])
            for p in self.parts
        )

    def save(self) -> Any:
        states = [p.instance.save() for p in self.parts]
        return states, self.values.copy(), self.flags.copy()

    def restore(self, state: Any) -> None:
        states, values, flags = state
        self.values[:], self.flags[:] = values, flags
        for part, saved in zip(self.parts, states, strict=True):
            part.instance.restore(saved)

    def release(self, state: Any) -> None:
        for part, saved in zip(self.parts, state[0], strict=True):
            part.instance.release(saved)

    def reopened(self, turned: bool = False) -> Group:
        members = {name: p.reopened() for name, p in self._members.items()}
        return Group(self.name, members, self._feeds, self.inputs, turned)

    def close(self) -> None:
        for instance in self._members.values():
            instance.close()


def _in_order(members: list[str], feeds: Sequence[Feed], hard: set[str]) -> list[str]:
    """Order the members so that each comes after the members that feed it.

    A ring is cut at the first member in the list that waits for no `hard` member.
    """
    waiting = {m: _feeders(m, members, feeds) for m in members}
    ordered: list[str] = []
    while waiting:
        done = set(ordered)
        ready = [m for m, needs in waiting.items() if needs <= done]
        ready += [m for m, needs in waiting.items() if needs & hard <= done]
        ordered.append(ready[0] if ready else next(iter(waiting)))
        del waiting[ordered[-1]]
    return ordered


def _reversed(order: list[str], feeds: Sequence[Feed], hard: set[str]) -> list[str]:
    """The reverse order, but each member after the `hard` members that feed it."""
    left, ordered = order[::-1], list[str]()
    while left:
        needs = {m: _feeders(m, order, feeds) & hard for m in left}
        ready = [m for m in left if needs[m] <= set(ordered)]
        ordered.append(ready[0] if ready else left[-1])
        left.remove(ordered[-1])
    return ordered


def _feeders(member: str, members: list[str], feeds: Sequence[Feed]) -> set[str]:
    return {
        other
        for other in members
        for f in feeds
        if f.member == member and other != member and f.source.startswith(other + ".")
    }

"""Several FMUs as one FMU instance: what stands between a plant and its commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .fmu_instance import Instance, Reader, Writer

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Feed:
    """A member's input = factor * source + offset.

    Attributes
    ----------
    source : str
        A member's output as ``member.port``, or an input of the group.
    """

    source: str
    member: str
    port: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class _Member:
    instance: Instance
    write: Writer
    read: Reader
    sources: npt.NDArray[np.intp]
    factors: Vector
    offsets: Vector
    outputs: slice


class Group:
    """Participants that feed each other, as one FMU instance.

    They are stepped one after the other in the order of the signals, each with the newest values of
    those before it. Outputs are named ``member.port``.

    Parameters
    ----------
    name : str
    members : mapping of str to Participant
        Not initialized yet.
    feeds : sequence of Feed
    inputs : sequence of str
        The group's own, as the feeds name them.
    """

    def __init__(
        self,
        name: str,
        members: Mapping[str, Instance],
        feeds: Sequence[Feed],
        inputs: Sequence[str],
    ) -> None:
        self.name = name
        self.inputs: Sequence[str] = list(inputs)
        self.can_save = all(p.can_save for p in members.values())
        self.sample_time = 0.0
        self._feeds = list(feeds)
        self._members = {m: members[m] for m in _in_order(list(members), feeds)}
        self.outputs: Sequence[str] = [
            f"{m}.{port}" for m, p in self._members.items() for port in p.outputs
        ]
        self._place = {n: k for k, n in enumerate([*self.inputs, *self.outputs])}
        self._values = np.zeros(len(self._place))
        self._parts: list[_Member] = []
        self._stale = True

    def nominal(self, name: str) -> float:
        if name in self.inputs:
            fed = next(f for f in self._feeds if f.source == name)
            return self._members[fed.member].nominal(fed.port) / (abs(fed.factor) or 1.0)
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

    def initialize(self, values: Mapping[str, float], stop: float) -> None:
        """Initialize every member; values are named ``member.variable``."""
        self._parts = []
        begin = len(self.inputs)
        for name, instance in self._members.items():
            own = {k[len(name) + 1 :]: v for k, v in values.items() if k.startswith(name + ".")}
            instance.initialize(own, stop)
            feeds = [f for f in self._feeds if f.member == name]
            end = begin + len(instance.outputs)
            self._parts.append(
                _Member(
                    instance,
                    instance.writer([f.port for f in feeds]),
                    instance.reader(instance.outputs),
                    np.array([self._place[f.source] for f in feeds], dtype=np.intp),
                    np.array([f.factor for f in feeds]),
                    np.array([f.offset for f in feeds]),
                    slice(begin, end),
                )
            )
            self._values[begin:end] = self._parts[-1].read()
            begin = end
        # the shortest: every communication step then ends at samples of the fastest member
        self.sample_time = min(
            (p.sample_time for p in self._members.values() if p.sample_time > 0), default=0.0
        )
        self._stale = True

    def _feed(self, part: _Member) -> None:
        part.write(part.factors * self._values[part.sources] + part.offsets)

    def writer(self, names: Sequence[str]) -> Writer:
        at = np.array([self._place[n] for n in names], dtype=np.intp)

        def write(values: Vector) -> None:
            self._values[at] = values
            self._stale = True

        return write

    def reader(self, names: Sequence[str]) -> Reader:
        at = np.array([self._place[n] for n in names], dtype=np.intp)

        def read() -> Vector:
            if self._stale:
                for part in self._parts:
                    self._feed(part)
                    self._values[part.outputs] = part.read()
                self._stale = False
            values: Vector = self._values[at]
            return values

        return read

    def step(self, t: float, h: float) -> None:
        for part in self._parts:
            self._feed(part)
            part.instance.step(t, h)
            self._values[part.outputs] = part.read()
        self._stale = False

    def save(self) -> Any:
        states = [p.instance.save() for p in self._parts]
        return states, self._values.copy(), self._stale

    def restore(self, state: Any) -> None:
        states, values, self._stale = state
        self._values[:] = values
        for part, saved in zip(self._parts, states, strict=True):
            part.instance.restore(saved)

    def release(self, state: Any) -> None:
        for part, saved in zip(self._parts, state[0], strict=True):
            part.instance.release(saved)

    def reopened(self) -> Group:
        members = {name: p.reopened() for name, p in self._members.items()}
        return Group(self.name, members, self._feeds, self.inputs)

    def close(self) -> None:
        for instance in self._members.values():
            instance.close()


def _in_order(members: list[str], feeds: Sequence[Feed]) -> list[str]:
    """Members so that each comes after those that feed it; a ring is cut at the first listed."""
    waiting = {m: _feeders(m, members, feeds) for m in members}
    ordered: list[str] = []
    while waiting:
        ready = next((m for m, needs in waiting.items() if needs <= set(ordered)), None)
        ordered.append(ready or next(iter(waiting)))
        del waiting[ordered[-1]]
    return ordered


def _feeders(member: str, members: list[str], feeds: Sequence[Feed]) -> set[str]:
    return {
        other
        for other in members
        for f in feeds
        if f.member == member and other != member and f.source.startswith(other + ".")
    }

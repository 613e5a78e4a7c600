"""FMU instances with something changed: the units of their ports, or when they are stepped."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from ...fmus.ports import law_ports
from .fmu_instance import Instance, Reader, Value, Writer

Vector = npt.NDArray[np.float64]
Scale = tuple[float, float]
"""Factor and offset: result = factor * value + offset."""
AS_IS: Scale = (1.0, 0.0)
Kind = TypeVar("Kind", bound=Instance)
CLOSE = 1e-6  # of a period: times closer than this are the same


class _Wrapped:
    """What is not changed is passed on to the instance."""

    def __init__(self, instance: Instance) -> None:
        self._instance = instance

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instance, name)


def converted(instance: Kind, scales: Mapping[str, Scale]) -> Kind:
    """The instance with its ports in other units; itself if nothing changes.

    Parameters
    ----------
    instance : Instance
    scales : mapping of str to Scale
        By port: of inputs from the given unit to its own, of outputs from its own to the given.
        Parameters and start values stay in its own units.
    """
    changed = {name: scale for name, scale in scales.items() if scale != AS_IS}
    return cast("Kind", _Converted(instance, changed)) if changed else instance


class _Converted(_Wrapped):
    def __init__(self, instance: Instance, scales: Mapping[str, Scale]) -> None:
        super().__init__(instance)
        self._scales = scales

    def nominal(self, name: str) -> float:
        factor = abs(self._scales.get(name, AS_IS)[0])
        own = self._instance.nominal(name)
        return own / (factor or 1.0) if name in self._instance.inputs else own * factor

    def _arrays(self, names: Sequence[str]) -> tuple[Vector, Vector]:
        scales = np.array([self._scales.get(name, AS_IS) for name in names]).reshape(-1, 2)
        return scales[:, 0], scales[:, 1]

    def writer(self, names: Sequence[str]) -> Writer:
        write, (factors, offsets) = self._instance.writer(names), self._arrays(names)
        return lambda values: write(factors * values + offsets)

    def reader(self, names: Sequence[str]) -> Reader:
        read, (factors, offsets) = self._instance.reader(names), self._arrays(names)
        return lambda: factors * read() + offsets

    def reopened(self) -> _Converted:
        return _Converted(self._instance.reopened(), self._scales)


def sampled_every(instance: Kind, period: float) -> Kind:
    """The instance as a digital controller, stepped every `period` [s] for any steps of its master.

    At each sample it gets the signals and makes a step as long as the sampling period. Its outputs
    after this step are applied from the sample on, and held until the next one.

    Parameters
    ----------
    instance : Instance
        Not initialized.
    period : float
        [s]
    """
    return cast("Kind", _Sampled(instance, period))


class _Sampled(_Wrapped):
    steps_vary = True  # the steps of the master are not those of the FMU

    def __init__(self, instance: Instance, period: float) -> None:
        super().__init__(instance)
        self.sample_time = period
        # a feedback law between samples is not applied by a digital controller
        law = law_ports(instance.outputs, instance.outputs, instance.inputs)
        self.outputs = [name for name in instance.outputs if name not in law]
        self._initialized = False
        self._samples = 0
        self._given: dict[int, tuple[Writer, Vector]] = {}

    @property
    def can_save(self) -> bool:
        return self._instance.can_save

    @can_save.setter
    def can_save(self, can: bool) -> None:
        self._instance.can_save = can

    def initialize(self, values: Mapping[str, Value], stop: float) -> None:
        self.enter_initialization(values, stop)
        self.leave_initialization()

    def enter_initialization(self, values: Mapping[str, Value], stop: float) -> None:
        """As for the FMU itself, but the stop time is the end of a period."""
        last = math.ceil(stop / self.sample_time - CLOSE) * self.sample_time
        self._instance.enter_initialization(values, last)

    def leave_initialization(self) -> None:
        self._instance.leave_initialization()
        self._initialized = True

    def writer(self, names: Sequence[str]) -> Writer:
        write = self._instance.writer(names)
        number = id(write)

        def keep(values: Vector) -> None:
            if not self._initialized:
                write(values)
                return
            self._given.pop(number, None)  # the last written values are passed on last
            self._given[number] = write, np.array(values, dtype=float)

        return keep

    def step(self, t: float, h: float) -> None:
        period = self.sample_time
        while self._samples * period < t + h - CLOSE * period:
            for write, values in self._given.values():
                write(values)
            self._instance.step(self._samples * period, period)
            self._samples += 1

    def save(self) -> Any:
        return self._instance.save(), self._samples, dict(self._given)

    def restore(self, state: Any) -> None:
        inner, self._samples, given = state
        self._given = dict(given)
        self._instance.restore(inner)

    def release(self, state: Any) -> None:
        self._instance.release(state[0])

    def reopened(self) -> _Sampled:
        return _Sampled(self._instance.reopened(), self.sample_time)

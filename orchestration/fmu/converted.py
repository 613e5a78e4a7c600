"""An FMU instance whose ports have other units than its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from .fmu_instance import Instance, Reader, Writer

Vector = npt.NDArray[np.float64]
Scale = tuple[float, float]
"""Factor and offset: result = factor * value + offset."""
AS_IS: Scale = (1.0, 0.0)
Kind = TypeVar("Kind", bound=Instance)


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
    return _Converted(instance, changed) if changed else instance  # type: ignore[return-value]


class _Converted:
    """See `converted`; everything else is passed on to the instance."""

    def __init__(self, instance: Instance, scales: Mapping[str, Scale]) -> None:
        self._instance, self._scales = instance, scales

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instance, name)

    @property
    def sample_time(self) -> float:
        return self._instance.sample_time

    @sample_time.setter
    def sample_time(self, seconds: float) -> None:
        self._instance.sample_time = seconds

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

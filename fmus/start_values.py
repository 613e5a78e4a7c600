"""Give a compiled component other start values: parameters and initial states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..solver.kernel import Kernel
from .interface import START


def with_start_values(
    kernel: Kernel, values: Mapping[str, float], sources: Mapping[str, str]
) -> Kernel:
    """A copy whose parameters, and initial states by ``x_start``, have these values as defaults.

    Parameters
    ----------
    kernel : Kernel
    values : mapping of str to float
        Each the name of a parameter, or of a state with ``_start``.
    sources : mapping of str to str
        Where parameters' values come from; their descriptions say it.
    """
    return replace(
        kernel,
        parameters=[
            replace(p, default=values[p.name], source=sources[p.name]) if p.name in values else p
            for p in kernel.parameters
        ],
        states=[replace(s, start=values.get(s.name + START, s.start)) for s in kernel.states],
        discrete=[replace(s, start=values.get(s.name + START, s.start)) for s in kernel.discrete],
    )

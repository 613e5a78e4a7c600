"""Give a compiled component other start values: parameters and initial states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..solver.kernel import Kernel
from ..solver.set_point import START_VALUE
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
        Sources of parameter values, added to their descriptions.
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


def with_set_point(kernel: Kernel) -> Kernel:
    """A copy of a controller or a loop whose set-point starts at the default set-point of a run."""
    return replace(
        kernel,
        inputs=[
            replace(i, start=START_VALUE) if i.role == "reference" else i for i in kernel.inputs
        ],
    )

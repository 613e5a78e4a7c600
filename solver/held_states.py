"""Discrete states as states, constant between samples, for tangents and Poincare sections."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from .component import Component, Event, Mode, State

_NEVER = sp.Integer(-1)  # an indicator that is never positive: only the clock triggers it


def with_held_states(component: Component) -> Component:
    """The same component with its discrete states among the states.

    Their derivatives are zero, and their update is the first event of every mode;
    `follow_tangents` and `follow_returns` trigger it at the multiples of the sample time.

    Parameters
    ----------
    component : Component
        With discrete states; the new states have the same names.
    """
    held = tuple(
        State(d.name, d.unit, d.meaning, sp.Integer(0), d.start, d.nominal)
        for d in component.discrete
    )
    sample = Event("sample", _NEVER, 1, {d.name: d.update for d in component.discrete})
    modes = component.modes or (Mode("sampled"),)
    return replace(
        component,
        states=(*component.states, *held),
        discrete=(),
        modes=tuple(replace(m, events=(sample, *m.events)) for m in modes),
    )

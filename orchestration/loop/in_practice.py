"""A controller in practice: sampled, and with the instruments of its axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...plant.instruments import INSTRUMENTS
from ...solver.errors import ContractError
from ...solver.set_point import MEASURED
from ..fmu.fmu_instance import SAMPLE_TIME
from .catalogue import component
from .parts import Part

if TYPE_CHECKING:
    from ...solver.component import Component


@dataclass(frozen=True)
class Practice:
    """Sampling and instruments added to a controller."""

    sampled: bool  # whether it is to be sampled; False if it already is
    instruments: tuple[str, ...] = ()  # names of the catalogue, in the order of the signals
    ideal: tuple[str, ...] = ()  # signals without an instrument: it gets their true values
    period: str = SAMPLE_TIME  # name of the parameter with its sampling period

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""
        if not self.ideal:
            return ()
        return (f"no instrument measures {', '.join(self.ideal)}: the true value is used",)


def practice_of(controller: Component, sampled: bool, noise: bool) -> Practice:
    """Sampling and instruments for a controller.

    With `noise` it measures through all instruments that fit; raises `ContractError` if none does.
    """
    own = controller.sample_time
    sampled, period = sampled and not own, own.name if own else SAMPLE_TIME
    if not noise:
        return Practice(sampled, period=period)
    used = {str(s) for s in controller.used_symbols()}
    measured = [
        i.name for i in controller.inputs if i.role in ("measurement", "signal") and i.name in used
    ]
    wanted, given, instruments = {*measured}, set[str](), list[str]()
    for name in reversed(INSTRUMENTS):  # an instrument may use the output of the one before it
        instrument = component(name)
        outputs = {o.name.removesuffix(MEASURED) for o in instrument.outputs}
        if outputs & wanted:
            instruments.append(name)
            given |= outputs
            wanted |= {i.name for i in instrument.inputs}
    if not instruments:
        there = ", ".join(o.name for n in INSTRUMENTS for o in component(n).outputs)
        raise ContractError(
            f"{controller.name} measures {', '.join(measured) or 'nothing'}, but the instruments "
            "measure "
            f"{there}"
        )
    ideal = tuple(name for name in measured if name not in given)
    return Practice(sampled, (*reversed(instruments),), ideal, period)


def in_practice(
    controller: Part, sampled: float | None, noise: bool
) -> tuple[Part, dict[str, float], tuple[str, ...]]:
    """A controller with sampling at a period [s] and with instruments, see `practice_of`.

    Returns the part, its sampling period by the parameter's name, and notes. An FMU is not changed:
    the run steps it at its samples, see `Loop.sampled`. Raises `ContractError` for an FMU with
    `noise` or a controller for which this is not possible, `UnknownName`, `ContractError`.
    """
    if sampled is None and not noise:
        return controller, {}, ()
    if not controller.has_equations:
        if not noise:
            return controller, {}, ()
        raise ContractError(
            f"{controller} is an FMU without equations; it cannot get instruments here; "
            "expected a name or FILE.py:FUNCTION"
        )
    named = controller.named
    base = str(replace(named, instruments=(), units=()))
    if noise and named.instruments:
        raise ContractError(f"{controller} already has instruments; expected {base} alone")
    practice = practice_of(component(base), sampled is not None, noise)
    instruments = (*named.instruments, *practice.instruments)
    put = replace(named, sampled=named.sampled or practice.sampled, instruments=instruments)
    period = {} if sampled is None else {practice.period: sampled}
    return Part(str(put)), period, practice.notes

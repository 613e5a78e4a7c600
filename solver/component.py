"""The component contract: what a plant, a controller or an instrument is made of.

A component contains equations and the meaning of their symbols, nothing else. It is independent of
how it is solved, exported or coupled. `docs/contract.md` shows six components written with it.

Expressions are SymPy expressions whose free symbols are identified by *name*: a parameter, an
input, a state, a delayed signal or the time ``t``. Make symbols with `symbol`, so that assumptions
agree.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import sympy as sp

from .checks import check
from .errors import ContractError
from .functions import TIME as TIME
from .functions import symbol as symbol
from .functions import symbols_in
from .signals import SET_POINT, set_point_orders
from .signals import Input as Input
from .signals import Parameter as Parameter
from .signals import unit_in as unit_in

Number = float | int


@dataclass(frozen=True)
class State:
    """A continuous state; `derivative` may be None if a `ForceBalance` supplies it.

    ``nominal`` is a typical magnitude: the absolute tolerance of the solver is the
    relative tolerance times ``nominal``.
    """

    name: str
    unit: str
    meaning: str
    derivative: sp.Expr | None = None
    start: float = 0.0
    nominal: float = 1.0


@dataclass(frozen=True)
class DiscreteState:
    """A value that changes at sample instants only: ``update`` is its next value."""

    name: str
    unit: str
    meaning: str
    update: sp.Expr
    start: float = 0.0
    nominal: float = 1.0


@dataclass(frozen=True)
class Output:
    name: str
    unit: str
    meaning: str
    value: sp.Expr
    nominal: float = 1.0


@dataclass(frozen=True)
class ForceTerm:
    """A named force in a balance, with the states and parameters that only it needs.

    A cause found in data adds or replaces one term; its parameters, Jacobian and FMU come
    from the same equations as everything else.
    """

    name: str
    force: sp.Expr
    meaning: str
    states: tuple[State, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    outputs: tuple[Output, ...] = ()


@dataclass(frozen=True)
class ForceBalance:
    """``d(state)/dt = (sum of the terms) / inertia``."""

    state: str
    inertia: sp.Expr
    terms: tuple[ForceTerm, ...]


@dataclass(frozen=True)
class Event:
    """Event that ends a mode, or resets states within it.

    Parameters
    ----------
    indicator : expression
    direction : {1, -1, 0}
        1: the event happens when the indicator is positive: at its upward crossing, or
        at once if it is positive when a mode begins or an input jumps. -1: the same for a
        negative indicator. 0: only at a change of sign, in either direction.
    reset : mapping of str to expression
        States and their values after the event, all computed from the values before it.
    next_mode : str, optional
        Default: the mode does not change.
    """

    name: str
    indicator: sp.Expr
    direction: int = 0
    reset: Mapping[str, sp.Expr] = field(default_factory=dict)
    next_mode: str | None = None


@dataclass(frozen=True)
class Mode:
    """Equations that hold in one mode: derivatives and outputs that differ from the common ones.

    The first mode of a component is the one it starts in.

    Parameters
    ----------
    signs : mapping of str to {-1, 0, 1}
        States whose sign does not change before an event ends the mode. In a connected component,
        ``sign`` and ``Abs`` of these states use these signs, so that they jump with the event.
    """

    name: str
    derivatives: Mapping[str, sp.Expr] = field(default_factory=dict)
    outputs: Mapping[str, sp.Expr] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    signs: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Delay:
    """A symbol `name`: `expression` as it was `duration` seconds ago, and `start` before that.

    Parameters
    ----------
    name : str
    expression : expression
    duration : expression
        Contains parameters and numbers only; more than 0 [s].
    unit : str
    start : float
        Value of the signal until `duration` has passed.
    nominal : float
        Typical magnitude, which scales the tolerance of the stored signal.
    """

    name: str
    expression: sp.Expr
    duration: sp.Expr
    unit: str = "1"
    start: float = 0.0
    nominal: float = 1.0

    @property
    def rate(self) -> str:
        """Name of the delayed signal's derivative by time in generated equations."""
        return f"{self.name}_rate_"


def _mapped(thing: Any, change: Callable[[Any], Any]) -> Any:
    """A copy of a part of the contract, or of several, with each part in it changed, inner first.

    What `change` gets is a part, such as a `Mode`, an expression, or another value of a field.
    """
    if isinstance(thing, tuple):
        return tuple(_mapped(part, change) for part in thing)
    if isinstance(thing, Mapping):
        return {key: _mapped(value, change) for key, value in thing.items()}
    if is_dataclass(thing) and not isinstance(thing, type):
        thing = replace(
            thing, **{f.name: _mapped(getattr(thing, f.name), change) for f in fields(thing)}
        )
    return change(thing)


def _replaced(replacements: Mapping[sp.Expr, sp.Expr]) -> Callable[[Any], Any]:
    """The change that replaces symbols, or other expressions, in expressions."""
    table = dict(replacements)
    return lambda thing: thing.xreplace(table) if isinstance(thing, sp.Basic) else thing


def replaced(thing: Any, replacements: Mapping[sp.Expr, sp.Expr]) -> Any:
    """A part of the contract, or several, with symbols replaced in every equation."""
    return _mapped(thing, _replaced(replacements))


def in_units(thing: Any, words: Mapping[str, str]) -> Any:
    """A part of the contract, or several, with unit names replaced, see `unit_in`."""

    def change(part: Any) -> Any:
        if is_dataclass(part) and not isinstance(part, type) and hasattr(part, "unit"):
            return replace(part, unit=unit_in(part.unit, words))
        return part

    return _mapped(thing, change)


def _spelled(thing: object) -> str:
    """Complete text of a part of the contract, with all digits of the numbers."""
    if is_dataclass(thing):
        parts = [_spelled(getattr(thing, f.name)) for f in fields(thing)]
        return f"{type(thing).__name__}({', '.join(parts)})"
    if isinstance(thing, tuple | list):
        return f"({', '.join(map(_spelled, thing))})"
    if isinstance(thing, Mapping):
        return f"{{{', '.join(f'{key!r}: {_spelled(value)}' for key, value in thing.items())}}}"
    return str(sp.srepr(thing))


@dataclass(frozen=True, repr=False)
class Component:
    """Equations, and what their symbols mean.

    Parameters
    ----------
    name : str
        An identifier; the FMU's model name follows from it.
    description : str
        One sentence.
    sample_time : Parameter, optional
        Period of the discrete states' updates [s]. A component with discrete states needs it.

    Raises
    ------
    ContractError
        If a symbol is declared twice, used and not declared, or lacks an equation, or an equation
        contains a function that is not in `solver.functions.FUNCTIONS`.
    """

    name: str
    description: str
    parameters: tuple[Parameter, ...] = ()
    inputs: tuple[Input, ...] = ()
    states: tuple[State, ...] = ()
    outputs: tuple[Output, ...] = ()
    balances: tuple[ForceBalance, ...] = ()
    discrete: tuple[DiscreteState, ...] = ()
    sample_time: Parameter | None = None
    modes: tuple[Mode, ...] = ()
    delays: tuple[Delay, ...] = ()

    def __post_init__(self) -> None:
        orders = set_point_orders([i.name for i in self.inputs])
        if any(i.name == SET_POINT and i.role == "reference" for i in self.inputs):
            derived = {n: "reference_derivative" for n, order in orders.items() if order}
            inputs = (replace(i, role=derived.get(i.name, i.role)) for i in self.inputs)
            object.__setattr__(self, "inputs", tuple(inputs))
        check(self)

    def __repr__(self) -> str:
        inputs, outputs = ([p.name for p in ports] for ports in (self.inputs, self.all_outputs))
        return (
            f"<Component {self.name}: {self.description}; inputs {', '.join(inputs) or 'none'}; "
            f"outputs {', '.join(outputs) or 'none'}; states {len(self.all_states)}>"
        )

    @cached_property
    def digest(self) -> str:
        """Hash of the complete component; any difference gives another hash."""
        return hashlib.sha256(_spelled(self).encode()).hexdigest()[:16]

    @cached_property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the component, then of its force terms, then the sample time."""
        own = self.parameters + tuple(p for term in self.terms for p in term.parameters)
        return own + ((self.sample_time,) if self.sample_time else ())

    @cached_property
    def all_states(self) -> tuple[State, ...]:
        return self.states + tuple(s for term in self.terms for s in term.states)

    @cached_property
    def all_outputs(self) -> tuple[Output, ...]:
        return self.outputs + tuple(o for term in self.terms for o in term.outputs)

    @property
    def terms(self) -> tuple[ForceTerm, ...]:
        return tuple(term for balance in self.balances for term in balance.terms)

    @cached_property
    def derivatives(self) -> tuple[sp.Expr, ...]:
        """One expression per state of `all_states`, in that order."""
        balanced = {
            b.state: sp.Add(*[term.force for term in b.terms]) / b.inertia for b in self.balances
        }
        return tuple(
            balanced[s.name] if s.derivative is None else sp.sympify(s.derivative)
            for s in self.all_states
        )

    def derivative(self, state: str) -> sp.Expr:
        """The time derivative of one state."""
        names = [s.name for s in self.all_states]
        if state not in names:
            raise ContractError(f"{self.name}: no state {state!r}; it has {', '.join(names)}")
        return self.derivatives[names.index(state)]

    def output(self, name: str) -> Output:
        for output in self.all_outputs:
            if output.name == name:
                return output
        raise ContractError(f"{self.name}: no output {name!r}")

    def with_force(self, term: ForceTerm, balance: str = "v", replaces: str = "") -> Component:
        """A copy with one more force term, or with the term named `replaces` exchanged for it."""
        if balance not in [b.state for b in self.balances]:
            raise ContractError(f"{self.name}: no force balance of {balance!r}")
        if any(balance in mode.derivatives for mode in self.modes):
            raise ContractError(
                f"{self.name}: its modes have their own equations for {balance!r}, which a new "
                "force would not reach; add forces before the modes"
            )
        changed = []
        for b in self.balances:
            terms = tuple(t for t in b.terms if t.name != replaces)
            if b.state == balance:
                if replaces and len(terms) == len(b.terms):
                    names = ", ".join(t.name for t in b.terms)
                    raise ContractError(f"{self.name}: no force term {replaces!r}; it has {names}")
                terms += (term,)
            changed.append(replace(b, terms=terms))
        return replace(self, balances=tuple(changed))

    def with_defaults(self, values: Mapping[str, float], source: str) -> Component:
        """A copy with other default values of parameters, and their sources."""
        known = {p.name for p in self.all_parameters}
        for name in values:
            if name not in known:
                raise ContractError(f"{self.name}: no parameter {name!r}; it has {sorted(known)}")

        def change(part: Any) -> Any:
            if isinstance(part, Parameter) and part.name in values:
                return replace(part, default=float(values[part.name]), source=source)
            return part

        copy: Component = _mapped(self, change)
        return copy

    def substituted(
        self, replacements: Mapping[sp.Symbol, sp.Expr], **changes: object
    ) -> Component:
        """A copy in which symbols are replaced in every equation, and fields by `changes`."""
        return replace(self, **{**self.equations_with(replacements), **changes})

    def in_units(self, words: Mapping[str, str]) -> Component:
        """A copy with unit names replaced: the same numbers are then of other quantities."""
        converted: Component = in_units(self, words)
        return converted

    def prefixed(self, prefix: str) -> Component:
        """A copy with ``prefix + name`` for all but inputs and outputs, which connect it."""
        named = self.all_parameters, self.all_states, self.discrete, self.delays
        names = [each.name for group in named for each in group]
        swap = _replaced({symbol(name): symbol(prefix + name) for name in names})

        def keyed(table: Mapping[str, Any]) -> dict[str, Any]:
            return {prefix + name: value for name, value in table.items()}

        def change(part: Any) -> Any:
            if isinstance(part, Parameter | State | DiscreteState | Delay):
                return replace(part, name=prefix + part.name)
            if isinstance(part, Mode):
                return replace(part, derivatives=keyed(part.derivatives), signs=keyed(part.signs))
            if isinstance(part, Event):
                return replace(part, reset=keyed(part.reset))
            if isinstance(part, ForceBalance):
                return replace(part, state=prefix + part.state)
            return swap(part)

        own = {f.name: _mapped(getattr(self, f.name), change) for f in fields(self)}
        return replace(self, **own)

    def equations_with(self, replacements: Mapping[sp.Symbol, sp.Expr]) -> dict[str, Any]:
        """The fields that hold equations, with symbols replaced, for making another component."""
        names = "states outputs discrete modes delays balances".split()
        return {name: replaced(getattr(self, name), replacements) for name in names}

    def used_symbols(self) -> frozenset[sp.Symbol]:
        """The symbols in all equations."""
        return frozenset().union(*(symbols_in(sp.sympify(e)) for _, e in self.expressions()))

    def expressions(self) -> Iterable[tuple[str, sp.Expr]]:
        """Every equation, and its place in words."""
        for state, derivative in zip(self.all_states, self.derivatives, strict=True):
            yield f"the derivative of {state.name}", derivative
        for output in self.all_outputs:
            yield f"output {output.name}", output.value
        for discrete in self.discrete:
            yield f"the update of {discrete.name}", discrete.update
        for delay in self.delays:
            yield f"delay {delay.name}", delay.expression
            yield f"the duration of delay {delay.name}", delay.duration
        for mode in self.modes:
            for name, expression in {**mode.derivatives, **mode.outputs}.items():
                yield f"{name} in mode {mode.name}", expression
            for event in mode.events:
                yield f"event {event.name}", event.indicator
                for name, expression in event.reset.items():
                    yield f"the reset of {name} by event {event.name}", expression

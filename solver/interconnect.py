"""Join components into one component: one system of equations.

`connect` joins a plant and a controller by the names of their signals.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, product
from typing import Any

import sympy as sp

from .component import Component, DiscreteState, Event, Input, Mode, Parameter, replaced, symbol
from .errors import ContractError
from .functions import symbols_in
from .kernel import CONTROLLER, PLANT
from .signals import REFERENCES, set_point_orders

Values = dict[str, sp.Expr]
"""Signals as functions of states, parameters and outer inputs; outputs by ``part.output``."""
Table = dict[sp.Expr, sp.Expr]


def interconnect(
    parts: Mapping[str, Component],
    connections: Mapping[str, str],
    inputs: Sequence[str | Input],
    outputs: Mapping[str, str],
    name: str = "",
    description: str = "",
) -> Component:
    """Join components into one component.

    At a sample instant a part reads the new values of the parts that feed it. If sampled
    parts form a circle, the first of them in `parts` reads the previous value. There is one
    mode for each combination of modes of the parts.

    Parameters
    ----------
    parts : mapping of str to Component
        By name. Parameters and states are called ``<part>_<name>``; for a part with an empty name
        they keep their names. All sampled parts have one period, the parameter of the first.
    connections : mapping of str to str
        Inputs and their sources: ``"part.input": "part.output"``, or the name of an outer
        input. Inputs that no equation uses may be left out.
    inputs : sequence of str or Input
        Outer inputs. For a name, unit and meaning are those of the first input connected to it.
    outputs : mapping of str to str
        Outer outputs: ``"name": "part.output"``.
    name, description : str, optional
        Of the component; default: combined from those of the parts.

    Returns
    -------
    Component

    Raises
    ------
    ContractError
        If a connection uses an unknown name, an input is not connected, there is
        an algebraic loop, parts have different sampling periods, or the input of a delay or
        discrete state depends on the mode.

    Examples
    --------
    >>> import ballscrew
    >>> parts = {"left": ballscrew.component("plant"), "right": ballscrew.component("plant")}
    >>> both = ballscrew.interconnect(
    ...     parts,
    ...     {"left.u": "u", "right.u": "u"},
    ...     inputs=["u"],
    ...     outputs={"x": "left.x", "x_right": "right.x"},
    ... )
    >>> both.name, [s.name for s in both.all_states][:2]
    ('left_right', ['left_x', 'left_v'])
    """
    join = _Join(parts, connections, inputs, outputs)
    values = join.values({})
    fields = {n: part.equations_with(join.table(n, values)) for n, part in join.parts.items()}
    for n, updated in join.sampled(values):
        fields[n]["discrete"] = updated
    joined: dict[str, tuple[Any, ...]] = {
        kind: tuple(chain.from_iterable(own[kind] for own in fields.values()))
        for kind in ("states", "discrete", "delays", "balances")
    }
    # an output of a term is an output of the whole only if requested
    joined["balances"] = tuple(
        replace(b, terms=tuple(replace(t, outputs=()) for t in b.terms)) for b in joined["balances"]
    )
    return Component(
        name=name or "_".join(parts),
        description=description or "; ".join(part.description for part in parts.values()),
        parameters=tuple(chain.from_iterable(part.parameters for part in join.parts.values())),
        inputs=tuple(i if isinstance(i, Input) else join.outer_input(i) for i in inputs),
        outputs=tuple(
            replace(join.given[source], name=n, value=values[source])
            for n, source in outputs.items()
        ),
        sample_time=join.period,
        modes=tuple(join.modes(values)) if any(part.modes for part in parts.values()) else (),
        **joined,
    )


def connect(plant: Component, controller: Component) -> Component:
    """The closed loop of a plant and a controller as one component.

    Signals are connected by name: the plant's outputs to the controller's measurements, the
    controller's outputs to the plant's inputs.

    Parameters
    ----------
    plant, controller : Component
        A measurement that the controller does not use may be missing.

    Returns
    -------
    Component
        Its parameters and states are called ``plant_...`` and ``controller_...``; outputs keep
        their names, the plant's first.

    Raises
    ------
    ContractError
        If a signal is missing, or both sides depend directly on each other.

    Examples
    --------
    >>> import ballscrew
    >>> loop = ballscrew.connect(ballscrew.component("plant"), ballscrew.component("iol"))
    >>> [i.name for i in loop.inputs if i.role == "reference"]
    ['x_d']
    """
    seen = [o.name for o in plant.all_outputs]
    commands = [o.name for o in controller.all_outputs]
    references = tuple(i for i in controller.inputs if i.role in REFERENCES)
    if references and not set_point_orders([i.name for i in references]):
        names = ", ".join(i.name for i in references)
        raise ContractError(
            f"{controller.name} has the inputs {names} for the set-point; expected one, or x_d "
            "with v_d and a_d for its derivatives"
        )
    connections = {f"controller.{i.name}": i.name for i in references}
    used = controller.used_symbols()
    for i in controller.inputs:
        if i in references or symbol(i.name) not in used:
            continue
        if i.name not in seen:
            raise ContractError(
                f"{plant.name} has no output {i.name!r}, {controller.name} measures it; "
                f"it has {', '.join(seen) or 'none'}"
            )
        connections[f"controller.{i.name}"] = f"plant.{i.name}"
    for i in plant.inputs:
        if i.name not in commands:
            fault = f"has no output {i.name!r}, {plant.name} needs it"
            raise ContractError(f"{controller.name} {fault}")
        connections[f"plant.{i.name}"] = f"controller.{i.name}"
    parts = {"plant": plant, "controller": controller}
    shown = [(n, o.name) for n, part in parts.items() for o in part.outputs]
    shown += [(n, o.name) for n, part in parts.items() for t in part.terms for o in t.outputs]
    outputs = {
        CONTROLLER + o if n == "controller" and o in seen else o: f"{n}.{o}" for n, o in shown
    }
    loop = interconnect(
        parts,
        connections,
        references,
        outputs,
        f"{plant.name}_with_{controller.name}",
        f"Closed loop: {plant.description}; {controller.description}",
    )
    if not (period := loop.sample_time):
        return loop
    name = (CONTROLLER if controller.sample_time else PLANT) + period.name
    return loop.substituted(
        {symbol(period.name): symbol(name)}, sample_time=replace(period, name=name)
    )


class _Join:
    """Parts with their own names, and the source of each of their inputs."""

    def __init__(
        self,
        parts: Mapping[str, Component],
        connections: Mapping[str, str],
        inputs: Sequence[str | Input],
        outputs: Mapping[str, str],
    ) -> None:
        self.parts = {n: part.prefixed(f"{n}_") if n else part for n, part in parts.items()}
        self.period = _common_period(parts.values())
        self.ports = {f"{n}.{i.name}": i for n, part in parts.items() for i in part.inputs}
        self.given = {f"{n}.{o.name}": o for n, part in parts.items() for o in part.all_outputs}
        self.outer = [i.name if isinstance(i, Input) else i for i in inputs]
        self.connections, self.outputs = dict(connections), dict(outputs)
        for taker, source in (self.connections | self.outputs).items():
            if source not in self.given and (taker in outputs or source not in self.outer):
                raise ContractError(f"{taker} takes {source!r}, which is not an output of any part")
        for port in self.connections:
            if port not in self.ports:
                there = ", ".join(self.ports) or "none"
                raise ContractError(f"no part has an input {port!r}; there are {there}")
        used = {n: part.used_symbols() for n, part in parts.items()}
        for port, of in self.ports.items():
            if port not in connections and symbol(of.name) in used[_owner(port)]:
                raise ContractError(f"{port} is not connected; it needs a connection")

    def outer_input(self, name: str) -> Input:
        """The first input connected to it; laws act on the outputs that are available."""
        for port, source in self.connections.items():
            if source == name:
                law = {f"{_owner(port)}.{signal}" for signal in self.ports[port].law}
                seen = tuple(n for n, shown in self.outputs.items() if shown in law)
                return replace(self.ports[port], name=name, law=seen)
        raise ContractError(f"no input is connected to the outer input {name!r}")

    def values(self, modes: Mapping[str, Mode]) -> Values:
        """All signals, in these modes of the parts.

        Raises
        ------
        ContractError
            For an algebraic loop.
        """
        found: Values = {name: symbol(name) for name in self.outer}

        def find(source: str, path: tuple[str, ...]) -> None:
            if source in found:
                return
            if source in path:
                first, *_ = owners = [_owner(s) for s in path[path.index(source) :]]
                names = " and ".join(self.parts[n].name for n in dict.fromkeys(owners))
                raise ContractError(
                    f"{names}: {self.given[source].name!r} depends on the {first}'s input without "
                    "delay, which makes an algebraic loop"
                )
            n, output = _owner(source), self.given[source].name
            value = self.parts[n].output(output).value
            value = sp.sympify(modes[n].outputs.get(output, value) if n in modes else value)
            for i in self.parts[n].inputs:
                if symbol(i.name) in symbols_in(value):
                    find(self.connections[f"{n}.{i.name}"], (*path, source))
            found[source] = value.xreplace(self.table(n, found))

        for source in self.given:
            find(source, ())
        return found

    def table(self, part: str, values: Values) -> Table:
        """The known inputs of a part, and its period."""
        sources = {i: self.connections.get(f"{part}.{i.name}") for i in self.parts[part].inputs}
        table = {symbol(i.name): values[s] for i, s in sources.items() if s in values}
        if (period := self.parts[part].sample_time) and self.period:
            table[symbol(period.name)] = symbol(self.period.name)
        return table

    def sampled(self, values: Values) -> Iterator[tuple[str, tuple[DiscreteState, ...]]]:
        """The discrete states of each part, in the order in which the parts sample."""
        tables = {n: self.table(n, values) for n in self.parts}
        held = {n: {symbol(d.name) for d in part.discrete} for n, part in self.parts.items()}
        feeding = {n: {n} for n in self.parts}
        for n, part in self.parts.items():
            taken = {s for d in part.discrete for s in symbols_in(sp.sympify(d.update))}
            seen = {s for port in taken & {*tables[n]} for s in symbols_in(tables[n][port])}
            feeding[n] |= {m for m in self.parts if held[m] & seen}
        for between in self.parts:
            for n in self.parts:
                if between in feeding[n]:
                    feeding[n] |= feeding[between]
        new: Table = {}
        # a part has more sources than each of its sources has, except in a circle, where the
        # numbers are equal
        for n in sorted(self.parts, key=lambda n: len(feeding[n])):
            at_sample = {s: e.xreplace(new) for s, e in tables[n].items()}
            updated = tuple(
                replace(d, update=sp.sympify(d.update).xreplace(at_sample))
                for d in self.parts[n].discrete
            )
            new |= {symbol(d.name): d.update for d in updated}
            yield n, updated

    def modes(self, common: Values) -> Iterator[Mode]:
        """Each combination of modes of the parts, with all its equations."""
        for choice in product(*(part.modes or (Mode(""),) for part in self.parts.values())):
            chosen = dict(zip(self.parts, choice, strict=True))
            values = self.values(chosen)
            rates: Values = {}
            events: list[Event] = []
            signs: dict[str, int] = {}
            for n, part in self.parts.items():
                table = self.table(n, values)
                self._check_held(n, table, self.table(n, common))
                own = dict(zip((s.name for s in part.all_states), part.derivatives, strict=True))
                mode = replace(chosen[n], derivatives=own | dict(chosen[n].derivatives))
                mode = replaced(mode, table)
                rates |= mode.derivatives
                signs |= mode.signs
                for event in mode.events:
                    to = event.next_mode and _joint_name(chosen | {n: Mode(event.next_mode)})
                    events.append(replace(event, next_mode=to))
            # Otherwise a law with the sign of a velocity jumps at the end of the plant's mode,
            # and its value there is neither the one before the event nor the one after it.
            known: dict[sp.Expr, sp.Expr] = {}
            for name, sign in signs.items():
                state = symbol(name)
                known |= {sp.sign(state): sp.Integer(sign), sp.Abs(state): sign * state}
            seen = {n: values[source] for n, source in self.outputs.items()}
            yield replaced(Mode(_joint_name(chosen), rates, seen, tuple(events), signs), known)

    def _check_held(self, n: str, table: Table, common: Table) -> None:
        """A delayed or sampled signal has the same expression in all modes."""
        moded = {s for s in table if table[s] != common[s]}
        part = self.parts[n]
        held = [(d.name, "delays", d.expression) for d in part.delays]
        held += [(d.name, "samples", d.update) for d in part.discrete]
        for name, what, expression in held:
            if moded & symbols_in(sp.sympify(expression)):
                raise ContractError(
                    f"{part.name}: {name!r} {what} a signal that depends on the mode; "
                    "give it its own state"
                )


def _owner(port: str) -> str:
    return port.rpartition(".")[0]


def _joint_name(modes: Mapping[str, Mode]) -> str:
    return "_".join(mode.name for mode in modes.values() if mode.name)


def _common_period(parts: Iterable[Component]) -> Parameter | None:
    """The sampling period of the first sampled part; None if no part is sampled."""
    sampled = [(part.name, part.sample_time) for part in parts if part.sample_time]
    for name, period in sampled:
        first, common = sampled[0]
        if period.default != common.default:
            raise ContractError(
                f"{first} samples every {common.default:g} s and {name} every "
                f"{period.default:g} s; expected one period"
            )
    return sampled[0][1] if sampled else None

"""The C sources of a native FMU: tables and equations of the component, and the fixed parts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import resources

from ... import solver
from ...solver.codegen import generate
from ...solver.component import Component
from ...solver.kernel import Kernel
from ...solver.tape import functions
from ...solver.translation import in_c
from ..dependencies import states_of_outputs
from ..interface import MESSAGE, Interface, native_interface_of
from .partials import entry_of, partials

_CORE = ("system.h", "factorize.h", "delays.c", "stepper.h", "events.c", "stepper.c")
_EQUATIONS = ("rhs", "jac", "out", "sample", "indicate", "spread", "kind", "react")


@dataclass(frozen=True)
class NativeModel:
    """A component in the form that a native FMU needs."""

    kernel: Kernel
    partials: Kernel  # of the component that `partials.partials` makes of it

    @cached_property
    def interface(self) -> Interface:
        return native_interface_of(self.kernel)

    @property
    def entries(self) -> list[tuple[int, int]]:
        """Row and column of each partial derivative."""
        return [entry_of(o.name) for o in self.partials.outputs]

    @property
    def exchanges(self) -> bool:
        """Whether it supports model exchange: not if inputs set states, and not with delays.

        A host that solves for the states does not give their values within its steps.
        """
        return not (self.interface.layout.frame or self.kernel.delays)


def native_model(component: Component) -> NativeModel:
    """The component for native FMUs; it must have the feedback law's ports.

    Raises
    ------
    ContractError
        If this version cannot solve it.
    """
    return NativeModel(generate(component), generate(partials(component)))


def sources_of_all(fmi: int) -> dict[str, str]:
    """Text by file name of what is alike in all FMUs; `MAIN` names the file to compile."""
    shared = [resources.files(solver) / "c" / name for name in _CORE]
    own = (resources.files(__package__) / "c").iterdir()
    files = [*shared, *(file for file in own if f"fmi{5 - fmi}" not in file.name)]
    return {file.name: file.read_text(encoding="utf-8") for file in files}


def own_sources(model: NativeModel) -> dict[str, str]:
    """Text by file name of what is the model's own, except its token."""
    return {"model.h": _tables(model), "equations.c": _equations(model)}


def declarations(definitions: str) -> str:
    """For another file, declarations of what a text defines, which are alike for all models."""
    return "".join(f"extern {name};\n" for name in re.findall(r"^OWN (.+?) =", definitions, re.M))


def _equations(model: NativeModel) -> str:
    states = len(model.kernel.states)
    written = functions(model.kernel.source)
    names = [*_EQUATIONS, *(["delayed"] if "delayed" in written else [])]
    parts = [in_c(written[name], states) for name in names]
    delayed = "delayed" if "delayed" in written else "NULL"
    parts.append(in_c(functions(model.partials.source)["out"], states, "partial"))
    head = (
        f"/* The equations of {model.kernel.name}, generated: derivatives dx, their partial\n"
        " * derivatives J by the states and ft by time, outputs y, next discrete states d, event\n"
        " * indicators g, and all partial derivatives of derivatives and outputs. */\n"
        '#include "tables.h"\n#include "token.h"\n'
    )
    system = (
        "OWN const System SYSTEM = {\n"
        "    N, HELD_SIZE, EVENTS, NULL,\n"
        f"    rhs, jac, out, sample, indicate, kind, react, NULL, {delayed}, NULL,\n"
        "};\nOWN const Function SPREAD = spread, PARTIAL = partial;\n"
    )
    return "\n".join([head, *parts, system])


_COUNTS = ("inputs", "discrete", "delays", "modes")  # of the layout
_PLACES = "parameters states outputs starts tolerance info time samples sample_time".split()
_MODEL = """\
/* What {model} consists of, generated; offsets are into the array of all its numbers. */
OWN const char MODEL[] = {name};
{constants}

{initial}
{nominal}
/* the state that an output is equal to */
{shown}
/* row and column of each partial derivative: derivatives and outputs by states and inputs */
OWN const short PARTIAL_AT[][2] = {{{pairs}}};

/* by value reference */
OWN const Variable VARIABLES[] = {{
{variables}
}};
"""


def _tables(model: NativeModel) -> str:
    kernel, interface, layout = model.kernel, model.interface, model.interface.layout
    constants = {"N": len(kernel.states), "EVENTS": kernel.events, "HELD_SIZE": layout.held}
    constants |= {"OUTPUT_COUNT": len(kernel.outputs), "PARTIALS": len(model.entries)}
    constants |= {"STEP_START": layout.step_start, "MEMORY": layout.size}
    constants |= {"MESSAGE_REFERENCE": interface.message_reference}
    constants |= {"REFERENCES": interface.time_reference + 1, "CAN_EXCHANGE": int(model.exchanges)}
    constants |= {name.upper(): getattr(layout, name) for name in _COUNTS}
    constants |= {f"AT_{name.upper()}": getattr(layout, name) for name in _PLACES}
    frame = ("ask", "seen", "from", "to", "count")
    constants |= {f"FRAME_{key.upper()}": layout.frame.get(key, 0) for key in frame}
    return _MODEL.format(
        model=kernel.name,
        name=_quoted(kernel.name),
        constants="\n".join(f"OWN const int {name} = {n};" for name, n in constants.items()),
        initial=_array("double", "INITIAL", [_number(v) for v in layout.initial]),
        nominal=_array("double", "NOMINAL", [_number(v) for v in layout.nominal]),
        shown=_array("int", "STATE_OF_OUTPUT", map(str, states_of_outputs(kernel))),
        pairs=", ".join(f"{{{row}, {column}}}" for row, column in model.entries) or "{0, 0}",
        variables="\n".join(f"    [{line}," for line in _variables(model)),
    )


def _variables(model: NativeModel) -> Iterable[str]:
    interface = model.interface
    kinds = {"input": "INPUT", "parameter": "PARAMETER", "output": "OUTPUT"}
    own = {v.reference for v in interface.states}
    for v in interface.variables:
        kind = kinds.get(v.causality) or ("STATE" if v.reference in own else "DERIVATIVE")
        yield (
            f"{v.reference}] = {{{kind}, {v.place}, {_quoted(v.name)}, {_quoted(v.unit)}, "
            f"{_number(v.minimum)}, {_number(v.maximum)}}}"
        )
    first = interface.first_indicator
    for reference, kind, place, name in (
        (interface.message_reference, "MESSAGE", 0, MESSAGE),
        *((first + k, "INDICATOR", k, "indicator") for k in range(interface.events)),
        (interface.time_reference, "CLOCK", interface.layout.time, "time"),
    ):
        yield f'{reference}] = {{{kind}, {place}, "{name}", "1", -HUGE_VAL, HUGE_VAL}}'


def _array(kind: str, name: str, values: Iterable[str]) -> str:
    return f"OWN const {kind} {name}[] = {{{', '.join(values) or '0'}}};"


def _number(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


def _quoted(text: str) -> str:
    plain = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'"{plain}"'

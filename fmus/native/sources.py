"""The C sources of a native FMU: tables and equations of the component, and the fixed parts."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import resources

from ... import solver
from ...solver.codegen import generate
from ...solver.component import Component
from ...solver.kernel import Kernel
from ...solver.kernel_cache import hashed_name
from ...solver.stored import stored_kernel
from ...solver.tape import functions
from ...solver.translation import in_c
from ..catalogue import fmu_component, fmu_kernel
from ..interface import MESSAGE, Interface, Variable, interface_of, number_variables
from .partials import Entry, entry_of, partials

MAIN = {2: "fmi2.c", 3: "fmi3.c"}
_CORE = ("system.h", "factorize.h", "delays.h", "delays.c", "stepper.h", "stepper.c")
_PARTS = ("component.h", "calls.h")
_EQUATIONS = ("rhs", "jac", "out", "sample", "indicate", "spread", "kind", "react")


@dataclass(frozen=True)
class NativeModel:
    """A component in the form that a native FMU needs.

    Attributes
    ----------
    kernel : Kernel
    partials : Kernel
        Of the component that `partials.partials` makes of it.
    interface : Interface
        The variables of the pythonfmu build, then states that are no outputs, then derivatives.
    state_variables : tuple of Variable
        One per state: the output that is equal to it, or an additional variable.
    derivatives : tuple of Variable
        One per state.
    """

    kernel: Kernel
    partials: Kernel
    interface: Interface
    state_variables: tuple[Variable, ...]
    derivatives: tuple[Variable, ...]

    @property
    def entries(self) -> list[Entry]:
        return [entry_of(o.name) for o in self.partials.outputs]

    @property
    def events(self) -> int:
        """Number of event indicators."""
        return self.kernel.events

    @property
    def first_indicator(self) -> int:
        """Value reference of the first event indicator; the others follow."""
        return 1 + max(self.interface.message_reference, self.interface.variables[-1].reference)

    @property
    def time_reference(self) -> int:
        """Value reference of the time, the last one; FMI 3.0 lists it as a variable."""
        return self.first_indicator + self.events

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
    UnsupportedComponent
        If this version cannot solve it.
    """
    return _model(generate(component), generate(partials(component)))


def catalogued_model(part: str | Component, plant: str = "", tangents: int = 0) -> NativeModel:
    """The model of `catalogue.fmu_kernel`, from disk if available."""
    kernel = fmu_kernel(part, plant, tangents)
    maker = resources.files(__package__).joinpath("partials.py").read_text(encoding="utf-8")
    stored = hashed_name(f"partials_{kernel.name}", maker + kernel.to_json())

    def make() -> Component:
        return partials(fmu_component(part, plant, tangents))

    return _model(kernel, stored_kernel(stored, make))


def with_kernel(model: NativeModel, kernel: Kernel) -> NativeModel:
    """The model with another kernel that differs only in its start values."""
    return _model(kernel, model.partials)


def _model(kernel: Kernel, derived: Kernel) -> NativeModel:
    interface = interface_of(kernel, kernel.name)
    outputs = [v for v in interface.variables if v.causality == "output"]
    shown = _states_of_outputs(kernel)
    taken = {v.name for v in interface.variables} | {MESSAGE}
    layout = interface.layout
    hidden = [
        Variable(
            s.name if s.name not in taken else f"{s.name}_state",
            layout.states + k,
            "local",
            "continuous",
            s.unit,
            s.meaning,
            nominal=s.nominal,
        )
        for k, s in enumerate(kernel.states)
        if k not in shown
    ]
    own = number_variables(hidden, interface.message_reference + 1)
    of_place = {v.place: v for v in own}
    states = [
        outputs[shown.index(k)] if k in shown else of_place[layout.states + k]
        for k in range(len(kernel.states))
    ]
    rates = [
        Variable(
            f"der({state.name})",
            k,
            "local",
            "continuous",
            f"{s.unit}/s",
            f"time derivative of {s.meaning}",
            nominal=s.nominal,
        )
        for k, (s, state) in enumerate(zip(kernel.states, states, strict=True))
    ]
    derivatives = number_variables(rates, interface.message_reference + 1 + len(own))
    return NativeModel(
        kernel,
        derived,
        replace(interface, variables=(*interface.variables, *own, *derivatives)),
        tuple(states),
        derivatives,
    )


def _states_of_outputs(kernel: Kernel) -> list[int]:
    """Number of the state that each output is equal to, in every mode; -1 if there is none."""
    found: list[set[int]] = [set() for _ in kernel.outputs]

    def read(body: Sequence[ast.stmt]) -> None:
        places: dict[str, int] = {}
        for s in body:
            if isinstance(s, ast.If):
                read(s.body)
                read(s.orelse)
            elif isinstance(s, ast.Assign):
                (target,) = s.targets
                if isinstance(target, ast.Name) and ast.unparse(s.value).startswith("x["):
                    places[target.id] = int(ast.unparse(s.value)[2:-1])
                elif isinstance(target, ast.Subscript):
                    output = int(ast.literal_eval(target.slice))
                    found[output].add(places.get(ast.unparse(s.value), -1))

    read(functions(kernel.source)["out"].body)
    return [next(iter(states)) if len(states) == 1 else -1 for states in found]


def sources(model: NativeModel, fmi: int, token: str) -> dict[str, str]:
    """Text by file name of everything that the compiler needs; `MAIN` names the file to compile.

    Parameters
    ----------
    model : NativeModel
    fmi : {2, 3}
    token : str
        Token that a host must give at instantiation.
    """
    folder = resources.files(__package__) / "c"
    names = (*_PARTS, MAIN[fmi], f"fmi{fmi}_declarations.h")
    fixed = {name: (folder / name).read_text(encoding="utf-8") for name in names}
    core = resources.files(solver) / "c"
    fixed |= {name: (core / name).read_text(encoding="utf-8") for name in _CORE}
    return {**fixed, "model.h": _tables(model, token), "equations.h": _equations(model)}


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
        "#include <math.h>\n"
    )
    system = (
        "static const System SYSTEM = {\n"
        "    N, HELD_SIZE, EVENTS, NULL,\n"
        f"    rhs, jac, out, sample, indicate, spread, kind, react, NULL, {delayed}, NULL,\n"
        "};\n"
    )
    return "\n".join([head, *parts, system])


def _tables(model: NativeModel, token: str) -> str:
    kernel, layout = model.kernel, model.interface.layout
    n = len(kernel.states)
    constants: dict[str, int] = {
        "N": n,
        "INPUTS": layout.inputs,
        "DISCRETE": layout.discrete,
        "DELAYS": layout.delays,
        "MODES": layout.modes,
        "EVENTS": model.events,
        "HELD_SIZE": layout.held,
        "OUTPUT_COUNT": len(kernel.outputs),
        "PARTIALS": len(model.entries),
        "AT_PARAMETERS": layout.parameters,
        "AT_STATES": layout.states,
        "AT_OUTPUTS": layout.outputs,
        "AT_STARTS": layout.starts,
        "AT_TOLERANCE": layout.tolerance,
        "AT_INFO": layout.info,
        "AT_TIME": layout.time,
        "AT_SAMPLES": layout.samples,
        "STEP_START": layout.step_start,
        "AT_SAMPLE_TIME": layout.sample_time,
        "MEMORY": layout.size,
        "MESSAGE_REFERENCE": model.interface.message_reference,
        "REFERENCES": model.time_reference + 1,
        "CAN_EXCHANGE": int(model.exchanges),
    }
    constants |= {f"FRAME_{key.upper()}": value for key, value in layout.frame.items()}
    shown = _states_of_outputs(kernel)
    pairs = ", ".join(f"{{{e.row}, {e.column}}}" for e in model.entries)
    return "\n".join(
        [
            f"/* What {kernel.name} consists of, generated; offsets are into the array of all its",
            " * numbers. */",
            "#ifndef MODEL_H",
            "#define MODEL_H",
            "",
            "#include <math.h>",
            "",
            f"#define MODEL {_quoted(kernel.name)}",
            f"#define TOKEN {_quoted(token)}",
            *(f"#define {name} ({value})" for name, value in constants.items()),
            "",
            _array("double", "INITIAL", [_number(v) for v in layout.initial]),
            _array("double", "NOMINAL", [_number(v) for v in layout.nominal]),
            "/* the state that an output is equal to */",
            _array("int", "STATE_OF_OUTPUT", map(str, shown)),
            "/* row and column of each partial derivative: derivatives and outputs by states and "
            "inputs */",
            f"static const short PARTIAL_AT[][2] = {{{pairs or '{0, 0}'}}};",
            "",
            "typedef struct {",
            "    enum {",
            "        NOTHING, INPUT, PARAMETER, OUTPUT, STATE,",
            "        DERIVATIVE, MESSAGE, CLOCK, INDICATOR",
            "    } what;",
            "    int place; /* in that array; of a derivative and an indicator, its number */",
            "    const char *name, *unit;",
            "    double low, high;",
            "} Variable;",
            "",
            "/* by value reference */",
            "static const Variable VARIABLES[REFERENCES] = {",
            *(f"    [{line}," for line in _variables(model)),
            "};",
            "",
            "#endif",
            "",
        ]
    )


def _variables(model: NativeModel) -> Iterable[str]:
    layout = model.interface.layout
    kinds = {"input": "INPUT", "parameter": "PARAMETER", "output": "OUTPUT"}
    own = {v.reference for v in model.state_variables}
    for v in model.interface.variables:
        kind = kinds.get(v.causality) or ("STATE" if v.reference in own else "DERIVATIVE")
        yield (
            f"{v.reference}] = {{{kind}, {v.place}, {_quoted(v.name)}, {_quoted(v.unit)}, "
            f"{_number(v.minimum)}, {_number(v.maximum)}}}"
        )
    for reference, kind, place, name in (
        (model.interface.message_reference, "MESSAGE", 0, MESSAGE),
        *((model.first_indicator + k, "INDICATOR", k, "indicator") for k in range(model.events)),
        (model.time_reference, "CLOCK", layout.time, "time"),
    ):
        yield f'{reference}] = {{{kind}, {place}, "{name}", "1", -HUGE_VAL, HUGE_VAL}}'


def _array(kind: str, name: str, values: Iterable[str]) -> str:
    return f"static const {kind} {name}[] = {{{', '.join(values) or '0'}}};"


def _number(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(float(value))


def _quoted(text: str) -> str:
    plain = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'"{plain}"'

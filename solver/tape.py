"""Generated equations as lists of operations that the compiled core runs, see ``c/tape.c``.

A tape needs no compiler. Its operations are those of the generated text, in
the same order, so that it gives the same numbers as the compiled text.

This file imports only `core`: it is also part of every exported FMU, where it records the text
again if its user has edited it.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .core import FUNCTIONS
from .errors import ContractError

# by number, as in ``c/tape.c``
_OPERATIONS = (
    "ADD SUBTRACT MULTIPLY DIVIDE NEGATE POWER MODULO LESS LESS_EQUAL EQUAL NOT_EQUAL "
    "AND OR NOT LARGER SMALLER SELECT CALL_1 CALL_2 LOAD STORE JUMP JUMP_UNLESS "
    "RETURN DIFFERENCES"
).split()
_NUMBER = {name: k for k, name in enumerate(_OPERATIONS)}
OF_ONE = (
    "acos acosh asin asinh atan atanh ceil cos cosh erf erfc exp expm1 fabs floor "
    "lgamma log log10 log1p log2 sin sinh sqrt tan tanh gamma"
).split()
OF_TWO = ["atan2", "copysign", "fmod", "hypot", "pow"]
_FUNCTIONS = {"abs", "min", "max", *(f"math.{name}" for name in [*OF_ONE, *OF_TWO])}
_BINARY: dict[type[ast.AST], str] = {
    ast.Add: "ADD",
    ast.Sub: "SUBTRACT",
    ast.Mult: "MULTIPLY",
    ast.Div: "DIVIDE",
    ast.Pow: "POWER",
    ast.Mod: "MODULO",
}
_COMPARED: dict[type[ast.AST], tuple[str, bool]] = {  # the second: with its sides exchanged
    ast.Lt: ("LESS", False),
    ast.LtE: ("LESS_EQUAL", False),
    ast.Gt: ("LESS", True),
    ast.GtE: ("LESS_EQUAL", True),
    ast.Eq: ("EQUAL", False),
    ast.NotEq: ("NOT_EQUAL", False),
}
CONSTANTS = {"pi": math.pi, "e": math.e, "inf": math.inf}
# places of the vectors given to a function
_VECTORS: dict[str, int] = {
    "x": 0,
    "u": 1,
    "p": 2,
    **dict.fromkeys(("dx", "J", "y", "d", "g", "s", "e"), 3),
    **dict.fromkeys(("ft", "R"), 4),
    "rt": 5,
}
MOST_REGISTERS = 8192
_GIVEN = 2  # registers of the time and the number of an event

_LOGICAL = {"LESS", "LESS_EQUAL", "EQUAL", "NOT_EQUAL", "AND", "OR", "NOT"}
_RESULTS = {"rhs": "dx", "out": "y", "sample": "d", "indicate": "g", "delayed": "e"}

_OPERATION = np.dtype([(n, np.uint16) for n in ("operation", "to", "a", "b", "c")])
_READS = {"SELECT": "abc", "STORE": "c", "JUMP_UNLESS": "c", "RETURN": "c", "CALL_1": "a"}
_READS |= {"LOAD": "", "JUMP": "", "NEGATE": "a", "NOT": "a"}


@dataclass(frozen=True)
class Tape:
    """One function.

    Attributes
    ----------
    operations : ndarray of _OPERATION, shape (k,)
    constants : ndarray, shape (c,)
    """

    operations: npt.NDArray[np.void]
    constants: npt.NDArray[np.float64]


_NO_TAPE = Tape(np.zeros(0, _OPERATION), np.zeros(0))


def record_tape(
    source: str, states: int, held: int, events: int, delays: int = 0, first: int = 0
) -> bytes:
    """All functions of a system, as `core.System` reads them.

    `states`, `held`, `events`, `delays` are its numbers; `first` is the place of the first delayed
    signal in u.
    """
    written = functions(source)
    tapes = [record(written[name], states) if name in written else _NO_TAPE for name in FUNCTIONS]
    return _packed((states, held, events, delays, first), tapes)


def record_edited(
    source: str, exported: bytes, nominal: npt.NDArray[np.float64], sizes: Mapping[str, int]
) -> bytes:
    """The tapes of a text that its user has edited; the Jacobian is computed by differences.

    `exported` are the tapes of the text as exported, `nominal` the sizes of the states, for the
    differences, and `sizes` the lengths of the vectors "p", "y" and "d". Raises SyntaxError or
    ContractError.
    """
    head = states, held, events, delays, _ = np.frombuffer(exported, np.int32, 5).tolist()
    sizes = {"x": states, "dx": states, "u": held, "g": events, "e": 4 * delays, **sizes}
    written = functions(source)
    tapes = {"jac": Tape(np.array([(_NUMBER["DIFFERENCES"], 0, 0, 0, 0)], _OPERATION), nominal)}
    for name in ("rhs", "out", "sample", "indicate", "kind", "react", "delayed"):
        if name not in written and (delays or name != "delayed"):
            raise ContractError(f"the function {name!r} is missing; it is needed")
        if name in written:
            tapes[name] = record(written[name], states, sizes)
    return _packed(head, [tapes.get(name, _NO_TAPE) for name in FUNCTIONS])


def _packed(head: Sequence[int], tapes: list[Tape]) -> bytes:
    sizes = [size for t in tapes for size in (len(t.operations), len(t.constants))]
    parts = [np.array([*head, *sizes, 0], np.int32).tobytes()]
    parts += [t.constants.tobytes() for t in tapes]
    parts += [t.operations.tobytes() for t in tapes]
    return b"".join(parts)


@lru_cache(maxsize=8)
def functions(source: str) -> dict[str, ast.FunctionDef]:
    """The functions in a text by name."""
    return {n.name: n for n in ast.parse(source).body if isinstance(n, ast.FunctionDef)}


@dataclass
class _Line:
    """An operation on values that are numbered in order."""

    operation: str
    to: int = -1
    a: int = 0
    b: int = 0
    c: int = 0


Value = Any  # what stands for a number: here its place in order, in C its text


class Recorder:
    """Records the operations of a generated function; `translation` writes C in the same way.

    Parameters
    ----------
    width : int
        Columns of matrices.
    names : dict of str to Value
        Numbers that are given by name.
    sizes : dict of str to int, optional
        For a text that may be wrong: lengths of the vectors that are given to it.
    """

    def __init__(
        self, width: int, names: dict[str, Value], sizes: dict[str, int] | None = None
    ) -> None:
        self.width, self.names, self.sizes = width, names, sizes
        self.lines: list[Any] = []
        self.constants: dict[str, tuple[int, float]] = {}
        self.logical: set[int] = set()  # values that are 0 or 1
        self.values = _GIVEN

    def constant(self, value: float) -> Value:
        key = float(value).hex()
        if key not in self.constants:
            self.constants[key] = (self._new(), float(value))
        found = self.constants[key][0]
        if value in (0.0, 1.0):
            self.logical.add(found)
        return found

    def _new(self) -> int:
        self.values += 1
        return self.values - 1

    def emit(self, operation: str, *operands: Value) -> Value:
        to = self._new()
        self.lines.append(_Line(operation, to, *operands))
        if operation in _LOGICAL or (operation == "SELECT" and {*operands[:2]} <= self.logical):
            self.logical.add(to)
        return to

    def call(self, name: str, arguments: list[Value]) -> Value:
        if name in OF_ONE:
            return self.emit("CALL_1", arguments[0], 0, OF_ONE.index(name))
        return self.emit("CALL_2", *arguments, OF_TWO.index(name))

    def load(self, vector: str, index: int) -> Value:
        return self.emit("LOAD", _VECTORS[vector], index)

    def store(self, vector: str, index: int, value: Value) -> None:
        self.lines.append(_Line("STORE", -1, _VECTORS[vector], index, value))

    def named(self, name: str, value: Value) -> Value:
        return value

    def branch(self, test: Value, yes: list[ast.stmt], no: list[ast.stmt]) -> None:
        skip, end = _Line("JUMP_UNLESS", c=test), _Line("JUMP")
        before = dict(self.names)
        self.lines.append(skip)
        self.block(yes)
        names, self.names = self.names, dict(before)
        if no:
            self.lines.append(end)
        skip.a = len(self.lines)
        self.block(no)
        end.a = len(self.lines)
        # a value of one branch only is not there after it
        self.names = dict(before.items() & names.items() & self.names.items())

    def end(self, value: Value | None) -> None:
        self.lines.append(_Line("RETURN", c=self.constant(0.0) if value is None else value))

    def truth(self, e: ast.expr) -> Value:
        if (value := self.value(e)) not in self.logical:
            raise _unknown(e)  # of two numbers, ``and`` and ``or`` take one
        return value

    # -- statements ------------------------------------------------------------------------------

    def block(self, statements: list[ast.stmt]) -> None:
        for s in statements:
            if isinstance(s, ast.Assign) and len(s.targets) == 1:
                target, value = s.targets[0], self.value(s.value)
                if isinstance(target, ast.Name):
                    self.names[target.id] = self.named(target.id, value)
                else:
                    self.store(*self._place(target), value)
            elif isinstance(s, ast.If):
                self.branch(self.value(s.test), s.body, s.orelse)
            elif isinstance(s, ast.Return):
                self.end(self.value(s.value) if s.value else None)
            elif not isinstance(s, ast.Pass):
                raise _unknown(s)

    def _place(self, target: ast.expr) -> tuple[str, int]:
        if not isinstance(target, ast.Subscript) or not isinstance(target.value, ast.Name):
            raise _unknown(target)
        at, name = target.slice, target.value.id
        if self.sizes is not None:
            size = self.sizes.get(name, 0)
            if not isinstance(at, ast.Constant) or at.value not in range(size):
                raise _unknown(target)
        if isinstance(at, ast.Tuple):
            row, column = (int(ast.literal_eval(part)) for part in at.elts)
            return name, row * self.width + column
        return name, int(ast.literal_eval(at))

    # -- expressions -----------------------------------------------------------------------------

    def value(self, e: ast.expr) -> Value:
        if isinstance(e, ast.Constant) and isinstance(e.value, bool | int | float):
            return self.constant(e.value)
        if isinstance(e, ast.Name) and e.id in self.names:
            return self.names[e.id]
        if isinstance(e, ast.Subscript):
            return self.load(*self._place(e))
        if isinstance(e, ast.BinOp) and type(e.op) in _BINARY:
            return self.emit(_BINARY[type(e.op)], self.value(e.left), self.value(e.right))
        if isinstance(e, ast.UnaryOp) and not isinstance(e.op, ast.Invert):
            inner = self.value(e.operand)
            if isinstance(e.op, ast.UAdd):
                return inner
            return self.emit("NOT" if isinstance(e.op, ast.Not) else "NEGATE", inner)
        if isinstance(e, ast.BoolOp):
            return self._joined("AND" if isinstance(e.op, ast.And) else "OR", e.values, self.truth)
        if isinstance(e, ast.Compare) and all(type(op) in _COMPARED for op in e.ops):
            return self._compared(e)
        if isinstance(e, ast.IfExp):
            test, yes, no = self.value(e.test), self.value(e.body), self.value(e.orelse)
            return self.emit("SELECT", yes, no, test)
        if isinstance(e, ast.Attribute) and ast.unparse(e.value) == "math" and e.attr in CONSTANTS:
            return self.constant(CONSTANTS[e.attr])
        if isinstance(e, ast.Call) and not e.keywords and ast.unparse(e.func) in _FUNCTIONS:
            return self._called(e)
        raise _unknown(e)

    def _joined(
        self, operation: str, parts: list[ast.expr], value: Callable[[ast.expr], Value]
    ) -> Value:
        found = value(parts[0])
        for part in parts[1:]:
            found = self.emit(operation, found, value(part))
        return found

    def _compared(self, e: ast.Compare) -> Value:
        sides = [self.value(part) for part in (e.left, *e.comparators)]
        found: Value | None = None
        for op, left, right in zip(e.ops, sides, sides[1:], strict=False):
            operation, exchanged = _COMPARED[type(op)]
            one = self.emit(operation, *((right, left) if exchanged else (left, right)))
            found = one if found is None else self.emit("AND", found, one)
        assert found is not None
        return found

    def _called(self, e: ast.Call) -> Value:
        called = ast.unparse(e.func)
        if called in ("min", "max") and e.args:
            return self._joined("LARGER" if called == "max" else "SMALLER", e.args, self.value)
        name = "fabs" if called == "abs" else called.removeprefix("math.")
        if len(e.args) != (1 if name in OF_ONE else 2 if name in OF_TWO else -1):
            raise _unknown(e)
        return self.call(name, [self.value(a) for a in e.args])


def _unknown(node: ast.stmt | ast.expr) -> ContractError:
    return ContractError(
        f"line {node.lineno} has {ast.unparse(node).splitlines()[0]!r}; expected elements of the "
        "given vectors, names assigned before and not within an if, numbers, arithmetic, "
        "comparisons, 'a if c else b', abs, min, max and functions of math"
    )


def record(function: ast.FunctionDef, width: int, sizes: Mapping[str, int] | None = None) -> Tape:
    """The tape of one generated function.

    `width` is the number of columns of matrices. `sizes`, for a text that may be wrong, are lengths
    of vectors by name; results that it does not write are then zero.
    """
    given = {argument.arg for argument in function.args.args}
    own = None if sizes is None else {n: size for n, size in sizes.items() if n in given}
    recorder = Recorder(width, {n: k for k, n in enumerate("tk") if n in given}, own)
    if own is not None and (result := _RESULTS.get(function.name)):
        zero = recorder.constant(0.0)
        for k in range(own.get(result, 0)):
            recorder.store(result, k, zero)
    recorder.block(function.body)
    recorder.end(None)
    registers = _registers(recorder)
    operations = np.zeros(len(recorder.lines), _OPERATION)
    for k, line in enumerate(recorder.lines):
        fields = {"a": line.a, "b": line.b, "c": line.c}
        for name in _READS.get(line.operation, "ab"):
            fields[name] = registers[fields[name]]
        if line.operation in ("JUMP", "JUMP_UNLESS"):
            fields["b"], fields["a"] = divmod(line.a, 65536)
        to = registers[line.to] if line.to >= 0 else 0
        operations[k] = (_NUMBER[line.operation], to, fields["a"], fields["b"], fields["c"])
    constants = np.array([value for _, value in recorder.constants.values()], dtype=float)
    return Tape(operations, constants)


def _registers(recorder: Recorder) -> dict[int, int]:
    """Register of each value: time and event, the constants, then reused registers."""
    constants = [value for value, _ in recorder.constants.values()]
    places = {0: 0, 1: 1, **{v: _GIVEN + k for k, v in enumerate(constants)}}
    last: dict[int, int] = {}
    for k, line in enumerate(recorder.lines):
        for name in _READS.get(line.operation, "ab"):
            last[getattr(line, name)] = k
    fixed = len(places)
    free: list[int] = []
    most = fixed
    ends: dict[int, list[int]] = {}
    for value, k in last.items():
        ends.setdefault(k, []).append(value)
    for k, line in enumerate(recorder.lines):
        # operands are read before the result is written, so the result may replace one of them
        for value in ends.get(k, ()):
            if places[value] >= fixed:
                free.append(places[value])
        if line.to >= 0:
            if free:
                places[line.to] = free.pop()
            else:
                places[line.to] = most
                most += 1
            if line.to not in last:
                free.append(places[line.to])
    if most > MOST_REGISTERS:
        raise ContractError(f"{most} numbers at once, at most {MOST_REGISTERS}")
    return places

"""Generated code against formulas by hand; each function that an equation may hold."""

from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp
from any_fmu import Host
from differences import partial_derivatives

from ballscrew import TIME, Component, Delay, DiscreteState, Event, Input, Mode, Output, Parameter
from ballscrew.fmus.export import export
from ballscrew.fmus.native.export import export_native
from ballscrew.solver.codegen import generate
from ballscrew.solver.compilers import compiler_for, own_platform
from ballscrew.solver.component import State, symbol
from ballscrew.solver.core import CHANGES_MODE, EITHER, RESETS
from ballscrew.solver.errors import ContractError
from ballscrew.solver.functions import FUNCTIONS, slopes, unsupported_function


def test_the_functions_of_modes_events_and_delays_are_the_formulas_by_hand():
    x, v, u, late, slope = map(symbol, "x v u late slope".split())
    top = Event("top", x - 2 * TIME * late, 1, {}, "b")
    fall = Event("fall", v + 3 * u, -1, {"v": -v * TIME, "x": v})
    made = Component(
        "made_up",
        "",
        parameters=(Parameter("slope", 0.0, "1", "", ""), Parameter("deep", -3.0, "1", "", "")),
        inputs=(Input("u", "1", "", nominal=5.0),),
        states=(State("x", "m", "", v, nominal=0.1), State("v", "m/s", "", u * late + slope)),
        outputs=(Output("y", "1", "", x**4 / v**2),),
        modes=(
            Mode("a", {"v": -(x**5)}, {"y": u}, (top, fall)),
            Mode("b", events=(Event("either", x * v),)),
        ),
        delays=(Delay("late", x * u, sp.Float(0.25), nominal=7.0),),
    )
    kernel = generate(made)
    assert [p.nominal for p in kernel.parameters] == [1.0, 3.0]
    assert (kernel.outputs[0].uses, kernel.outputs[0].feedthrough) == (["u", "v", "x"], ["u"])
    f = {}
    exec(kernel.source, f)
    # x, v; u, late, its rate, the mode; slope
    state, held, p, t = [3.0, 2.0], [0.5, 0.75, 11.0, 0.0], [0.125, -3.0], 4.0

    def filled(name, *places):
        rooms = [np.full(n, np.nan) for n in places]
        f[name](t, state, held, p, *rooms)
        return [room.tolist() for room in rooms]

    assert filled("rhs", 2) == [[2.0, -243.0]]
    assert filled("jac", (2, 2), 2) == [[[0.0, 1.0], [-405.0, 0.0]], [0.0, 0.0]]
    assert filled("out", 1) == [[0.5]]
    assert filled("indicate", 2) == [[3.0 - 6.0, -3.5]]
    assert filled("spread", 2) == [[0.1 + 8.0 * 7.0 + 1.5, 1.0 + 15.0]]
    assert [f["kind"](held, k) for k in (0, 1)] == [CHANGES_MODE, RESETS]
    gradient, reset, by_time = np.zeros(2), np.zeros((2, 2)), np.zeros(2)
    assert f["slopes"](t, state, held, p, 0, gradient, reset, by_time) == -1.5 - 8.0 * 11.0
    assert gradient.tolist() == [1.0, 0.0]
    f["slopes"](t, state, held, p, 1, gradient, reset, by_time)
    assert (gradient.tolist(), by_time.tolist()) == ([0.0, 1.0], [0.0, -2.0])
    assert reset.tolist() == [[0.0, 1.0], [0.0, -4.0]]
    assert filled("delayed", 4) == [[1.5, 0.25, 0.0, 7.0]]
    f["react"](t, state, held, p, 1)
    assert (state, held[3]) == ([2.0, -8.0], 0.0)
    f["react"](t, state, held, p, 0)
    assert held[3] == 1.0
    assert filled("rhs", 2) == [[-8.0, 0.5]]
    assert filled("jac", (2, 2), 2) == [[[0.0, 1.0], [0.0, 0.0]], [0.0, 0.5 * 11.0]]
    assert filled("out", 1) == [[16.0 / 64.0]]
    assert filled("indicate", 2) == [[-16.0, -1.0]]
    assert f["kind"](held, 0) == EITHER


# -- what an equation may hold -------------------------------------------------------------------


a, b, k = symbol("a"), symbol("b"), symbol("k")
inside = a / (1 + sp.Abs(a))  # in (-1, 1)
# each function of the table, and what users write with them
SMOOTH = {
    sp.exp: [sp.exp(a / 2)],
    sp.log: [sp.log(a**2 + k), sp.log(a**2 + 1, 10)],
    sp.erf: [sp.erf(a * b)],
    sp.erfc: [sp.erfc(a)],
    sp.sin: [sp.sin(a * b)],
    sp.cos: [sp.cos(a)],
    sp.tan: [sp.tan(inside)],
    sp.cot: [sp.cot(a)],
    sp.sec: [sp.sec(inside)],
    sp.csc: [sp.csc(a)],
    sp.asin: [sp.asin(inside)],
    sp.acos: [sp.acos(inside * k / 3)],
    sp.atan: [sp.atan(a * b)],
    sp.sinh: [sp.sinh(a)],
    sp.cosh: [sp.cosh(a)],
    sp.tanh: [sp.tanh(a)],
    sp.coth: [sp.coth(a)],
    sp.sech: [sp.sech(a)],
    sp.csch: [sp.csch(a)],
    sp.asinh: [sp.asinh(a * b)],
    sp.acosh: [sp.acosh(2 + a**2)],
    sp.atanh: [sp.atanh(inside)],
    sp.atan2: [sp.atan2(a, b)],
    sp.Abs: [sp.Abs(a), sp.Abs(a / k) * b, sp.Abs(sp.sin(a) * b), sp.Abs(sp.log(a**2))],
    sp.sign: [sp.sign(a) * b, sp.sqrt(sp.Abs(a)) * sp.sign(a)],
    sp.Heaviside: [sp.Heaviside(a) * b, sp.Heaviside(a - b, 1)],
    sp.Max: [sp.Max(a, b), sp.Max(a, b, k / 2), sp.Max(-k, sp.Min(k, 3 * a)), sp.Max(a, 0) ** k],
    sp.Min: [sp.Min(a, b, -a), sp.Min(sp.Abs(a), k)],
    sp.floor: [sp.floor(a * k) * b],
    sp.ceiling: [sp.ceiling(a / b) * a],
    sp.Mod: [sp.Mod(a, b), sp.Mod(a, k), sp.Mod(-a, -k)],
    sp.frac: [sp.frac(a * b)],
    sp.Piecewise: [
        sp.Piecewise((a, sp.And(a > b, a < 1)), (a * b, sp.Or(b > 1, a > 2)), (b, True))
    ],
    sp.Pow: [sp.Abs(a) ** k, sp.Abs(a) ** b, sp.sqrt(a**2 + b**2), 2**a, a**3, a**-2, 1 / (2 + a)],
}
HALF, THIRD = 0.5, 1 / 3
# expression, a, b, value, derivatives by a and b
KINKS = [
    (sp.Abs(a) + b, 0, 1, 1, 0, 1),
    (sp.Abs(a / k), 0, 0, 0, 0, 0),
    (sp.sign(a), 0, 0, 0, 0, 0),
    (sp.Heaviside(a), 0, 0, HALF, 0, 0),
    (sp.Heaviside(a, 1), 0, 0, 1, 0, 0),
    (sp.Max(a, b), 1, 1, 1, HALF, HALF),
    (sp.Max(a, b, k / 2), 1, 1, 1, THIRD, THIRD),
    (sp.Max(a, 0), 0, 0, 0, HALF, 0),
    (sp.Max(a, -a), 0, 0, 0, 0, 0),
    (sp.Min(a, b), -2, -2, -2, HALF, HALF),
    (sp.Min(sp.Abs(a), k), 0, 0, 0, 0, 0),
    (sp.Min(sp.Abs(a), k), 2, 0, 2, HALF, 0),
    (sp.floor(a), 2, 0, 2, 0, 0),
    (sp.floor(a), -2, 0, -2, 0, 0),
    (sp.ceiling(a), 2, 0, 2, 0, 0),
    (sp.Mod(a, b), 4, 2, 0, 1, -2),
    (sp.frac(a), 3, 0, 0, 1, 0),
    (sp.sqrt(sp.Abs(a)), 0, 0, 0, 0, 0),
    (sp.sqrt(sp.Abs(a)) * sp.sign(a), 0, 0, 0, 0, 0),
    (sp.sqrt(sp.Max(a, 0)), 0, 0, 0, 0, 0),
    (sp.Abs(a) ** b, 0, 2, 0, 0, 0),
    (sp.Abs(a) ** b, 0, 0.5, 0, 0, 0),
    (sp.Max(a, 0) ** k, 0, 0, 0, 0, 0),
    (sp.atan2(a, b), 0, 0, 0, 0, 0),
    (sp.Piecewise((a, a > b), (2 * a, True)), 1, 1, 2, 2, 0),
]
EXPRESSIONS = [e for group in SMOOTH.values() for e in group] + [row[0] for row in KINKS]
KINDS = ["native", pytest.param("readable", marks=pytest.mark.ci)]
NAMES = [f"y{n}" for n in range(len(EXPRESSIONS))]


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """``computed(kind)(a, b)`` are rows of value, gain by a and gain by b, as the FMU gives them.

    The gains are those of the feedback law's ports. The native FMU's partial derivatives, forward,
    are held to them.
    """
    everything = Component(
        "everything",
        "each supported function",
        parameters=(Parameter("k", 2.0, "1", "a number", "the test"),),
        inputs=tuple(Input(n, "1", n, start=0.7, role="measurement") for n in "ab"),
        outputs=tuple(Output(n, "1", n, e) for n, e in zip(NAMES, EXPRESSIONS, strict=True)),
    )
    folder = tmp_path_factory.mktemp("everything")

    def open_one(kind):
        if kind == "readable":
            path = export(everything, folder / "readable.fmu")
        elif own_platform() and compiler_for(own_platform()):
            path = export_native(everything, folder / "native.fmu").path
        else:
            pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
        host = Host(path)
        wanted = [n + port for n in NAMES for port in ("", "_gain_a", "_gain_b")]

        def values(at_a, at_b):
            host.set({"a": at_a, "b": at_b})
            rows = np.array(host.get(*wanted)).reshape(-1, 3)
            if kind == "native":
                for column, name in enumerate("ab"):
                    product = host.slopes(NAMES, [name], [1.0])
                    # at a kink of one, others have poles
                    fine = np.isfinite(rows[:, 1 + column])
                    theirs = rows[fine, 1 + column].tolist()
                    assert np.array(product)[fine].tolist() == pytest.approx(theirs, 1e-12, 1e-14)
            return rows

        return values

    return cache(open_one)


def test_every_function_of_the_table_is_among_those_that_are_tried():
    assert set(SMOOTH) == set(FUNCTIONS)
    for function, tried in SMOOTH.items():
        assert all(e.has(function) for e in tried), function


@pytest.mark.ci
@pytest.mark.parametrize("kind", KINDS)
def test_values_and_derivatives_are_those_of_central_differences_in_40_digits(computed, kind):
    own = {
        "Heaviside": lambda x, at_zero=0.5: mpmath.mpf(x > 0) if x else at_zero,
        "Mod": lambda x, y: x - y * mpmath.floor(x / y),
        "Max": max,
        "Min": min,
    }
    values = [e.xreplace({k: sp.Integer(2)}) for e in EXPRESSIONS]
    exact = sp.lambdify([a, b], values, [own, "mpmath"])
    random = np.random.default_rng(13)
    for at_a, at_b in random.uniform(0.1, 2.9, (12, 2)) * random.choice([-1, 1], (12, 2)):
        rows = computed(kind)(at_a, at_b)
        value = [float(mpmath.re(v)) for v in exact(mpmath.mpf(at_a), mpmath.mpf(at_b))]
        expected = np.column_stack([value, partial_derivatives(exact, (at_a, at_b), (1, 1))])
        wrong = np.abs(rows - expected) > 1e-9 * (1 + np.abs(expected))
        assert [EXPRESSIONS[n] for n in np.flatnonzero(wrong.any(axis=1))] == []


@pytest.mark.parametrize("kind", KINDS)
def test_at_kinks_values_and_derivatives_are_as_stated(computed, kind):
    first = len(EXPRESSIONS) - len(KINKS)
    for row, (expression, at_a, at_b, *stated) in enumerate(KINKS):
        found = computed(kind)(float(at_a), float(at_b))[first + row]
        assert found.tolist() == pytest.approx(stated, abs=1e-15), (expression, at_a, at_b)


@pytest.mark.ci
@pytest.mark.parametrize(
    ("where", "equation"),
    [
        ("output", "output y"),
        ("rate", "the derivative of x"),
        ("update", "the update of d"),
        ("mode", "x in mode one"),
        ("event", "event end"),
        ("reset", "the reset of x by event end"),
    ],
)
def test_what_is_not_supported_is_refused_by_component_equation_and_function(where, equation):
    x = symbol("x")
    e = dict.fromkeys(("output", "rate", "update", "mode", "event", "reset"), -x)
    e[where] = sp.besselj(1, x)
    end = Event("end", e["event"], 1, {"x": e["reset"]})
    line = f"^part: {equation} uses besselj, which is not supported; [^\n]*$"
    with pytest.raises(ContractError, match=line):
        Component(
            "part",
            "a part",
            states=(State("x", "1", "state", e["rate"]),),
            outputs=(Output("y", "1", "output", e["output"]),),
            discrete=(DiscreteState("d", "1", "held", e["update"]),),
            sample_time=Parameter("period", 1.0, "s", "period", "the test", minimum=1e-6),
            modes=(Mode("one", {"x": e["mode"]}, events=(end,)),),
        )


def test_the_function_that_is_not_supported_is_named():
    for expression, name in (
        (sp.gamma(a), "gamma"),
        (sp.Derivative(sp.Function("g")(a), a), "Derivative"),
        (a + sp.zoo, "ComplexInfinity"),
        (sp.Piecewise((a, a > 0)), "Piecewise without a last piece (..., True)"),
        (sp.sqrt(sp.exp(sp.loggamma(a))), "loggamma"),
    ):
        assert unsupported_function(expression) == name


def test_no_derivative_of_a_supported_expression_is_unsupported_nor_is_its_derivative():
    first = slopes(EXPRESSIONS, [a, b])
    assert {unsupported_function(e) for e in first} == {""}
    assert {unsupported_function(e) for e in slopes(list(first), [a, b])} == {""}

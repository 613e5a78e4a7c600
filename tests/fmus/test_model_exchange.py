"""Native FMUs for model exchange: states, derivatives and partial derivatives in a host's hands."""

import fmpy
import numpy as np
import pytest
import sympy as sp
from any_fmu import NATIVE, Host
from differences import partial_derivatives
from every_component import EVERY_COMPONENT

from ballscrew.fmus.feedback_law import with_law_ports
from ballscrew.orchestration.loop.catalogue import NAMES, catalogued_model, component, fmu_kernel
from ballscrew.plant.instruments import INSTRUMENTS
from ballscrew.solver.component import symbol
from ballscrew.solver.kernel import Model

rare = pytest.mark.ci
BOTH = pytest.mark.parametrize("kind", ["native-2", pytest.param("native-3", marks=rare)])
CHEAP = "plant_lugre", "plant_classical"


def on_grid(course, name, steps):
    """Values at the milliseconds, before what happens there; fmpy adds rows at events."""
    grid = np.round(course["time"] * 1e3, 6)
    first = dict(zip(grid[::-1], course[name][::-1], strict=True))
    return np.array([first[float(k)] for k in range(steps + 1)])


@BOTH
@pytest.mark.parametrize(
    "name",
    [
        n if n in CHEAP else pytest.param(n, marks=pytest.mark.prove)
        for n in NAMES
        if n.startswith("plant")
    ],
)
def test_under_cvode_a_plant_moves_as_its_equations_say(made, name, kind):
    """Classical friction has events there: it slides, and sticks where the voltage is low."""
    voltage = np.array(
        [(0.0, 0.1), (0.1, 0.1), (0.1, 20.0), (0.3, 20.0), (0.3, 0.0), (0.5, 0.0)],
        dtype=[("time", float), ("u", float)],
    )
    course = fmpy.simulate_fmu(
        str(made(name, kind)),
        fmi_type="ModelExchange",
        stop_time=0.5,
        output_interval=1e-4,  # fmpy allows CVODE 500 steps in each, and Maxwell-slip has corners
        relative_tolerance=1e-9,
        input=voltage,
        output=["x", "v", "i"],
    )
    model = Model(fmu_kernel(name))
    expected = []
    for a, b, u in ((0, 100, 0.1), (100, 300, 20.0), (300, 500, 0.0)):
        model.set_input("u", u)
        part = model.simulate(np.arange(a, b + 1) * 1e-3)
        expected.append(np.column_stack([part.outputs[n] for n in ("x", "v", "i")])[:-1])
    expected = np.vstack(expected)
    for k, signal in enumerate(("x", "v", "i")):
        error = np.abs(on_grid(course, signal, 500)[:-1] - expected[:, k]).max()
        assert error < 1e-5 * np.ptp(expected[:, k]), signal


# -- states, also one by one: FMI 2.0.5, section 3.2.3; FMI 3.0.2, 2.3.5 and 3.2.1 --------------


@pytest.mark.parametrize("kind", NATIVE)
@pytest.mark.parametrize("mode", ["event", "continuous-time"])
@pytest.mark.parametrize(
    "name", ["plant", *(pytest.param(n, marks=rare) for n in ("nctf", "plant_classical"))]
)
def test_states_set_one_by_one_are_those_set_all_at_once(made, name, mode, kind):
    """CasADi sets them in no other way; some are outputs, one is not, and one part has modes."""
    model = catalogued_model(name)
    states = [v.name for v in model.interface.states]
    unknowns = [v.name for v in model.interface.derivatives]
    unknowns += [o.name for o in model.kernel.outputs]
    random = np.random.default_rng(8)
    whole, single = (Host(made(name, kind), exchange=True) for _ in range(2))
    for host in (whole, single):
        if mode == "continuous-time":
            host.fmu.enterContinuousTimeMode()
    for _ in range(5):
        values = [s.nominal * random.normal() for s in model.kernel.states]
        whole.set_states(values)
        for k in random.permutation(len(states)):
            single.set({states[k]: values[k]})
        assert single.get(*states) == values
        assert single.array("getContinuousStates", len(states)).tolist() == values
        assert single.get(*unknowns) == whole.get(*unknowns)
    for host in (whole, single):
        host.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_what_is_no_state_or_no_number_is_refused_and_the_solver_can_try_another(made, kind):
    host = Host(made("plant", kind), exchange=True, begun=False)
    with pytest.raises(Exception, match="fmi"):  # before initialization ends it has a start value
        host.set({"x": 0.01})
    assert "x cannot be set" in host.heard[-1]
    host.begin()
    for name in ("friction", "der(v)"):  # no states
        with pytest.raises(Exception, match="fmi"):
            host.set({name: 0.01})
    host.fmu.enterContinuousTimeMode()
    host.set({"x": 0.01})
    for wrong in (np.nan, np.inf):
        with pytest.raises(Exception, match="fmi"):
            host.set({"v": 0.1, "x": wrong})
        with pytest.raises(Exception, match="fmi"):
            host.set_states([0.0, 0.0, wrong, 0.0])
    with pytest.raises(Exception, match="fmi"):
        host.set_states([0.0] * 5)
    assert host.get("x", "v") == [0.01, 0.0]
    host.set({"x": 0.02})
    host.fmu.enterEventMode()
    host.update()
    assert host.get("x") == [0.02]
    host.close()


# -- partial derivatives ---------------------------------------------------------------------


@pytest.mark.parametrize("name", EVERY_COMPONENT)
def test_directional_derivatives_are_the_partial_derivatives_of_the_equations(made, name):
    """Central differences in 40 digits of the symbolic equations are the oracle."""
    kernel, part = fmu_kernel(name), with_law_ports(component(name))
    random = np.random.default_rng(5)
    signals = [i for i in kernel.inputs if i.role != "internal"]
    starts = {f"{s.name}_start": float(s.nominal * random.normal() * 3) for s in kernel.states}
    values = {i.name: float(random.normal()) * (1 if i.name[0] == "u" else 1e-3) for i in signals}
    host = Host(made(name, "native-2"), starts | values)
    mode = ""
    if part.modes:  # which mode it is in is seen in its outputs alone
        still = "stuck" if "stuck" in host.at else "off"
        way = starts.get("v_start", host.get("u")[0])
        stuck = host.get("stuck") == [1.0] if "stuck" in host.at else way == 0
        mode = still if stuck else ("forward" if way > 0 else "backward")
    chosen = next((m for m in part.modes if m.name == mode), None)
    own = chosen.derivatives if chosen else {}
    equations = [own.get(s.name, e) for s, e in zip(kernel.states, part.derivatives, strict=True)]
    own = chosen.outputs if chosen else {}
    equations += [own.get(o.name, o.value) for o in part.all_outputs]
    fixed = {symbol(p.name): sp.Float(p.default, 40) for p in kernel.parameters}
    fixed |= {symbol(d.name): sp.Float(d.start, 40) for d in kernel.discrete}
    fixed |= {symbol("t"): sp.Integer(0), symbol("t_step"): sp.Integer(0)}
    names = [s.name for s in kernel.states] + [i.name for i in signals]
    at = [starts[f"{s.name}_start"] for s in kernel.states] + [values[i.name] for i in signals]
    nominal = [s.nominal for s in kernel.states] + [i.nominal for i in signals]
    model = catalogued_model(name)
    known = [v.name for v in model.interface.states] + [i.name for i in signals]
    unknown = [v.name for v in model.interface.derivatives] + [o.name for o in kernel.outputs]
    got = np.column_stack([host.slopes(unknown, [k], [1.0]) for k in known])
    f = sp.lambdify(
        [symbol(n) for n in names], [sp.sympify(e).xreplace(fixed) for e in equations], "mpmath"
    )
    exact = partial_derivatives(f, at, nominal)
    scale = np.abs(exact).max(axis=1, keepdims=True) + 1e-12
    assert np.max(np.abs(got - exact) / scale) < 1e-9
    # what an instrument gives is a staircase, or held: it has no slope
    assert (np.abs(exact).max() > 0) == (name not in INSTRUMENTS)
    seeds = random.normal(size=len(known))
    product = host.slopes(unknown, known, seeds)
    assert product == pytest.approx(got @ seeds, rel=1e-9, abs=1e-9 * np.abs(got @ seeds).max())
    host.close()


@pytest.mark.parametrize(
    "name", ["plant", *(pytest.param(n, marks=rare) for n in ("iol", "plant_maxwell_slip"))]
)
def test_adjoint_derivatives_of_fmi_3_are_directional_ones_transposed(made, name):
    model = catalogued_model(name)
    random = np.random.default_rng(7)
    signals = [i.name for i in model.kernel.inputs if i.role != "internal"]
    starts = {f"{s.name}_start": s.nominal * random.normal() for s in model.kernel.states}
    host = Host(made(name, "native-3"), starts | dict.fromkeys(signals, 1e-3))
    knowns = [v.name for v in model.interface.states] + signals
    unknowns = [v.name for v in model.interface.derivatives]
    unknowns += [o.name for o in model.kernel.outputs]
    forward = np.column_stack([host.slopes(unknowns, [k], [1.0]) for k in knowns])
    rows, columns = ([host.at[n] for n in names] for names in (unknowns, knowns))
    n = len(knowns)  # left out, fmpy makes room for as many as there are unknowns
    ask = host.fmu.getAdjointDerivative
    assert [ask([row], columns, [1.0], n) for row in rows] == forward.tolist()
    assert np.abs(forward).max() > 0
    seed = random.normal(size=len(unknowns))
    product = ask(rows, columns, list(seed), n)
    size = np.abs(seed) @ np.abs(forward)
    assert (np.abs(product - seed @ forward) <= 1e-14 * size).all()
    host.close()


@pytest.mark.parametrize("kind", NATIVE)
def test_what_has_no_partial_derivative_is_named(made, kind):
    host = Host(made("plant", kind))
    assert host.slopes(["x"], ["x"], [1.0]) == [1.0]
    for unknown, known, said in (
        ("R", "u", f"value reference {host.at['R']} is no output and no derivative"),
        ("der(v)", "R", f"value reference {host.at['R']} is no input and no state"),
    ):
        with pytest.raises(Exception, match="DirectionalDerivative"):
            host.slopes([unknown], [known], [1.0])
        assert said in host.heard[-1]
    host.close()

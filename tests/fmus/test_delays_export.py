"""Components with delays as FMUs: readable, native in both versions, and in plain Python."""

import fmpy
import numpy as np
import pytest
import sympy as sp
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from ballscrew.fmus.export import export, with_law_ports
from ballscrew.fmus.native.export import export_native
from ballscrew.fmus.variational import variational
from ballscrew.orchestration.fmu_instance import FmuInstance, StepFailed
from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Delay,
    DiscreteState,
    Input,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.kernel import Model
from ballscrew.solver.tape import UnsupportedComponent

U, X, HEARD, SEEN, TAU = map(symbol, ("u", "x", "heard", "seen", "tau"))

LOOP = Component(
    "late_loop",
    "A lag that hears its command late, and feels itself as it was",
    parameters=(Parameter("tau", 0.013, "s", "delay", "made up", minimum=0.0),),
    inputs=(Input("u", "V", "command"),),
    states=(State("x", "V", "lag", 40 * (HEARD - X - 0.6 * SEEN * X), start=0.2),),
    outputs=(
        Output("x", "V", "lag", X),
        Output("heard", "V", "command, late", HEARD),
        Output("twice", "V", "command, later", symbol("later")),
    ),
    delays=(
        Delay("heard", U, TAU, unit="V"),
        Delay("seen", X, 3 * TAU, unit="V", start=0.2),
        Delay("later", HEARD, TAU / 2, unit="V", start=-1.0),
    ),
)
SAMPLED = Component(
    "late_samples",
    "Counts what it hears, sampled",
    parameters=(Parameter("tau", 0.013, "s", "delay", "made up"),),
    inputs=(Input("u", "V", "command"),),
    outputs=(Output("total", "V", "sum", symbol("total")), Output("y", "V", "late", HEARD)),
    discrete=(DiscreteState("total", "V", "sum", symbol("total") + HEARD),),
    sample_time=Parameter("period", 0.005, "s", "period", "made up"),
    delays=(Delay("heard", U, TAU, unit="V"),),
)
KINDS = ("readable", "native2", "native3")
OUTPUTS = ("x", "heard", "twice")


def made(component, kind, folder):
    path = folder / f"{component.name}_{kind}.fmu"
    if kind == "readable":
        return export(component, path)
    return export_native(component, path, fmi=int(kind[-1])).path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("late")
    return {(c.name, k): made(c, k, folder) for c in (LOOP, SAMPLED) for k in KINDS}


class Host:
    """Steps either version by fmpy."""

    def __init__(self, path, values=None):
        description = fmpy.read_model_description(str(path))
        self.three = description.fmiVersion == "3.0"
        self.slave = (FMU3Slave if self.three else FMU2Slave)(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="host",
        )
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.slave.instantiate()
        if not self.three:
            self.slave.setupExperiment(startTime=0.0)
        for name, value in (values or {}).items():
            self.put(name, value)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def put(self, name, value):
        write = self.slave.setFloat64 if self.three else self.slave.setReal
        write([self.references[name]], [value])

    def get(self, *names):
        read = self.slave.getFloat64 if self.three else self.slave.getReal
        return list(read([self.references[n] for n in names]))

    def step(self, t, h):
        self.slave.doStep(t, h)

    def save(self):
        return self.slave.getFMUState() if self.three else self.slave.getFMUstate()

    def load(self, state):
        (self.slave.setFMUState if self.three else self.slave.setFMUstate)(state)

    def to_bytes(self, state):
        if self.three:
            return self.slave.serializeFMUState(state)
        return self.slave.serializeFMUstate(state)

    def from_bytes(self, data):
        if self.three:
            return self.slave.deserializeFMUState(data)
        return self.slave.deSerializeFMUstate(data, None)


def command(k):
    return float((k * k) % 7) / 3.0


@pytest.mark.parametrize("kind", KINDS)
def test_an_fmu_gives_the_numbers_of_the_model(files, kind):
    host, model = Host(files["late_loop", kind]), Model(generate(with_law_ports(LOOP)))
    for k in range(120):
        t = 1e-3 * k
        host.put("u", command(k))
        model.set_input("u", command(k))
        host.step(t, 1e-3)
        model.advance(t, t + 1e-3)
        y = model.outputs(t + 1e-3, model.x)
        assert host.get(*OUTPUTS) == [y[n] for n in OUTPUTS]
        late = command(k - 12) if k >= 12 else 0.0
        assert y["heard"] == pytest.approx(late, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("steps", [7, 250])  # the latter are more than there is room for at first
def test_a_saved_state_holds_what_delayed_signals_were(files, kind, steps):
    host = Host(files["late_loop", kind])
    h = 0.05 / steps

    def go_on(host, first):
        seen = []
        for k in range(first, first + steps):
            host.put("u", command(k))
            host.step(h * k, h)
            seen.append(host.get(*OUTPUTS))
        return seen

    go_on(host, 0)
    state = host.save()
    data = bytes(host.to_bytes(state))
    expected = go_on(host, steps)
    go_on(host, 2 * steps)
    host.load(state)
    assert go_on(host, steps) == expected
    other = Host(files["late_loop", kind])
    other.load(other.from_bytes(data))
    assert other.get(*OUTPUTS) != [0.2, 0.0, -1.0]
    assert go_on(other, steps) == expected


@pytest.mark.parametrize("kind", KINDS)
def test_samples_hear_what_is_late_at_their_instant(files, kind):
    host = Host(files["late_samples", kind])
    for k in range(40):
        host.put("u", 1.0)
        host.step(1e-3 * k, 1e-3)
    # samples at 0, 5, 10, ... 35 ms; from 13 ms on the command is heard: at 15, 20, 25, 30, 35
    assert host.get("total", "y") == pytest.approx([5.0, 1.0])


def test_plain_python_stands_in_for_the_core(files, monkeypatch, tmp_path):
    """Where the library cannot be loaded; the numbers stay."""
    from ballscrew.fmus import runtime
    from ballscrew.solver.stepper import PlainSystem

    kernel = generate(with_law_ports(LOOP))
    model = Model(kernel)
    file = tmp_path / f"{kernel.module}.py"
    file.write_text(kernel.source, encoding="utf-8", newline="\n")
    monkeypatch.setattr(runtime, "System", _broken)
    system, why = runtime.system_of(file, b"", len(kernel.states))
    assert type(system) is PlainSystem
    assert why == f"{file.name} has no compiled solver for this platform"
    x, u, info = model.x.copy(), model.u.copy(), model.info.copy()
    y = np.empty(len(kernel.outputs))
    instance = system.instance(x, u, model.p, y, model.atol, info)
    for k in range(60):
        model.set_input("u", command(k))
        u[0] = command(k)
        model.advance(1e-3 * k, 1e-3 * (k + 1))
        assert instance.advance(1e-3 * k, 1e-3 * (k + 1), model.tolerance, 1000) == 0
        assert np.array_equal(x, model.x)
        instance.out(1e-3 * (k + 1))
        assert y.tolist() == list(model.outputs(1e-3 * (k + 1), model.x).values())


def _broken(tapes):
    raise OSError("for another platform")


@pytest.mark.parametrize("kind", ["readable", "native2"])
def test_a_delay_that_lasts_no_time_fails_with_one_line(files, kind):
    instance = FmuInstance(files["late_loop", kind], "late")
    instance.initialize({"tau": 0.0}, 1.0)
    with pytest.raises(StepFailed, match="a delay is 0 s; expected more than"):
        instance.step(0.0, 1e-3)
    instance.close()


def test_a_native_one_is_for_co_simulation_only(files):
    for kind in ("native2", "native3"):
        description = fmpy.read_model_description(str(files["late_loop", kind]))
        assert description.modelExchange is None
        assert description.coSimulation is not None


@pytest.mark.parametrize("kind", ["native2", "native3"])
def test_fmpy_finds_nothing_wrong(files, kind):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(files["late_loop", kind])) == []


def test_a_feedback_law_knows_how_fast_a_delayed_signal_moves():
    late = Component(
        "late_gain",
        "A gain on a late ramp",
        inputs=(Input("x", "m", "position", role="measurement"),),
        outputs=(Output("u", "V", "command", X - 3 * HEARD),),
        delays=(Delay("heard", X + 0.5 * TIME, sp.Float(0.1)),),
    )
    model = Model(generate(with_law_ports(late)))
    model.advance(0.0, 0.25)
    y = model.outputs(0.25, model.x)
    assert y["u"] == pytest.approx(-3 * 0.5 * 0.15)
    assert y["u_gain_x"] == 1.0
    assert y["u_rate"] == pytest.approx(-1.5)


def test_the_documentation_shows_what_is_late_and_by_how_much():
    rows = [row[0] for row in generate(LOOP).equations]
    assert "<mi>heard</mi><mtext> after </mtext><mi>&#964;</mi>" in rows


def test_tangents_over_fmus_are_refused_in_one_line():
    with pytest.raises(UnsupportedComponent, match=r"^late_loop has delays; only a component"):
        variational(LOOP, 2)

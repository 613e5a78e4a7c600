"""Exported FMUs as other tools see them, run by fmpy in processes of their own where it matters."""

import json
import os
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from fmu_host import opened

from ballscrew.fmus.catalogue import component, fmu_kernel
from ballscrew.fmus.export import export
from ballscrew.solver.component import Component, Input, Output, State, symbol
from ballscrew.solver.kernel import Model

SUPPORT = str(Path(__file__).resolve().parents[1] / "support")


def python(code, *arguments, **environment):
    """Run code in a fresh process; its standard output, and no crash at its end."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        cwd=tempfile.gettempdir(),  # the installed package, not this checkout
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_plant_has_no_feedthrough_and_the_ports_a_stranger_expects(fmus):
    description = fmpy.read_model_description(str(fmus["plant"]))
    assert all(u.dependencies == [] for u in description.outputs)
    names = {v.name: v for v in description.modelVariables}
    assert {"x", "v", "z", "i", "friction"} <= {
        n for n, v in names.items() if v.causality == "output"
    }
    ports = ["u", *(f"u_gain_{s}" for s in "xvzi"), *(f"u_ref_{s}" for s in "xvzi"), "u_rate"]
    for port in ports:
        assert names[port].causality == "input"
        assert float(names[port].start) == 0.0


@pytest.mark.parametrize("name", ["plant", "iol", "pid_sampled"])
def test_export_is_reproducible_byte_for_byte(tmp_path, name):
    paths = [export(component(name), tmp_path / f"{k}.fmu") for k in range(2)]
    other = python(
        """
        import sys
        from ballscrew.fmus.catalogue import component
        from ballscrew.fmus.export import export
        export(component(sys.argv[1]), sys.argv[2])
        """,
        name,
        tmp_path / "2.fmu",
    )
    assert other == ""
    first = paths[0].read_bytes()
    assert first == paths[1].read_bytes() == (tmp_path / "2.fmu").read_bytes()


def test_simulate_fmu_drives_the_plant_alone_to_what_its_equations_say(fmus):
    course = fmpy.simulate_fmu(
        str(fmus["plant"]), stop_time=0.2, output_interval=1e-3, start_values={"u": 20.0}
    )
    model = Model(fmu_kernel("plant"))
    model.set_input("u", 20.0)
    truth = model.simulate(np.arange(201) * 1e-3)
    for name in ("x", "v", "z", "i", "friction"):
        scale = np.ptp(truth.outputs[name])
        np.testing.assert_allclose(course[name], truth.outputs[name], atol=1e-6 * scale)


def test_variable_steps_end_where_equal_steps_end(fmus):
    ends = []
    for steps in ([1e-3] * 50, [5e-4, 1.5e-3] * 25, [0.05]):
        slave, vr = opened(fmus["plant"], {"u": 20.0})
        t = 0.0
        for h in steps:
            slave.doStep(t, h)
            t += h
        ends.append(slave.getReal([vr[n] for n in ("x", "v", "i")]))
        slave.terminate()
        slave.freeInstance()
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6)
    np.testing.assert_allclose(ends[2], ends[0], rtol=1e-6)


def test_a_state_serialized_in_one_process_goes_on_in_another(fmus, tmp_path):
    code = """
        import sys, json
        sys.path.insert(0, sys.argv[3])
        from pathlib import Path
        from fmu_host import opened
        slave, vr = opened(sys.argv[1], {"u": 20.0})
        file = Path(sys.argv[2])
        if file.exists():
            slave.setFMUstate(slave.deSerializeFMUstate(file.read_bytes()))
        else:
            for k in range(30):
                slave.doStep(k * 1e-3, 1e-3)
            file.write_bytes(slave.serializeFMUstate(slave.getFMUstate()))
        for k in range(30, 60):
            slave.doStep(k * 1e-3, 1e-3)
        print(json.dumps(slave.getReal([vr[n] for n in ("x", "v", "z", "i", "friction")])))
    """
    here = SUPPORT
    runs = [python(code, fmus["plant"], tmp_path / "state", here) for _ in range(2)]
    assert json.loads(runs[0]) == json.loads(runs[1])


def test_reset_gives_the_first_course_again(fmus):
    slave, vr = opened(fmus["nctf"])
    outputs = [vr["u"], vr["u_rate"]]

    def course():
        slave.setReal([vr["x_d"]], [0.08])
        table = []
        for k in range(10):
            slave.doStep(k * 1e-3, 1e-3)
            table.append(slave.getReal(outputs))
        return table

    first = course()
    slave.reset()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    assert course() == first
    slave.terminate()
    slave.freeInstance()


def test_parameters_set_after_construction_take_effect(fmus):
    for r, current in ((21.4, 20 / 21.4), (10.0, 2.0)):
        slave, vr = opened(fmus["plant"], {"u": 20.0, "R": r, "ke": 0.0, "kt": 1e-9})
        slave.doStep(0.0, 0.1)
        (measured,) = slave.getReal([vr["i"]])
        assert measured == pytest.approx(current, rel=1e-6)
        slave.terminate()
        slave.freeInstance()


def test_a_hundred_instances_of_two_fmus_live_in_one_process(fmus):
    """pythonfmu 0.7 frees the slave's namespace from the second instance on; ours survive."""
    code = """
        import sys
        sys.path.insert(0, sys.argv[3])
        from fmu_host import opened
        slaves = [opened(sys.argv[1 + k % 2], name=f"i{k}")[0] for k in range(100)]
        for k, slave in enumerate(slaves):
            slave.doStep(0.0, 1e-3)
        for slave in slaves:
            slave.terminate()
            slave.freeInstance()
        print("done")
    """
    out = python(code, fmus["plant"], fmus["nctf"], SUPPORT)
    assert out == "done\n"


def test_processes_that_ran_fmus_end_without_a_crash(fmus):
    """pythonfmu 0.7 corrupts the heap at exit, seen in 13 of 20 processes; ours end cleanly."""
    code = "import sys, fmpy; fmpy.simulate_fmu(sys.argv[1], stop_time=0.01)"
    for _ in range(10):
        python(code, fmus["nctf"])


@pytest.mark.parametrize("order", [("iol", "nctf"), ("nctf", "iol")])
def test_either_loading_order_runs_each_ones_own_code(fmus, order):
    code = """
        import sys
        sys.path.insert(0, sys.argv[3])
        from fmu_host import opened
        for path in sys.argv[1:3]:
            slave, vr = opened(path)
            slave.setReal([vr["x"], vr["v"], vr["x_d"]], [0.01, 0.02, 0.08])
            print(slave.getReal([vr["u"]])[0])
    """
    out = python(code, *(fmus[n] for n in order), SUPPORT).split()
    model_outputs = {}
    for name in order:
        model = Model(fmu_kernel(name))
        for signal, value in {"x": 0.01, "v": 0.02, "x_d": 0.08}.items():
            model.set_input(signal, value)
        model_outputs[name] = model.outputs(0.0, model.x)["u"]
    assert [float(v) for v in out] == pytest.approx([model_outputs[n] for n in order], rel=1e-12)


def test_an_older_version_of_the_same_fmu_runs_beside_the_newer(tmp_path):
    """Same model name, other equations: each keeps its own code."""
    from dataclasses import replace

    from ballscrew.solver.component import symbol

    new = component("pid")
    doubled = replace(new.outputs[0], value=2 * new.outputs[0].value)
    old = replace(new, outputs=(doubled,))
    export(new, tmp_path / "new.fmu")
    export(old, tmp_path / "old.fmu")
    assert symbol("Kp") in new.outputs[0].value.free_symbols
    answers = []
    for name in ("new", "old", "new"):
        slave, vr = opened(tmp_path / f"{name}.fmu")
        slave.setReal([vr["x_d"]], [0.08])
        answers.append(slave.getReal([vr["u"]])[0])
        slave.terminate()
        slave.freeInstance()
    assert answers[1] == pytest.approx(2 * answers[0], rel=1e-12)
    assert answers[2] == answers[0]


def test_an_fmu_needs_neither_this_project_nor_sympy_and_no_compiled_core(fmus, tmp_path):
    """All are blocked in the host; without the core the same steps are done in plain Python."""
    code = """
        import sys
        for name in filter(None, sys.argv[2].split(",")):
            sys.modules[name] = None
        import fmpy
        r = fmpy.simulate_fmu(sys.argv[1], stop_time=0.02, output_interval=1e-3,
                              start_values={"u": 20.0})
        assert not any(m == "ballscrew" or m.startswith("ballscrew.") for m, v in
                       sys.modules.items() if v is not None)
        print(*(float(v) for v in r[-1]))
    """
    bare = tmp_path / "plant.fmu"
    with zipfile.ZipFile(fmus["plant"]) as whole, zipfile.ZipFile(bare, "w") as without:
        cores = [n for n in whole.namelist() if "/c/libcore" in n]
        assert len(cores) == 1
        for name in set(whole.namelist()) - set(cores):
            without.writestr(name, whole.read(name))
    runs = [
        [float(v) for v in python(code, fmu, "sympy,ballscrew,scipy,matplotlib").split()]
        for fmu in (fmus["plant"], bare)
    ]
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"Fc": -1.0}, "parameter Fc = -1 N is out of its range [1e-09, inf]"),
        ({"u": float("nan")}, "u was set to nan, not a number"),
        ({"solver_tolerance": 1.0}, "solver_tolerance = 1 is out of its range"),
    ],
)
def test_errors_reach_the_host_as_text_and_fail_the_step(fmus, values, text):
    slave, vr = opened(fmus["plant"], values, name="axis")
    with pytest.raises(Exception, match="fmi2DoStep failed"):
        slave.doStep(0.0, 1e-3)
    message = slave.getString([vr["message"]])[0].decode()
    assert message.startswith("axis: ")
    assert text in message
    slave.reset()
    slave.freeInstance()


def test_a_solution_that_leaves_every_bound_fails_with_a_text():
    """A component made a minute ago whose state blows up at t = 1."""

    from ballscrew.solver.component import Component, Output, State, symbol

    x = symbol("x")
    blow_up = Component(
        "blow_up",
        "x' = x^2",
        states=(State("x", "1", "state", x**2, start=1.0),),
        outputs=(Output("y", "1", "output", x),),
    )
    path = export(blow_up, Path(tempfile.mkdtemp()) / "blow_up.fmu")
    slave, vr = opened(path)
    slave.doStep(0.0, 0.5)
    assert slave.getReal([vr["y"]])[0] == pytest.approx(2.0, rel=1e-6)
    with pytest.raises(Exception, match="fmi2DoStep failed"):
        slave.doStep(0.5, 1.0)
    assert "t = 1" in slave.getString([vr["message"]])[0].decode()
    slave.freeInstance()


def test_a_sampled_controller_holds_between_samples_whatever_the_steps(fmus):
    courses = []
    for h in (1e-3, 2.5e-4, 5e-4):
        slave, vr = opened(fmus["pid_sampled"])
        values = []
        for k in range(round(8e-3 / h)):
            t = k * h
            slave.setReal([vr["x"], vr["x_d"]], [1e-3 * round(t * 1e3 - 0.499), 0.08])
            slave.doStep(t, h)
            values.append(slave.getReal([vr["u"]])[0])
        per_sample = np.array(values).reshape(8, -1)
        assert np.all(per_sample == per_sample[:, :1])
        courses.append(per_sample[:, 0])
        slave.terminate()
        slave.freeInstance()
    np.testing.assert_array_equal(courses[0], courses[1])
    np.testing.assert_array_equal(courses[0], courses[2])


def test_an_output_that_follows_an_input_with_a_feedback_law_is_described(tmp_path):
    """The law's own clock stands in such an equation and is no variable of the FMU."""
    x, u = symbol("x"), symbol("u")
    component = Component(
        "through",
        "an output with direct feed-through",
        inputs=(Input("u", "1", "command", law=("x",)),),
        states=(State("x", "1", "state", u - x),),
        outputs=(Output("x", "1", "state", x), Output("doubled", "1", "twice u", 2 * u)),
    )
    path = export(component, tmp_path / "through.fmu")
    assert validate_fmu(str(path)) == []
    slave, at = opened(path, {"u": 3.0})
    assert slave.getReal([at["doubled"]]) == [6.0]
    slave.terminate()
    slave.freeInstance()

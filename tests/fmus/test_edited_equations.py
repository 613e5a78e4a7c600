"""A readable FMU whose equations were edited runs what they say now."""

import zipfile

import numpy as np
import pytest
import sympy as sp
from any_fmu import Host
from scipy.integrate import solve_ivp

from ballscrew.fmus.export import export
from ballscrew.solver.component import Component, Input, Output, State, symbol

X, V, U = map(symbol, "xvu")
STEP, STEPS = 0.05, 40


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A damped swing, pulled at."""
    component = Component(
        "swing",
        "A swing",
        inputs=(Input("u", "N", "pull"),),
        states=(
            State("x", "m", "place", V),
            State("v", "m/s", "speed", U - 9 * sp.sin(X) - V / 4),
        ),
        outputs=(Output("x", "m", "place", X),),
    )
    return export(component, tmp_path_factory.mktemp("swing") / "swing.fmu")


def edited(path, folder, old, new):
    """As a user would: unzip, edit the equations, zip."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    (name,) = (n for n in files if n.startswith("resources/equations_"))
    text = files[name].decode()
    assert old in text
    files[name] = text.replace(old, new, 1).encode()
    with zipfile.ZipFile(folder / "edited.fmu", "w") as archive:
        for file, data in files.items():
            archive.writestr(file, data)
    return folder / "edited.fmu"


def course(path):
    """Places at the ends of steps under a constant pull, and what the FMU logs."""
    host = Host(path, {"u": 1.0})
    found = []
    for k in range(STEPS):
        host.step(k * STEP, STEP)
        found += host.get("x")
    host.close()
    return np.array(found), " ".join(host.heard)


def by_scipy(spring):
    times = STEP * np.arange(1, STEPS + 1)
    solved = solve_ivp(
        lambda t, y: [y[1], 1.0 - spring(y[0]) - y[1] / 4],
        (0.0, times[-1]),
        [0.0, 0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )
    return solved.y[0]


def test_edited_equations_are_run_though_their_slopes_were_left(swing, tmp_path):
    exported, said = course(swing)
    assert "plain" not in said
    assert exported == pytest.approx(by_scipy(lambda x: 9 * np.sin(x)), abs=1e-6)
    path = edited(swing, tmp_path, "math.sin(x_)", "math.sinh(50*x_)")
    found, said = course(path)
    assert "was edited: it runs in plain Python, which is slow" in said
    assert found == pytest.approx(by_scipy(lambda x: 9 * np.sinh(50 * x)), abs=1e-6)
    # the one as exported is not taken for it, in the same process
    assert np.array_equal(course(swing)[0], exported)


def test_equations_that_cannot_be_run_are_one_line(swing, tmp_path):
    for new, words in (
        ("math.sin(x_", "cannot be run: '(' was never closed"),
        ("sin(x_)", "name 'sin' is not defined"),
    ):
        host = Host(edited(swing, tmp_path, "math.sin(x_)", new), {"u": 1.0})
        with pytest.raises(Exception, match="DoStep"):
            host.step(0.0, STEP)
        assert words in host.message()
        assert "\n" not in host.message()
        host.close()

"""``ballscrew export --loop``: one FMU of a whole closed loop, for either kind of simulation."""

from functools import cache

import fmpy
import numpy as np
import pytest
from any_fmu import KINDS, Host
from every_component import IN_LOOPS
from fmpy.validation import validate_fmu

from ballscrew import Loop
from ballscrew.cli import main
from ballscrew.orchestration.loop import catalogue
from ballscrew.orchestration.loop.whole_loop import run_monolithic

GOAL, STOP, STEP = 0.08, 2.0, 1e-2
OPTIONS = {"readable": [], "native-2": ["--native"], "native-3": ["--native", "--fmi", "3"]}
rare = pytest.mark.ci


@pytest.fixture(scope="module")
def loop(request, tmp_path_factory):
    """``loop(controller, kind)`` is the path of the loop's FMU, as the command writes it."""
    made = {}

    def get(controller, kind):
        if kind != "readable":
            request.getfixturevalue("native")  # which skips without a compiler
        if (controller, kind) not in made:
            folder = tmp_path_factory.mktemp("loop")
            assert main(["export", "--loop", controller, *OPTIONS[kind], "--out", str(folder)]) == 0
            made[controller, kind] = folder / f"{controller}_loop.fmu"
        return made[controller, kind]

    return get


@cache
def truth(controller, every=10, first=0, **values):
    """The signals of one solver on the steps' grid."""
    loop = Loop(controller, reference=GOAL, stop=STOP, controller_values=values)
    run = run_monolithic(loop, 1e-3)
    return {n: y[first::every] for n, y in (run.outputs | run.commands).items()}


def stepped(path, names, values=None):
    """Signals at the communication points, the step of the set-point from the start on."""
    host = Host(path, {"x_d": GOAL} | (values or {}))
    rows = [host.get(*names)]
    for k in range(round(STOP / STEP)):
        host.step(k * STEP, STEP)
        rows.append(host.get(*names))
    host.close()
    return dict(zip(names, np.array(rows).T, strict=True))


@pytest.mark.parametrize(
    ("controller", "kind"),
    [
        *(("iol", kind) for kind in ("readable", "native-2")),
        pytest.param("iol", "native-3", marks=rare),
        *(pytest.param("nctf", kind, marks=rare) for kind in KINDS),
    ],
)
def test_the_loop_follows_one_solver_at_ten_milliseconds(loop, controller, kind):
    got, expected = stepped(loop(controller, kind), ["x", "v", "u"]), truth(controller)
    assert np.ptp(expected["x"]) > 0.07
    assert np.abs(got["x"] - expected["x"]).max() < 1e-8
    for name in ("v", "u"):
        assert np.abs(got[name] - expected[name]).max() < 1e-5 * np.ptp(expected[name]), name


@pytest.mark.parametrize("kind", ["readable", *(pytest.param(k, marks=rare) for k in KINDS[1:])])
def test_a_sampled_controller_meets_all_its_instants_within_a_step(loop, kind):
    """At a communication point `u` is what was held up to there: the instant comes after it."""
    got = stepped(loop("pid_sampled", kind), ["x", "u"], {"controller_w_start": 1e-3})
    assert np.abs(got["x"] - truth("pid_sampled", w_start=1e-3)["x"]).max() < 1e-8
    assert got["u"][0] == 0.0
    held = truth("pid_sampled", first=9, w_start=1e-3)["u"]
    assert np.abs(got["u"][1:] - held).max() < 1e-5 * np.ptp(held)


@pytest.mark.parametrize(
    ("controller", "kind"),
    [
        *(("iol", kind) for kind in KINDS[:2]),
        *(
            pytest.param(name, kind, marks=rare if name == "nctf" else pytest.mark.prove)
            for name in IN_LOOPS
            for kind in KINDS
        ),
    ],
)
def test_it_is_valid_with_the_set_point_as_input_and_names_that_say_whose_they_are(
    loop, controller, kind
):
    path = str(loop(controller, kind))
    assert validate_fmu(path) == []
    variables = fmpy.read_model_description(path).modelVariables
    assert [v.name for v in variables if v.causality == "input"][:1] == ["x_d"]
    outputs = [v.name for v in variables if v.causality == "output"]
    assert outputs[:6] == ["x", "v", "z", "i", "u", "friction"]
    parameters = {v.name for v in variables if v.causality == "parameter" and v.unit}
    own = catalogue.component(controller).all_parameters
    assert {"plant_sigma0", "plant_x_start", *(f"controller_{p.name}" for p in own)} <= parameters


# -- model exchange --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("controller", "kind", "allowed"),
    [
        ("iol", "native-2", 1e-6),
        pytest.param("iol", "native-3", 1e-6, marks=rare),
        pytest.param("nctf", "native-2", 2e-7, marks=rare),
    ],
)
def test_the_loop_for_model_exchange_under_cvode(loop, controller, allowed, kind):
    """6.1e-7 m and 9.2e-8 m at a relative tolerance of 1e-6, a solver that is not ours."""
    course = fmpy.simulate_fmu(
        str(loop(controller, kind)),
        fmi_type="ModelExchange",
        stop_time=STOP,
        output_interval=1e-3,
        relative_tolerance=1e-6,
        start_values={"x_d": GOAL},
        output=["x"],
    )
    expected = truth(controller, every=1)["x"]
    at = np.arange(len(expected)) * 1e-3
    assert np.abs(np.interp(at, course["time"], course["x"]) - expected).max() < allowed

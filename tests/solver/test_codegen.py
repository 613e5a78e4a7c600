"""Generated functions against the symbolic equations they come from."""

import numpy as np
import sympy as sp

from ballscrew.solver.codegen import generate
from ballscrew.solver.component import (
    TIME,
    Component,
    Delay,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    State,
    symbol,
)
from ballscrew.solver.core import CHANGES_MODE, EITHER, RESETS


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

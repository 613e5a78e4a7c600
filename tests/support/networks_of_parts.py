"""Systems of several small FMUs, and the solution of each complete system by SciPy."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from ballscrew import Component, DiscreteState, Input, Output, Parameter, State, symbol

SSD = """<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="parts"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="parts">
    <ssd:Elements>{elements}</ssd:Elements>
    <ssd:Connections>{connections}</ssd:Connections>
  </ssd:System>
</ssd:SystemStructureDescription>
"""


def write_system(
    path: Path,
    elements: Mapping[str, Path],
    connections: Sequence[str],
    values: Mapping[str, Mapping[str, float | tuple[str, str]]] | None = None,
    said: Mapping[str, tuple[str, str]] | None = None,
) -> Path:
    """An .ssp of FMUs by the names of their elements, with connections such as "a.x -> b.y".

    `values` are the parameters of elements, by element and name, as numbers or as kinds and texts;
    `said` are further attributes and content of elements, in XML.
    """
    more = dict.fromkeys(elements, ("", "")) | dict(said or {})
    listed = "".join(
        f'<ssd:Component name="{name}" source="resources/{fmu.name}" {more[name][0]}>'
        f"{more[name][1]}{_parameters((values or {}).get(name, {}))}</ssd:Component>"
        for name, fmu in elements.items()
    )
    joined = ""
    for text in connections:
        (a, x), (b, y) = (end.split(".") for end in text.split(" -> "))
        start, end = f'startElement="{a}" startConnector="{x}"', f'endElement="{b}"'
        joined += f'<ssd:Connection {start} {end} endConnector="{y}"/>'
    with zipfile.ZipFile(path, "w") as archive:
        ssd = SSD.format(elements=listed, connections=joined)
        archive.writestr("SystemStructure.ssd", ssd)
        for fmu in sorted(set(elements.values())):
            archive.write(fmu, f"resources/{fmu.name}")
    return path


def _parameters(values: Mapping[str, float | tuple[str, str]]) -> str:
    if not values:
        return ""
    named = ""
    for name, value in values.items():
        kind, text = value if isinstance(value, tuple) else ("Real", repr(value))
        named += f'<ssv:Parameter name="{name}"><ssv:{kind} value="{text}"/></ssv:Parameter>'
    return (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="1.0" name="parameters"><ssv:Parameters>{named}'
        "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )


def _inputs(*names: str, role: str = "signal") -> tuple[Input, ...]:
    return tuple(Input(n, "1", "signal", role=role) for n in names)


def _outputs(**values: object) -> tuple[Output, ...]:
    return tuple(Output(n, "1", "signal", v) for n, v in values.items())


# -- a plant in three parts: the force of friction is a law of the screw's speed
# ---------------------

R, L, KE, KT, MASS = 2.0, 2e-3, 20.0, 20.0, 5.0
SIGMA0, SIGMA1, SIGMA2, COULOMB, STATIC, STRIBECK = 1e5, 300.0, 60.0, 30.0, 40.0, 0.01
KP, KD, GOAL = 900.0, 20.0, 0.05


def motor() -> Component:
    i, v, u = symbol("i"), symbol("v"), symbol("u")
    rate = (u - R * i - KE * v) / L
    return Component(
        "motor",
        "a DC motor that pushes",
        inputs=_inputs("u", "v"),
        states=(State("i", "1", "current", rate),),
        outputs=_outputs(T=KT * i),
    )


def screw() -> Component:
    v, force, friction = symbol("v"), symbol("T"), symbol("F")
    return Component(
        "screw",
        "a mass that is pushed and rubs",
        inputs=tuple(Input(n, "1", "force", law=("x", "v")) for n in ("T", "F")),
        states=(
            State("x", "1", "position", v),
            State("v", "1", "speed", (force - friction) / MASS),
        ),
        outputs=_outputs(x=symbol("x"), v=v),
    )


def friction() -> Component:
    """The friction law of LuGre, whose force depends directly on the speed."""
    import sympy as sp

    v, z = symbol("v"), symbol("z")
    level = COULOMB + (STATIC - COULOMB) * sp.exp(-((v / STRIBECK) ** 2))
    rate = v - SIGMA0 * sp.Abs(v) / level * z
    return Component(
        "friction",
        "LuGre friction of a speed",
        inputs=_inputs("v", role="measurement"),
        states=(State("z", "1", "bristle", rate, nominal=1e-4),),
        outputs=_outputs(F=SIGMA0 * z + SIGMA1 * rate + SIGMA2 * v),
    )


def position_controller() -> Component:
    return Component(
        "position_controller",
        "u = Kp (goal - x) - Kd v",
        inputs=_inputs("x", "v"),
        outputs=_outputs(u=KP * (GOAL - symbol("x")) - KD * symbol("v")),
    )


CUT_IN_THREE = (
    "controller.u -> motor.u",
    "screw.v -> motor.v",
    "motor.T -> screw.T",
    "screw.v -> friction.v",
    "friction.F -> screw.F",
    "screw.x -> controller.x",
    "screw.v -> controller.v",
)
LAW_WIRES = (
    "friction.F_gain_v -> screw.F_gain_v",
    "friction.F_ref_v -> screw.F_ref_v",
    "friction.F_rate -> screw.F_rate",
)


def whole_drive(times: np.ndarray) -> np.ndarray:
    """x, v, i, z of the drive as one system, shape (times, 4)."""

    def rates(_: float, s: np.ndarray) -> list[float]:
        x, v, i, z = s
        level = COULOMB + (STATIC - COULOMB) * np.exp(-((v / STRIBECK) ** 2))
        slip = v - SIGMA0 * abs(v) / level * z
        force = SIGMA0 * z + SIGMA1 * slip + SIGMA2 * v
        u = KP * (GOAL - x) - KD * v
        return [v, (KT * i - force) / MASS, (u - R * i - KE * v) / L, slip]

    solved = solve_ivp(
        rates, (0, times[-1]), np.zeros(4), "Radau", times, rtol=1e-9, atol=1e-12, max_step=1e-3
    )
    return solved.y.T


# -- two axes on one digital controller that uses their distance --------------------------

PERIOD, SPRING, DAMPER, SHARE = 2e-3, 60.0, 12.0, 25.0


def axis() -> Component:
    x, v, u = symbol("x"), symbol("v"), symbol("u")
    return Component(
        "axis",
        "a mass of its own with viscous friction",
        parameters=(Parameter("m", 1.0, "kg", "mass", "made up"),),
        inputs=_inputs("u"),
        states=(
            State("x", "1", "position", v),
            State("v", "1", "speed", (u - 3.0 * v) / symbol("m")),
        ),
        outputs=_outputs(x=x, v=v),
    )


def two_axis_controller() -> Component:
    def command(own: str, other: str) -> object:
        apart = symbol(f"x{own}") - symbol(f"x{other}")
        return SPRING * (1.0 - symbol(f"x{own}")) - DAMPER * symbol(f"v{own}") - SHARE * apart

    return Component(
        "two_axis_controller",
        "digital; each axis is pulled to the goal and to the other axis",
        inputs=_inputs("x1", "v1", "x2", "v2"),
        discrete=(
            DiscreteState("h1", "1", "held", command("1", "2")),
            DiscreteState("h2", "1", "held", command("2", "1")),
        ),
        sample_time=Parameter("sample_time", PERIOD, "s", "period", "made up", minimum=1e-6),
        outputs=_outputs(u1=symbol("h1"), u2=symbol("h2")),
    )


TWO_AXES = (
    "controller.u1 -> left.u",
    "controller.u2 -> right.u",
    *(f"left.{n} -> controller.{n}1" for n in "xv"),
    *(f"right.{n} -> controller.{n}2" for n in "xv"),
)


def whole_axes(times: np.ndarray, masses: tuple[float, float]) -> np.ndarray:
    """x and v of both axes by SciPy from sample to sample, shape (times, 4)."""
    state, rows, now = np.zeros(4), {0.0: np.zeros(4)}, 0.0
    samples = round(times[-1] / PERIOD)
    for k in range(samples):
        x1, v1, x2, v2 = state
        u = [
            SPRING * (1 - x1) - DAMPER * v1 - SHARE * (x1 - x2),
            SPRING * (1 - x2) - DAMPER * v2 - SHARE * (x2 - x1),
        ]

        def rates(_: float, s: np.ndarray, u: list[float] = u) -> list[float]:
            return [s[1], (u[0] - 3 * s[1]) / masses[0], s[3], (u[1] - 3 * s[3]) / masses[1]]

        end = (k + 1) * PERIOD
        state = solve_ivp(rates, (now, end), state, rtol=1e-10, atol=1e-12).y[:, -1]
        now = end
        rows[round(end, 9)] = state
    known = np.array(sorted(rows))
    table = np.array([rows[t] for t in known])
    return np.column_stack([np.interp(times, known, column) for column in table.T])


# -- a chain of masses and springs -----------------------------------------------------------------

LINKS, STIFFNESS, DAMPING = 20, 400.0, 1.5


def link() -> Component:
    x, v = symbol("x"), symbol("v")
    pull = STIFFNESS * (symbol("before") - 2 * x + symbol("after")) - DAMPING * v
    return Component(
        "link",
        "a mass between two springs",
        inputs=_inputs("before", "after"),
        parameters=(Parameter("push", 0.0, "N", "force from outside", "made up"),),
        states=(State("x", "1", "position", v), State("v", "1", "speed", pull + symbol("push"))),
        outputs=_outputs(x=x),
    )


CHAIN = (
    *(f"m{k}.x -> m{k + 1}.before" for k in range(LINKS - 1)),
    *(f"m{k + 1}.x -> m{k}.after" for k in range(LINKS - 1)),
)


def whole_chain(times: np.ndarray, push: float) -> np.ndarray:
    """Positions, shape (times, links), by the matrix exponential; the first mass is pushed."""
    from scipy.linalg import expm

    n = LINKS
    springs = STIFFNESS * (np.eye(n, k=1) - 2 * np.eye(n) + np.eye(n, k=-1))
    whole = np.zeros((2 * n + 1, 2 * n + 1))
    whole[:n, n : 2 * n] = np.eye(n)
    whole[n : 2 * n, :n], whole[n : 2 * n, n : 2 * n] = springs, -DAMPING * np.eye(n)
    whole[n, -1] = push
    start = np.zeros(2 * n + 1)
    start[-1] = 1.0
    return np.array([(expm(whole * t) @ start)[:n] for t in times])

"""Modelica of a component says what the component does; read here by a reader of its own."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import sympy as sp
from diagnosed import run, whole

from ballscrew.fmus.modelica import modelica
from ballscrew.orchestration.loop.catalogue import NAMES, component, fmu_kernel
from ballscrew.solver.component import Component, Output, Parameter, State, symbol
from ballscrew.solver.errors import ContractError
from ballscrew.solver.kernel import Model

FUNCTIONS = {n: getattr(math, n) for n in ("exp", "sin", "cos", "tan", "atan", "tanh", "sqrt")}
FUNCTIONS |= {"abs": abs, "max": max, "min": min, "log": math.log, "floor": math.floor}
FUNCTIONS |= {"sign": np.sign, "ceil": math.ceil, "mod": lambda a, b: a - b * math.floor(a / b)}
FUNCTIONS["choose"] = lambda condition, value, other: value if condition else other
PYTHON = {"^": "**", "<>": "!=", "true": "True", "false": "False"}
TOKEN = re.compile(r"\s*(\d+\.?\d*(?:e[-+]?\d+)?|\w+|<=|>=|<>|==|[-+*/^(),<>])")


def value_of(text, known):
    """Modelica's expressions as Python's, which has the same order of operations but for "if"."""
    words, open_ifs = [], [0]
    for word in [*TOKEN.findall(text), ")"]:
        if word in ("if", "elseif"):
            words.append(", choose(" if word == "elseif" else "choose(")
            open_ifs[-1] += 1
        elif word in ("then", "else"):
            words.append(",")
        elif word == "(":
            words.append(word)
            open_ifs.append(0)
        elif word in (")", ","):
            words.append(")" * open_ifs[-1] + word)
            open_ifs[-1] = 0
            if word == ")":
                open_ifs.pop()
        else:
            words.append(PYTHON.get(word, word + ".0" * word.isdigit()))
    return eval("(" + " ".join(words), FUNCTIONS | known)


def equations(text):
    """Left and right sides, in the order of the text."""
    body = text.partition("\nequation\n")[2].partition("  annotation")[0]
    sides = [part.split(" = ", 1) for part in body.replace("\n", " ").split(";") if part.strip()]
    return {left.strip(): right for left, right in sides}


def declared(text):
    """Values of parameters and constants."""
    found = re.findall(
        r"^  (?:parameter|constant) Real (\w+)(?:\(.*?\))? = ([-\d.e+]+)", text, re.M
    )
    return {name: float(value) for name, value in found}


def evaluated(text, known):
    """All left sides, each as soon as what it needs is known."""
    known = {**declared(text), **known}
    left = equations(text)
    while left:
        done = []
        for name, right in left.items():
            try:
                known[name] = value_of(right, known)
                done.append(name)
            except NameError:
                continue
        assert done, left
        left = {n: r for n, r in left.items() if n not in done}
    return known


FIRST = "plant", "iol", "nctf"


@pytest.mark.parametrize(
    "name", [n if n in FIRST else pytest.param(n, marks=pytest.mark.ci) for n in NAMES]
)
def test_the_equations_are_those_that_the_solver_has(name):
    part = component(name)
    for there, what in ((part.modes, "modes"), (part.discrete, "samples"), (part.delays, "delays")):
        if there:
            with pytest.raises(ContractError, match=f"{name} has {what}, which the Modelica"):
                modelica(part)
            return
    text = modelica(part)
    model = Model(fmu_kernel(name))
    random = np.random.default_rng(5)
    nominal = np.array([s.nominal for s in model.kernel.states])
    for _ in range(5):
        x = nominal * random.normal(size=len(nominal)) * 10.0 ** random.uniform(-1, 1)
        known = {s.name: v for s, v in zip(model.kernel.states, x.tolist(), strict=True)}
        for i in part.inputs:
            known[i.name] = value = float(i.nominal * random.normal())
            model.set_input(i.name, value)
        found = evaluated(text, {**known, "time": 0.0})
        rates = model.derivatives(0.0, x)
        for s, rate in zip(model.kernel.states, rates, strict=True):
            assert found[f"der({s.name})"] == pytest.approx(rate, rel=1e-9, abs=1e-12)
        outputs = model.outputs(0.0, x)
        for o in part.all_outputs:
            assert found[o.name] == pytest.approx(outputs[o.name], rel=1e-9, abs=1e-12)


def test_units_and_meanings_stand_in_it_as_modelica_spells_them():
    text = modelica(component("plant"))
    assert 'parameter Real Jm(unit="kg.m2", min=0.0) = 0.0 "rotor inertia' in text
    assert 'input Real u(unit="V", start=0.0, nominal=10.0) "motor terminal voltage";' in text
    start = (
        'output Real x(unit="m", start=x_start, fixed=true, nominal=0.001) "position of the block"'
    )
    assert start in text


def test_a_name_that_is_a_word_of_modelica_is_refused():
    state = State("x", "m", "place", -symbol("end") * symbol("x"))
    part = Component(
        "fall", "A fall", (Parameter("end", 1.0, "1/s", "rate", "made"),), states=(state,)
    )
    with pytest.raises(ContractError, match="end is a keyword of Modelica"):
        modelica(part)


@pytest.mark.parametrize(
    "value",
    [
        sp.Max(symbol("x"), 0.3, -symbol("x")),
        sp.Heaviside(symbol("x")),
        sp.Mod(symbol("x"), 0.7),
        sp.asinh(symbol("x")) + sp.coth(symbol("x") + 3),
        sp.Piecewise((1, sp.And(symbol("x") > 0, symbol("x") < 1)), (symbol("x") ** -2, True)),
        sp.Piecewise((1, sp.Or(symbol("x") > 1, sp.Not(symbol("x") > -1))), (0, True)),
        (symbol("x") ** 2) ** sp.Rational(1, 3) - sp.sqrt(sp.Abs(symbol("x"))),
        -(symbol("x") ** 2) / (1 - symbol("x") / 3) / sp.exp(-symbol("x")),
    ],
)
def test_every_form_of_expression_has_its_value(value):
    part = Component(
        "made",
        "Made",
        states=(State("x", "m", "place", -symbol("x")),),
        outputs=(Output("y", "1", "value", value),),
    )
    for at in (-1.7, 0.4, 2.1):
        expected = float(value.subs(symbol("x"), at))
        assert evaluated(modelica(part), {"x": at})["y"] == pytest.approx(expected, rel=1e-12)


def test_the_command_writes_parts_and_loops_with_the_values_of_a_file(tmp_path):
    file = tmp_path / "axis.toml"
    file.write_text(whole(m=2.5, x_start=0.01) + "[controller.pid]\nKp = 300\n")
    given = ("--modelica", "--params", file)
    assert run("export", *given, "--component", "plant", "pid", "--out", tmp_path / "parts")[0] == 0
    plant = declared((tmp_path / "parts" / "plant.mo").read_text())
    assert (plant["m"], plant["x_start"]) == (2.5, 0.01)
    assert declared((tmp_path / "parts" / "pid.mo").read_text())["Kp"] == 300.0
    assert run("export", *given, "--loop", "pid", "--out", tmp_path / "loop")[0] == 0
    text = (tmp_path / "loop" / "pid_loop.mo").read_text()
    assert text.startswith("model pid_loop ")
    assert declared(text)["controller_Kp"] == 300.0

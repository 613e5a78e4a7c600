"""pymoca: Modelica as CasADi's expressions, solved by CVODES.

Each equation of the files has one name on its left side. The equations are substituted into each
other until derivatives and outputs depend only on time and states.
"""

import logging
import re
import tempfile
from pathlib import Path

import casadi
from host import answer_models
from pymoca.backends.casadi.api import transfer_model

logging.disable(logging.CRITICAL)


def run(job, name, text):
    with tempfile.TemporaryDirectory() as folder:
        # it has the inverse tangent with CasADi's name
        (Path(folder) / f"{name}.mo").write_text(text.replace("atan(", "arctan("))
        model = transfer_model(folder, name, {"cache": False})
    known = [*model.parameters, *model.constants]
    values = casadi.vertcat(*(v.value for v in known))
    symbols = casadi.vertcat(*(v.symbol for v in known))
    numbers = {v.symbol.name(): v.value for v in known}
    states = {s.symbol.name(): s.symbol for s in model.states}
    rates = {f"der({s})": d.symbol for s, d in zip(states, model.der_states, strict=True)}
    others = {s.symbol.name(): s.symbol for s in model.alg_states}
    left = re.findall(r"^  (der\(\w+\)|\w+) = ", text.partition("\nequation\n")[2], re.M)
    named = {**others, **rates}
    right = {}
    for n, equation in zip(left, model.equations, strict=True):
        right[n] = casadi.substitute(-casadi.substitute(equation, named[n], 0), symbols, values)
    found = {}
    while right:
        ready = [
            n
            for n, value in right.items()
            if not {s.name() for s in casadi.symvar(value)} & {named[k].name() for k in right}
        ]
        for n in ready:
            found[n] = right.pop(n)
        if right:
            of = casadi.vertcat(*(named[n] for n in ready))
            to = casadi.vertcat(*(found[n] for n in ready))
            right = {n: casadi.substitute(v, of, to) for n, v in right.items()}
    x = casadi.vertcat(*states.values())
    time = [k * job["step"] for k in range(round(job["stop"] / job["step"]) + 1)]
    shown = casadi.Function("shown", [model.time, x], [casadi.vertcat(*(found[n] for n in others))])
    rows = []
    if states:
        ode = casadi.vertcat(*(found[n] for n in rates))
        options = {"reltol": job["tolerance"], "abstol": 1e-3 * job["tolerance"]}
        dae = {"x": x, "t": model.time, "ode": ode}
        solver = casadi.integrator("solver", "cvodes", dae, 0.0, time, options)
        rows = solver(x0=[float(numbers[f"{s}_start"]) for s in states])["xf"].full().tolist()
    at = casadi.DM(rows) if rows else casadi.DM.zeros(0, len(time))
    rows += shown(casadi.DM(time).T, at).full().tolist()
    return time, dict(zip([*states, *others], rows, strict=True))


answer_models(run)

"""Whether two installed versions compute the same: every part, every loop, every gallery system.

``python proofs/same_results.py write FILE.json`` computes with the installed package; ``python
proofs/same_results.py compare OLD.json NEW.json`` prints the differences, and exits with 1 if a
number differs by more than 1e-12 of the largest of its column, or is missing. Different words are
printed, but do not change the exit code. Only the commands, the public functions and the generator
of equations are used.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import sys
import tempfile
import zlib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ALLOWED = 1e-12
PRACTICE = [
    "pid+sampled+position_encoder",
    "iol+sampled",
    "nctf+position_encoder+velocity_estimate+current_sensor",
]
RUNS = """
run --controller iol --stop 0.5
run --controller pid --stop 0.3 --coupling jacobi
run --controller pid --stop 0.3 --coupling gauss-seidel
run --controller nctf --stop 0.3 --reference move:distance=0.02,speed=0.1,acceleration=1,jerk=50
swap --controllers iol nctf pid --stop 0.3
swap --controllers iol pid --sampled 1e-3 --noise --stop 0.3
lyapunov --controller iol --stop 5
lyapunov --controller nctf --stop 5
lyapunov --controller nctf --stop 2 --via fmu
lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20
map --controller iol --x sigma0_hat=66965.89:66969.24:3 --y sigma1_hat=339.56:367.56:3 --workers 1
rig 2.4/7
"""


def parts() -> dict[str, object]:
    """Rates, Jacobian and outputs of every part and law, in every mode, at points drawn by name."""
    import ballscrew as bs

    kinds = bs.catalogue()
    made = {n: bs.component(n) for k in ("plants", "controllers", "instruments") for n in kinds[k]}
    made |= {name: bs.component(name) for name in PRACTICE}
    x, v = bs.symbol("x"), bs.symbol("v")
    states = bs.State("x", "m", "position", v), bs.State("v", "m/s", "velocity")
    balance = bs.ForceBalance("v", 1, (bs.ForceTerm("spring", -100 * x, "a spring"),))
    body = bs.Component("body", "A mass", states=states, balances=(balance,))
    made |= {f"law {law}": bs.with_friction(body, law) for law in kinds["laws"]}
    return {
        f"{name}, {where}: {what}": value
        for name, component in made.items()
        for where, values in values_of(component)
        for what, value in values.items()
    }


def values_of(component: object) -> Iterator[tuple[str, dict[str, float]]]:
    from ballscrew.solver.codegen import generate
    from ballscrew.solver.kernel import Model

    kernel = generate(component)
    states = [s.name for s in kernel.states]
    for point in range(4):

        def drawn(row: Any, point: int = point) -> float:
            return np.random.default_rng(zlib.crc32(f"{row.name} {point}".encode())).normal()

        for mode in range(max(1, len(kernel.modes))):
            model = Model(kernel)
            model.p *= [1 + 0.05 * math.tanh(drawn(p)) for p in kernel.parameters]
            held = [drawn(h) * h.nominal for h in (*kernel.inputs, *kernel.discrete)]
            model.u[: len(held)] = held
            if kernel.modes:
                model.u[-1] = mode
            at = np.array([drawn(s) * s.nominal for s in kernel.states])
            rates, matrix = model.derivatives(0.1, at), model.jacobian(0.1, at)
            got = dict(zip(states, rates.tolist(), strict=True)) | model.outputs(0.1, at)
            for of, row in zip(states, matrix.tolist(), strict=True):
                got |= {f"{of} by {by}": value for by, value in zip(states, row, strict=True)}
            yield f"mode {mode}, point {point}", got


def commands() -> list[list[str]]:
    """The commands, each run in a separate folder; the slowest first."""
    from ballscrew import catalogue
    from ballscrew.gallery import SYSTEMS

    words = [f"gallery {name}" for name in SYSTEMS] + RUNS.strip().split("\n")
    for controller in (*catalogue()["controllers"], *PRACTICE):
        run = f"run --controller {controller} --stop 0.3 --step 1e-3"
        words += [run, f"{run} --coupling monolithic"]
    return [line.split() for line in words]


def result_of(command: list[str]) -> dict[str, object]:
    """The numbers printed by a command, and those in its tables."""
    from ballscrew.cli import main

    as_json = [] if command[0] == "rig" else ["--json"]
    printed = io.StringIO()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "out"
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            found: dict[str, object] = {"code": main([*command, "--out", str(folder), *as_json])}
        if as_json:
            found |= leaves(json.loads(printed.getvalue()))
        for path in sorted(folder.rglob("*.csv")):
            with path.open(newline="") as file:
                rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
            for column in rows[0] if rows else ():
                found[f"{path.name} {column}"] = [number(row[column]) for row in rows]
        for path in folder.rglob("*.parquet"):
            found |= leaves(json.loads(pd.read_parquet(path).to_json(double_precision=15)))
    return {f"{' '.join(command)}: {key}": value for key, value in found.items()}


def number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word


def leaves(tree: object, path: str = "") -> dict[str, object]:
    if isinstance(tree, dict | list):
        pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
        return {k: v for name, branch in pairs for k, v in leaves(branch, f"{path}/{name}").items()}
    return {path: tree}


def difference(old: object, new: object) -> float | str:
    """Largest difference over the largest magnitude; a text if values are not numbers."""
    old, new = (v if isinstance(v, list) else [v] for v in (old, new))
    if len(old) != len(new):
        return f"{len(old)} values became {len(new)}"
    pairs = [(a, b) for a, b in zip(old, new, strict=True) if repr(a) != repr(b)]
    if not all(isinstance(v, int | float) for pair in pairs for v in pair):
        return "{!r} became {!r}".format(*pairs[0])
    size = max((abs(v) for v in old if isinstance(v, int | float) and v == v), default=0.0)
    return max((abs(a - b) / size if size else math.inf for a, b in pairs), default=0.0)


def compare(old: dict[str, object], new: dict[str, object]) -> int:
    found = {key: difference(old[key], new[key]) for key in old if key in new}
    differing = {key: how for key, how in found.items() if how != 0.0}
    words = {key for key in differing if isinstance(old[key], str)}
    bad = [
        k for k, d in differing.items() if k not in words and (isinstance(d, str) or d > ALLOWED)
    ]
    missing = sorted(old.keys() - new.keys())
    for key in missing:
        print(f"missing: {key}")
    for key, how in differing.items():
        print(f"{'words: ' if key in words else ''}{key}: {how}")
    print(f"{len(found) - len(differing)} of {len(old)} the same to the bit, {len(bad)} differ by")
    print(f"more than {ALLOWED:g}, {len(words)} in words; {len(missing)} are missing")
    return 1 if bad or missing else 0


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "write":
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            written = pool.submit(parts)
            results = {k: v for got in pool.map(result_of, commands()) for k, v in got.items()}
            Path(sys.argv[2]).write_text(json.dumps(written.result() | results), "utf-8")
    elif len(sys.argv) == 4 and sys.argv[1] == "compare":
        raise SystemExit(compare(*(json.loads(Path(p).read_text("utf-8")) for p in sys.argv[2:])))
    else:
        raise SystemExit(__doc__)

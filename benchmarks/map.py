"""Time of a stability map: 816 cells of Gamma_1, compared with plain runs of the same loops.

    python benchmarks/map.py

Prints processor time of this process. A plain run simulates the loop over the cell's 20 s with the
same solver and tolerance, without a verdict; the difference is the cost of the verdict. With
exponents the tolerance is smaller.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the command and its workers

from collections import defaultdict
from contextlib import suppress
from itertools import chain
from time import process_time

from ballscrew.orchestration.loop.loop import Loop
from ballscrew.solver.kernel import IntegrationError
from ballscrew.stability.map_plan import kernel_of, model_at, run_cell
from ballscrew.stability.stability_map import plan_map

X, Y = "sigma0_hat=66965.89:66969.24:34", "sigma1_hat=339.56:367.56:24"
STOP = 20.0  # s


def costs(exponents: bool) -> dict[str, list[tuple[float, float]]]:
    """Seconds of each cell and of its plain run, by verdict."""
    plan = plan_map(Loop("iol", stop=STOP), X, Y, exponents)
    kernel_of(plan).compile()
    system, tolerance = kernel_of(plan).system(), plan.tolerance
    found = defaultdict(list)
    for number in range(plan.cells):
        point = plan.point(number)
        began = process_time()
        model = model_at(plan, *point, tolerance, system)
        with suppress(IntegrationError):  # some diverge
            model.advance(0.0, STOP)
        plain = process_time()
        cell = run_cell(plan, *point, tolerance, system)
        found[cell.verdict.value].append((process_time() - plain, plain - began))
    return found


def main() -> None:
    for exponents in (False, True):
        found = costs(exponents)
        print(f"\n{'with exponents' if exponents else 'verdicts from the motion'}")
        print(f"{'verdict':<30}{'cells':>6}{'ms a cell':>12}{'ms a plain run':>16}{'ratio':>8}")
        rows = sorted(found.items(), key=lambda row: -len(row[1]))
        for verdict, pairs in (*rows, ("all", list(chain(*found.values())))):
            cell, plain = (1e3 * sum(part) / len(pairs) for part in zip(*pairs, strict=True))
            print(f"{verdict:<30}{len(pairs):>6}{cell:>12.2f}{plain:>16.2f}{cell / plain:>8.1f}")


if __name__ == "__main__":
    main()

"""Write what Simulink, OpenModelica and Dymola are compared with: a table, and Dymola's script.

`python docs/write_howto_table.py`
"""

import re
from pathlib import Path

import numpy as np

from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

FOLDER = Path(__file__).resolve().parent / "howto" / "scripts"
GOAL = 0.08  # [m]
STOP, EVERY = 2.0, 0.005  # [s]


def course() -> np.ndarray:
    """Rows of t [s], x [m] and u [V] of the loop of iol in the project's solver."""
    model = Model(fmu_kernel("iol", "plant"), tolerance=1e-11)
    model.set_input("x_d", GOAL)
    time = EVERY * np.arange(round(STOP / EVERY) + 1)
    outputs = model.simulate(time).outputs
    return np.column_stack([time, outputs["x"], outputs["u"]])


def main() -> None:
    rows = course()
    lines = [",".join(["time", "x", "u"]), *(",".join(f"{v:.10g}" for v in r) for r in rows)]
    (FOLDER / "iol_step.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    script = FOLDER / "dymola.mos"
    text = script.read_text(encoding="utf-8")
    for column, name in enumerate(("times", "known")):
        values = ", ".join(f"{r[column]:.10g}" for r in rows[::40])
        text = re.sub(rf"(?m)^{name} = .*$", f"{name} = {{{values}}};", text)
    script.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

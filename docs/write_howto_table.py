"""Write the table that Simulink, OpenModelica and Dymola are compared with, and Dymola's script.

`python docs/write_howto_table.py`
"""

from pathlib import Path

import numpy as np

from ballscrew.orchestration.loop.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

FOLDER = Path(__file__).resolve().parent / "howto" / "scripts"
GOAL = 0.08  # [m]
STOP, EVERY = 2.0, 0.005  # [s]
DYMOLA = """// Not run by its authors: written after its documentation, checked for syntax alone.
// ballscrew export --native --only plant iol --out native
// Put this file and axis_dymola.mo into the folder of the FMUs, and there:
// RunScript("dymola.mos");
// the third argument: true is model exchange, false co-simulation
importFMU("plant.fmu", true, true, false, "");
importFMU("iol.fmu", true, true, false, "");
openModel("axis_dymola.mo", changeDirectory=false);
ok = simulateModel("Axis", stopTime=2.0, numberOfIntervals=2000, method="Dassl", \
tolerance=1e-6, resultFile="axis");
times = {TIMES};
known = {KNOWN};
found = interpolateTrajectory("axis.mat", {"x"}, times);
off = max(abs(found[1, :] - known));
// 1e-5 and less is as it should be
Modelica.Utilities.Streams.print("x is off by " + String(off) + " m");
"""


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
    some = rows[::40]
    text = DYMOLA.replace("{TIMES}", "{" + ", ".join(f"{r[0]:g}" for r in some) + "}")
    text = text.replace("{KNOWN}", "{" + ", ".join(f"{r[1]:.10g}" for r in some) + "}")
    (FOLDER / "dymola.mos").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

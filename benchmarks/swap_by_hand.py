"""The function of `ballscrew swap`, written by hand with FMPy only, to count lines and time.

    python benchmarks/swap_by_hand.py FOLDER STEP [--law]

FOLDER has plant.fmu and the controllers; `--law` also wires the ports of the feedback law. Prints a
table; writes NAME.csv into FOLDER. There is no error estimate, because FMPy has none.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

GOAL, STOP = 0.08, 4.0  # m, s


class Part:
    def __init__(self, path, stop):
        description = read_model_description(path)
        self.folder = extract(path)
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        named = {"input": [], "output": []}
        for v in description.modelVariables:
            named.setdefault(v.causality, []).append(v.name)
        self.inputs, self.outputs = named["input"], named["output"]
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0, stopTime=stop)
        self.fmu.enterInitializationMode()

    def get(self, names):
        return self.fmu.getReal([self.reference[n] for n in names])

    def set(self, names, values):
        self.fmu.setReal([self.reference[n] for n in names], values)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


def run(plant_path, controller_path, step, law):
    plant, controller = Part(plant_path, STOP), Part(controller_path, STOP)
    up = [n for n in plant.outputs if n in controller.inputs]
    down = [n for n in controller.outputs if n in plant.inputs and (law or n == "u")]
    controller.set(["x_d"], [GOAL])
    controller.set(up, plant.get(up))
    controller.fmu.exitInitializationMode()
    plant.set(down, controller.get(down))
    plant.fmu.exitInitializationMode()
    rows = []
    for k in range(round(STOP / step)):
        rows.append([k * step, plant.get(["x"])[0], controller.get(["u"])[0]])
        plant.set(down, controller.get(down))
        controller.set(up, plant.get(up))
        plant.fmu.doStep(k * step, step)
        controller.fmu.doStep(k * step, step)
    rows.append([STOP, plant.get(["x"])[0], controller.get(["u"])[0]])
    plant.close()
    controller.close()
    return np.array(rows)


def settling(t, x):
    outside = np.flatnonzero(np.abs(x - GOAL) > 0.02 * GOAL)
    return t[min(outside[-1] + 1, len(t) - 1)] if outside.size else 0.0


def main(folder, step, law):
    print(f"{'controller':<12}{'settling [s]':>14}{'overshoot [%]':>15}{'peak u [V]':>12}")
    for path in sorted(folder.glob("*.fmu")):
        if path.stem != "plant":
            t, x, u = run(folder / "plant.fmu", path, step, law).T
            np.savetxt(folder / f"{path.stem}.csv", np.column_stack([t, x, u]), delimiter=",")
            over = 100.0 * max(x.max() / GOAL - 1.0, 0.0)
            print(f"{path.stem:<12}{settling(t, x):>14.3f}{over:>15.2f}{abs(u).max():>12.2f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]), "--law" in sys.argv)

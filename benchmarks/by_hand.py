"""A closed loop of two FMUs, as one writes it by hand with FMPy.

There is no error estimate, because FMPy has none. A digital controller's step comes before that of
the plant; `law` also wires the ports of the feedback law.
"""

import shutil

import fmpy
import numpy as np
from fmpy.simulation import instantiate_fmu


class Part:
    def __init__(self, path, stop):
        description = fmpy.read_model_description(path)
        self.folder = fmpy.extract(path)
        variables = description.modelVariables
        self.reference = {v.name: v.valueReference for v in variables}
        self.inputs = [v.name for v in variables if v.causality == "input"]
        self.outputs = [v.name for v in variables if v.causality == "output"]
        self.fmu = instantiate_fmu(self.folder, description, "CoSimulation")
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


def run(plant_path, controller_path, goals, step, law=False, digital=False):
    stop = step * (len(goals) - 1)
    plant, controller = Part(plant_path, stop), Part(controller_path, stop)
    up = [n for n in plant.outputs if n in controller.inputs]
    down = [n for n in controller.outputs if n in plant.inputs and (law or n == "u")]
    controller.set(["x_d", *up], [goals[0], *plant.get(up)])
    controller.fmu.exitInitializationMode()
    plant.set(down, controller.get(down))
    plant.fmu.exitInitializationMode()
    rows = []
    for k, goal in enumerate(goals[:-1]):
        rows.append([k * step, plant.get(["x"])[0], controller.get(["u"])[0]])
        if not digital:
            plant.set(down, controller.get(down))
        controller.set(["x_d", *up], [goal, *plant.get(up)])
        if digital:
            controller.fmu.doStep(k * step, step)
            plant.set(down, controller.get(down))
        plant.fmu.doStep(k * step, step)
        if not digital:
            controller.fmu.doStep(k * step, step)
    rows.append([stop, plant.get(["x"])[0], controller.get(["u"])[0]])
    plant.close()
    controller.close()
    return np.array(rows)

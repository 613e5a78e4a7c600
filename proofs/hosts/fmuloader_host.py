"""fmuloader: the functions of FMI by themselves, for FMI 2 and 3."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
from fmuloader.fmi3 import Fmi3Slave
from host import answer, steps


def run(job):
    path = Path(next(iter(job["fmus"].values())))
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    (x,) = (int(v.get("valueReference")) for v in root.iter() if v.get("name") == "x")
    two = root.get("fmiVersion") == "2.0"
    name = root.find("CoSimulation").get("modelIdentifier")
    if two:
        fmu = Fmi2Slave(path, model_identifier=name)
        fmu.instantiate("loop", Fmi2Type.CO_SIMULATION, guid=root.get("guid"))
        fmu.setup_experiment(0.0)
        read = fmu.get_real
    else:
        fmu = Fmi3Slave(path, model_identifier=name)
        fmu.instantiate_co_simulation("loop", instantiation_token=root.get("instantiationToken"))
        read = fmu.get_float64
    fmu.enter_initialization_mode()
    fmu.exit_initialization_mode()
    time, course = [0.0], [read([x])[0]]
    for k in range(steps(job)):
        fmu.do_step(k * job["step"], job["step"])
        time.append((k + 1) * job["step"])
        course.append(read([x])[0])
    return time, course


answer(run)

"""jaxonomy: a block diagram with an integrator, stepped by its own solver."""

from pathlib import Path

from jaxonomy.library.fmu_export import build_fmu
from maker import answer, beside

SCRIPT = """
import jaxonomy
from jaxonomy.library import Adder, Gain, Integrator
from jaxonomy.library.fmu_slave import JaxonomyDiagramSlave


def diagram():
    builder = jaxonomy.DiagramBuilder()
    error = builder.add(Adder(2, operators="+-", name="error"))
    integral = builder.add(Integrator(0.0, name="integral"))
    gains = [builder.add(Gain(k, name=n)) for n, k in {gains}.items()]
    command = builder.add(Adder(3, operators="++-", name="command"))
    builder.export_input(error.input_ports[0], "x_d")
    builder.export_input(error.input_ports[1], "x")
    builder.connect(error.output_ports[0], integral.input_ports[0])
    builder.connect(error.output_ports[0], gains[0].input_ports[0])
    builder.connect(integral.output_ports[0], gains[1].input_ports[0])
    builder.export_input(gains[2].input_ports[0], "v")
    for k, gain in enumerate(gains):
        builder.connect(gain.output_ports[0], command.input_ports[k])
    builder.export_output(command.output_ports[0], "u")
    return builder.build()


class Pid(JaxonomyDiagramSlave):
    DIAGRAM_FACTORY = staticmethod(diagram)
    DT = 1e-3
"""


def make(gains, scratch: Path, target: Path):
    script = scratch / "pid_diagram.py"
    text = SCRIPT.replace("{gains}", repr({n: gains[n] for n in ("Kp", "Ki", "Kd")}))
    script.write_text(beside() + text, encoding="utf-8")
    build_fmu(script, target)


answer(make)

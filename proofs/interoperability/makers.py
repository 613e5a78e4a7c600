"""Other programs make an FMU of the same PID: ``makers.py PROGRAM GAINS TARGET``.

Each runs in its own environment. The gains Kp, Ki and Kd are in JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

Gains = dict[str, float]


def _held(gains: Gains) -> str:
    """The body of a `do_step` with inputs that are held over the step, as Python."""
    return (
        "        error = self.x_d - self.x\n"
        "        self.w += step_size * error\n"
        f"        self.u = {gains['Kp']!r} * error + {gains['Ki']!r} * self.w"
        f" - {gains['Kd']!r} * self.v\n"
        "        return True\n"
    )


def _beside() -> str:
    """Lines with which an FMU's Python finds this environment's packages, after its own."""
    places = [p for p in sys.path if p.endswith("site-packages")]
    return f"import sys\nsys.path += {places!r}\n"


def _script(scratch: Path, text: str) -> Path:
    path = scratch / "pid_by_hand.py"
    path.write_text(text, encoding="utf-8")
    return path


def casadi(gains: Gains, scratch: Path, target: Path) -> None:
    """FMI 3.0 for model exchange: CasADi writes sources, which the user compiles and packs."""
    import casadi as ca
    import fmpy

    model = ca.DaeBuilder("pid")
    model.add("time", "independent")
    x_d, x, v = (model.add(name, "input", "continuous") for name in ("x_d", "x", "v"))
    w = model.add("w", "local", "continuous")
    u = model.add("u", "output", "continuous")
    model.eq(model.der(w), x_d - x)
    model.eq(u, gains["Kp"] * (x_d - x) + gains["Ki"] * w - gains["Kd"] * v)
    os.chdir(scratch)
    files = model.export_fmu()
    headers = Path(fmpy.__file__).parent / "c-code"  # those of FMI 3.0
    sources = [f for f in files if f.endswith(".c")]
    command = ["gcc", "-shared", "-fPIC", f"-I{headers}", *sources, "-o", "pid.so", "-lm"]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in files:
            archive.write(name, name if name.endswith(".xml") else f"sources/{name}")
        archive.write("pid.so", "binaries/x86_64-linux/pid.so")


COMPONENT_MODEL = """
from component_model.model import Model
from component_model.variable import Variable


class Pid(Model):
    def __init__(self, **kwargs):
        super().__init__("Pid", "PID of position", "somebody else", **kwargs)
        self.x = self.v = self.x_d = self.u = self.w = 0.0
        for name, causality in {"x": "input", "v": "input", "x_d": "input", "u": "output"}.items():
            variable = Variable(
                self, name, name, causality=causality, variability="continuous", start=0.0
            )
            setattr(self, "_" + name, variable)

    def do_step(self, current_time, step_size):
        super().do_step(current_time, step_size)
"""


def component_model(gains: Gains, scratch: Path, target: Path) -> None:
    from component_model.model import Model

    script = _script(scratch, _beside() + COMPONENT_MODEL + _held(gains))
    Path(Model.build(script, dest=str(scratch))).replace(target)


JAXONOMY = """
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


def jaxonomy(gains: Gains, scratch: Path, target: Path) -> None:
    """A block diagram with an integrator, stepped by its own solver."""
    from jaxonomy.library.fmu_export import build_fmu

    build_fmu(_script(scratch, _beside() + JAXONOMY.replace("{gains}", repr(gains))), target)


PYTHONFMU3 = """
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64


class Pid(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.x = self.v = self.x_d = self.u = self.w = 0.0
        continuous = Fmi3Variability.continuous
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=continuous)
        )
        for name in ("x", "v", "x_d"):
            self.register_variable(Float64(name, causality=Fmi3Causality.input))
        self.register_variable(Float64("u", causality=Fmi3Causality.output))
        self.register_variable(Float64("w", causality=Fmi3Causality.local))

    def do_step(self, current_time, step_size):
"""


def pythonfmu3(gains: Gains, scratch: Path, target: Path) -> None:
    """A Python class that computes outputs in its step, as FMI 3.0."""
    from pythonfmu3.builder import FmuBuilder

    built = FmuBuilder.build_FMU(_script(scratch, PYTHONFMU3 + _held(gains)), dest=scratch)
    Path(built).replace(target)


PYTHONFMU = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Pid(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.v = self.x_d = self.u = self.w = 0.0
        for name in ("x", "v", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("u", causality=Fmi2Causality.output))
        self.register_variable(Real("w", causality=Fmi2Causality.local))

    def do_step(self, current_time, step_size):
"""


def pythonfmu(gains: Gains, scratch: Path, target: Path) -> None:
    """A Python class that computes outputs in its step, and whose variables are saved states."""
    from pythonfmu.builder import FmuBuilder

    script = _script(scratch, PYTHONFMU + _held(gains))
    FmuBuilder.build_FMU(script, dest=target, canGetAndSetFMUstate=True)


def qfmu(gains: Gains, scratch: Path, target: Path) -> None:
    """A state-space model as C with Euler steps of 1e-5 s; u1, u2, u3 are x_d, x, v and y1 is u."""
    through = [gains["Kp"], -gains["Kp"], -gains["Kd"]]
    matrices = {"A": [[0.0]], "B": [[1.0, -1.0, 0.0]], "C": [[gains["Ki"]]], "D": [through]}
    options = [part for n, matrix in matrices.items() for part in (f"-{n}", json.dumps(matrix))]
    command = [Path(sys.executable).with_name("qfmu"), "ss", *options, "-dt", "1e-5", "-o", target]
    subprocess.run(command, cwd=scratch, check=True)


UNIFMU = """
import pickle

from fmi2 import Fmi2FMU, Fmi2Status


class Model(Fmi2FMU):
    def __init__(self, reference_to_attr=None):
        super().__init__(reference_to_attr)
        self.x = self.v = self.x_d = self.u = self.w = 0.0

    def serialize(self):
        return Fmi2Status.ok, pickle.dumps((self.x, self.v, self.x_d, self.u, self.w))

    def deserialize(self, kept):
        self.x, self.v, self.x_d, self.u, self.w = pickle.loads(kept)
        return Fmi2Status.ok

    def do_step(self, current_time, step_size, no_step_prior):
"""
INPUT = (
    '<ScalarVariable name="{0}" valueReference="{1}" variability="continuous" '
    'causality="input"><Real start="0.0" /></ScalarVariable>'
)
OUTPUT = (
    '<ScalarVariable name="u" valueReference="3" variability="continuous" '
    'causality="output" initial="calculated"><Real /></ScalarVariable>'
)


def unifmu(gains: Gains, scratch: Path, target: Path) -> None:
    """Its template for Python, in a process of its own; its launcher calls `python3`."""
    folder = scratch / "pid"
    command = [Path(sys.executable).with_name("unifmu"), "generate", "python", folder]
    subprocess.run(command, check=True)
    body = _held(gains).replace("return True", "return Fmi2Status.ok")
    (folder / "resources" / "model.py").write_text(UNIFMU + body, encoding="utf-8")
    launch = folder / "resources" / "launch.toml"
    text = launch.read_text(encoding="utf-8").replace('backend = "grpc"', 'backend = "zmq"')
    launch.write_text(text.replace('"python3"', f'"{sys.executable}"'), encoding="utf-8")
    description = folder / "modelDescription.xml"
    text = description.read_text(encoding="utf-8")
    inputs = (INPUT.format(name, k) for k, name in enumerate(("x", "v", "x_d")))
    unknown = '<Unknown index="4" />'
    parts = {"ModelVariables": "".join(inputs) + OUTPUT}
    for tag, inside in {**parts, "Outputs": unknown, "InitialUnknowns": unknown}.items():
        head, rest = text.split(f"<{tag}>")
        text = f"{head}<{tag}>{inside}</{tag}>{rest.split(f'</{tag}>')[1]}"
    description.write_text(text, encoding="utf-8")
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            archive.write(path, path.relative_to(folder))


if __name__ == "__main__":
    program, given, made = sys.argv[1:]
    place = Path(made).with_name(f"{Path(made).stem}_scratch")
    place.mkdir()
    globals()[program](json.loads(given), place, Path(made))

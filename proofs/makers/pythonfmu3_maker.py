"""pythonfmu3: a Python class that computes outputs in its step, as FMI 3.0."""

from pathlib import Path

from maker import answer, held
from pythonfmu3.builder import FmuBuilder

HEAD = """
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


def make(gains, scratch: Path, target: Path):
    script = scratch / "pid_slave3.py"
    script.write_text(HEAD + held(gains), encoding="utf-8")
    built = FmuBuilder.build_FMU(script, dest=scratch)
    Path(built).replace(target)


answer(make)

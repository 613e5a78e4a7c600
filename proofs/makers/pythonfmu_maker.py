"""pythonfmu: a Python class that computes outputs in its step."""

from pathlib import Path

from maker import answer, held
from pythonfmu.builder import FmuBuilder

HEAD = """
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


def make(gains, scratch: Path, target: Path):
    """With saved states, which it keeps of its variables."""
    script = scratch / "pid_slave.py"
    script.write_text(HEAD + held(gains), encoding="utf-8")
    FmuBuilder.build_FMU(script, dest=target, canGetAndSetFMUstate=True)


answer(make)

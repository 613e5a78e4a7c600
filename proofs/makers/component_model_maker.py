"""component-model: its model class, based on pythonfmu."""

from pathlib import Path

from component_model.model import Model
from maker import answer, beside, held

HEAD = """
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


def make(gains, scratch: Path, target: Path):
    script = scratch / "pid_component.py"
    script.write_text(beside() + HEAD + held(gains), encoding="utf-8")
    built = Model.build(script, dest=str(scratch))
    Path(built).replace(target)


answer(make)

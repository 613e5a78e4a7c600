"""FMUs as written by third parties, with pythonfmu only."""

import textwrap
from pathlib import Path

from pythonfmu.builder import FmuBuilder

PROPORTIONAL = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = 0.0
        self.v = 0.0
        self.x_d = 0.0
        self.u = 0.0
        for name in ("x", "v", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("u", causality=Fmi2Causality.output))
        if self.instance_name != "dummyInstance":  # what the builder calls it
            {at_start}

    def do_step(self, current_time, step_size):
        {in_step}
        self.u = {law}
        return True
"""


def proportional(
    folder: Path,
    name: str,
    *,
    in_step="pass",
    at_start="pass",
    head="",
    modules=None,
    law="400.0 * (self.x_d - self.x) - 2.0 * self.v",
    **options: bool,
) -> Path:
    """A controller u = 400 (x_d - x) - 2 v that computes outputs in its step, with given lines."""
    text = PROPORTIONAL.format(name=name, in_step=in_step, at_start=at_start, law=law)
    return _built(folder, name, head + textwrap.dedent(text), options, modules or {})


def _built(folder, name, text, options, modules) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    files = {f"script_{name.lower()}": text, **modules}
    for module, source in files.items():
        (folder / f"{module}.py").write_text(source)
    script, *others = (folder / f"{module}.py" for module in files)
    path = folder / f"{name}.fmu"
    FmuBuilder.build_FMU(script, dest=path, project_files=others, **options)
    return path


FOLLOWING = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in {inputs}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.gain = {gain}
        tunable = Fmi2Variability.tunable
        self.register_variable(
            Real("gain", causality=Fmi2Causality.parameter, variability=tunable)
        )
        law = lambda: {law}
        self.register_variable(Real({output!r}, causality=Fmi2Causality.output, getter=law))

    def do_step(self, current_time, step_size):
        return True
"""
STATE_FEEDBACK_PORTS = {"position": "x", "speed": "v", "goal": "x_d", "voltage": "u"}


def following(folder: Path, name: str, options: dict[str, bool], **parts) -> Path:
    """A part whose output follows its inputs at once."""
    return _built(folder, name, FOLLOWING.format(name=name, **parts), options, {})


def state_feedback(folder: Path, name: str, saves: bool = True) -> Path:
    """A controller with direct feedthrough: voltage = gain (goal - position) - 2 speed."""
    options = {"canGetAndSetFMUstate": True} if saves else {}
    law = "self.gain * (self.goal - self.position) - 2.0 * self.speed"
    ports = ("position", "speed", "goal")
    return following(folder, name, options, inputs=ports, gain=400.0, output="voltage", law=law)

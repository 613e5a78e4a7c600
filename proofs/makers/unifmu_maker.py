"""UniFMU: its template for Python, which runs in a separate process."""

import subprocess
import sys
import zipfile
from pathlib import Path

from maker import answer, held

MODEL = """
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
VARIABLES = {"x": "input", "v": "input", "x_d": "input", "u": "output"}


def make(gains, scratch: Path, target: Path):
    """Make the FMU; its launcher calls `python3`, so set the path as in an installation."""
    folder = scratch / "pid"
    subprocess.run(
        [Path(sys.executable).with_name("unifmu"), "generate", "python", folder], check=True
    )
    body = held(gains).replace("return True", "return Fmi2Status.ok")
    (folder / "resources" / "model.py").write_text(MODEL + body, encoding="utf-8")
    launch = folder / "resources" / "launch.toml"
    text = launch.read_text(encoding="utf-8").replace('backend = "grpc"', 'backend = "zmq"')
    launch.write_text(text.replace('"python3"', f'"{sys.executable}"'), encoding="utf-8")
    description = folder / "modelDescription.xml"
    text = description.read_text(encoding="utf-8")
    variables, outputs = [], ""
    for k, (name, causality) in enumerate(VARIABLES.items()):
        start = '<Real start="0.0" />' if causality == "input" else "<Real />"
        initial = "" if causality == "input" else ' initial="calculated"'
        variables.append(
            f'<ScalarVariable name="{name}" valueReference="{k}" variability="continuous" '
            f'causality="{causality}"{initial}>{start}</ScalarVariable>'
        )
        outputs += f'<Unknown index="{k + 1}" />' if causality == "output" else ""
    for tag, inside in {
        "ModelVariables": "".join(variables),
        "Outputs": outputs,
        "InitialUnknowns": outputs,
    }.items():
        head, rest = text.split(f"<{tag}>")
        text = f"{head}<{tag}>{inside}</{tag}>{rest.split(f'</{tag}>')[1]}"
    description.write_text(text, encoding="utf-8")
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            archive.write(path, path.relative_to(folder))


answer(make)

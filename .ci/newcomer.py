"""Does what README says, and no more, in an empty environment, from `git clone` on, and times it.

    python .ci/newcomer.py

Clones this repository, installs it with pip into a new environment with an empty home, runs each
command of README as it is written and its Python program, and compares what that prints. What a
reader brings is made here: `yours.fmu`, a controller by PythonFMU, and `record.csv` with
`axis.toml`, of an axis whose friction is larger than the file says. Exit code 1 if a step fails or
all takes more than ten minutes.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
ALLOWED = 600.0  # s
THEIRS = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Yours(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.v, self.x_d, self.u = 0.0, 0.0, 0.08, 0.0
        for name in ("x", "v", "x_d"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("u", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.u = 200.0 * (self.x_d - self.x) - 20.0 * self.v
        return True
"""
RECORD = """
import numpy as np
import ballscrew

times = np.linspace(0.0, 16.0, 641)
strokes = 0.03 * (1 - np.cos(np.pi * times / 2)) * (1 + 0.6 * np.sin(np.pi * times / 8))
plant = {p.name: p.default for p in ballscrew.component("plant").all_parameters}
run = ballscrew.run(
    "pid_sampled",
    plant_values={"Fc": 1.4 * plant["Fc"], "Fs": 1.4 * plant["Fs"]},
    reference=ballscrew.Reference(times, strokes),
    stop=16.0,
)
columns = [run.run.time, run.run.commands["u"], run.run.outputs["x"], run.run.outputs["i"]]
rows = np.column_stack(columns)[::2]
np.savetxt("record.csv", rows, delimiter=",", header="time,u,x,i", comments="")
"""


def step(folder: Path, *command: str | Path, allowed: tuple[int, ...] = (0,)) -> str:
    """Runs what a reader types, in the environment that is made, and says how long it took."""
    names = ("LANG", "PIP_INDEX_URL", "PIP_CONFIG_FILE", "PIP_FIND_LINKS")
    own = {n: os.environ[n] for n in names if n in os.environ}
    own |= {"HOME": f"{folder}/home", "PATH": f"{folder}/env/bin{os.pathsep}{os.environ['PATH']}"}
    typed, began = [str(c) for c in command], time.monotonic()
    done = subprocess.run(
        typed, cwd=folder, env=own, capture_output=True, encoding="utf-8", timeout=ALLOWED
    )
    print(f"{time.monotonic() - began:6.1f} s  {' '.join(typed)}", flush=True)
    if done.returncode not in allowed:
        raise SystemExit(f"exit code {done.returncode}: {(done.stderr or done.stdout)[-800:]}")
    return done.stdout


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.M | re.S)


def main() -> int:
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "home").mkdir()
        step(folder, "git", "clone", "--quiet", TOP, "ballscrew")
        step(folder, sys.executable, "-m", "venv", "env")
        step(folder, "python", "-m", "pip", "install", "--quiet", "./ballscrew")
        readme = (folder / "ballscrew" / "README.md").read_text(encoding="utf-8")
        (commands,), (program,), (printed,) = (
            blocks(readme, language) for language in ("console", "python", "text")
        )
        for name, text in (("yours", THEIRS), ("record", RECORD), ("program", program)):
            (folder / f"{name}.py").write_text(text, encoding="utf-8")
        step(folder, "pythonfmu", "build", "-f", "yours.py", "-d", ".")
        (folder / "Yours.fmu").rename(folder / "yours.fmu")
        step(folder, "python", "record.py")
        step(folder, "ballscrew", "run", "--controller", "pid", "--out", "known")
        (folder / "known" / "parameters.toml").rename(folder / "axis.toml")
        for line in commands.splitlines():
            command = line.removeprefix("$ ").partition("#")[0].split()
            out = folder / command[command.index("--out") + 1]
            # 1: done, and a controller is not trusted or a cause is not certain
            step(folder, *command, allowed=(0, 1))
            if not any(out.iterdir()):
                raise SystemExit(f"{out.name} is empty")
        swapped = (folder / "out" / "yours" / "comparison.csv").read_text(encoding="utf-8")
        if "yours" not in swapped or "pid" not in swapped or "not converged" in swapped:
            raise SystemExit(f"expected a comparison of yours and pid, both trusted:\n{swapped}")
        said = step(folder, "python", "program.py")
        if said.strip() != printed.strip():
            raise SystemExit(f"the program prints {said!r}, README says {printed!r}")
    took = time.monotonic() - began
    print(f"{took:6.1f} s  from git clone to all of README")
    return 0 if took < ALLOWED else 1


if __name__ == "__main__":
    raise SystemExit(main())

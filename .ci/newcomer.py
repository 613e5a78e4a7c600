"""Does what README says, and no more, in an empty environment, from `git clone` on, and times it.

    python .ci/newcomer.py

Clones this repository, installs it with pip into a new environment with an empty home, runs each
command of README as it is written and its Python program, and compares what that prints. Exit code
1 if a step fails or everything takes more than ten minutes.
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
        (folder / "program.py").write_text(program, encoding="utf-8")
        for line in commands.splitlines():
            command = line.removeprefix("$ ").partition("#")[0].split()
            out = folder / command[command.index("--out") + 1]
            # 1: done, and a controller is not trusted or a cause is not certain
            step(folder, *command, allowed=(0, 1))
            if not any(out.iterdir()):
                raise SystemExit(f"{out.name} is empty")
        swapped = (folder / "out" / "digital" / "comparison.csv").read_text(encoding="utf-8")
        if "pid" not in swapped or "not converged" in swapped:
            raise SystemExit(f"expected two trusted digital controllers:\n{swapped}")
        said = step(folder, "python", "program.py")
        if said.strip() != printed.strip():
            raise SystemExit(f"the program prints {said!r}, README says {printed!r}")
    took = time.monotonic() - began
    print(f"{took:6.1f} s  from git clone to all of README")
    return 0 if took < ALLOWED else 1


if __name__ == "__main__":
    raise SystemExit(main())

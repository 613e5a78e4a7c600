"""CasADi: its FMI 3.0 export for model exchange, compiled to a library by a C compiler.

The headers of FMI 3.0 come from FMPy.
"""

import os
import subprocess
import zipfile
from pathlib import Path

import casadi
import fmpy
from maker import answer


def make(gains, scratch: Path, target: Path):
    """Make the FMU: CasADi writes sources, which the user compiles and packs."""
    model = casadi.DaeBuilder("pid")
    model.add("time", "independent")
    x_d, x, v = (model.add(name, "input", "continuous") for name in ("x_d", "x", "v"))
    w = model.add("w", "local", "continuous")
    u = model.add("u", "output", "continuous")
    model.eq(model.der(w), x_d - x)
    model.eq(u, gains["Kp"] * (x_d - x) + gains["Ki"] * w - gains["Kd"] * v)
    os.chdir(scratch)
    files = model.export_fmu()
    headers = Path(fmpy.__file__).parent / "c-code"
    sources = [f for f in files if f.endswith(".c")]
    command = ["gcc", "-shared", "-fPIC", f"-I{headers}", *sources, "-o", "pid.so", "-lm"]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in files:
            archive.write(name, name if name.endswith(".xml") else f"sources/{name}")
        archive.write("pid.so", "binaries/x86_64-linux/pid.so")


answer(make)

"""Small FMUs of FMI 2.0 for co-simulation, made from a few lines of C each.

In these lines ``$name$`` is a variable, ``S[k]`` a state, `t` and `h` are the time and the length
of a step, and `stop` is the stop time that the FMU was told. A step returns the status of FMI.
"""

from __future__ import annotations

import importlib.util
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest
from any_fmu import repacked

# What is called with any arguments and only answers with a status of FMI.
_DONE = "SetDebugLogging EnterInitializationMode Terminate Reset SetInteger SetBoolean SetString"
_REFUSED = """SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate GetDirectionalDerivative
SetRealInputDerivatives GetRealOutputDerivatives CancelStep GetStatus GetRealStatus GetIntegerStatus
GetStringStatus GetInteger GetBoolean GetString"""
_C = """
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define API __attribute__((visibility("default")))
typedef struct { double r[@room], S[8], stop; } Part;
#define S (part->S)
#define stop (part->stop)
static void init(Part *part) { @init }
static void outputs(Part *part) { @out }
static int step(Part *part, double t, double h) { @step return 0; }
API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API void *fmi2Instantiate(const char *name, int kind, const char *guid) {
    if (strcmp(guid, "@name")) return NULL;
    const double starts[] = {@starts};
    Part *part = calloc(1, sizeof *part);
    memcpy(part->r, starts, sizeof starts);
    @inst
    return part;
}
API void fmi2FreeInstance(Part *part) { free(part); }
API int fmi2SetupExperiment(Part *part, int a, double b, double start, int told, double end) {
    stop = told ? end : HUGE_VAL;
    return 0;
}
API int fmi2ExitInitializationMode(Part *part) { init(part); outputs(part); return 0; }
API int fmi2GetReal(Part *part, const unsigned *which, size_t n, double *values) {
    outputs(part);
    for (size_t k = 0; k < n; k++) values[k] = part->r[which[k]];
    return 0;
}
API int fmi2SetReal(Part *part, const unsigned *which, size_t n, const double *values) {
    for (size_t k = 0; k < n; k++) part->r[which[k]] = values[k];
    return 0;
}
API int fmi2GetFMUstate(Part *part, void **kept) {
    *kept = memcpy(*kept ? *kept : malloc(sizeof *part), part, sizeof *part);
    return 0;
}
API int fmi2SetFMUstate(Part *part, void *kept) { memcpy(part, kept, sizeof *part); return 0; }
API int fmi2FreeFMUstate(void *part, void **kept) { free(*kept); *kept = NULL; return 0; }
API int fmi2GetBooleanStatus(Part *part, int kind, int *ended) { *ended = 0; return 0; }
API int fmi2DoStep(Part *part, double t, double h) {
    int status = step(part, t, h);
    outputs(part);
    return status;
}
"""
Variable = tuple[str, str, float | None, str]
MORE = {  # of `Real`, by causality
    "input": 'variability="continuous"',
    "output": 'variability="continuous" initial="calculated"',
    "parameter": 'variability="fixed" initial="exact"',
}


@cache
def _compiled(source: str) -> bytes:
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), "")
    command = [compiler] if compiler else [sys.executable, "-m", "ziglang", "cc"]
    if platform.machine() != "x86_64" or not (compiler or importlib.util.find_spec("ziglang")):
        pytest.skip("needs x86-64 and a C compiler; install one, or the package ziglang")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "part.c").write_text(source, encoding="utf-8")
        flags = ["-O1", "-w", "-shared", "-fPIC", "-o", "part.so", "part.c", "-lm"]
        subprocess.run([*command, *flags], cwd=folder, check=True)
        return (Path(folder) / "part.so").read_bytes()


def source_of(name: str, variables: Sequence[Variable], **lines: str) -> str:
    """The C of an FMU; `lines` are those of init, out, step and inst."""
    rows = {v[0]: f"part->r[{k}]" for k, v in enumerate(variables)}
    starts = ", ".join(repr(float(v[2] or 0.0)) for v in variables)
    parts = {"name": name, "starts": starts, "room": str(max(32, len(variables)))}
    parts |= {k: lines.get(k, "") for k in LINES}
    text = re.sub(r"@(\w+)", lambda found: parts[found[1]], _C)
    text = re.sub(r"\$(\w+)\$", lambda found: rows[found[1]], text)
    answers = dict.fromkeys(_DONE.split(), 0) | dict.fromkeys(_REFUSED.split(), 3)
    return text + "".join(f"API int fmi2{n}() {{ return {s}; }}\n" for n, s in answers.items())


LINES = ("init", "out", "step", "inst")


def build(
    path: str,
    name: str,
    variables: Sequence[Variable],
    *,
    saves: bool = True,
    varstep: bool = True,
    exp: str = "",
    units: str = "",
    deps: bool = True,
    sources: dict[str, str] | None = None,
    **lines: str,
) -> None:
    """Write an FMU of these variables: name, causality, start value and further attributes.

    `saves` and `varstep` say that its state can be saved, and that it takes any step; `exp` and
    `units` are elements of its description; with `deps`, outputs follow inputs at once; `sources`
    go into it instead of a library. `lines` are C by its place: init (when initialization ends),
    out (outputs), step, inst (when an instance is made).
    """
    inputs = [str(k) for k, v in enumerate(variables, 1) if v[1] == "input"]
    unknowns = "".join(
        f'<Unknown index="{k}" dependencies="{" ".join(inputs) if deps else ""}"/>'
        for k, v in enumerate(variables, 1)
        if v[1] == "output"
    )
    starts = ["" if start is None else f'start="{start}"' for _, _, start, _ in variables]
    scalars = "".join(
        f'<ScalarVariable name="{n}" valueReference="{k}" causality="{kind}" {MORE[kind]}>'
        f"<Real {starts[k]} {more}/></ScalarVariable>"
        for k, (n, kind, _, more) in enumerate(variables)
    )
    step, state = str(varstep).lower(), str(saves).lower()
    able = f'canHandleVariableCommunicationStepSize="{step}" canGetAndSetFMUstate="{state}"'
    files = f'<SourceFiles><File name="{name}.c"/></SourceFiles>' if sources else ""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "modelDescription.xml",
            '<?xml version="1.0" encoding="UTF-8"?>'
            f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}" '
            f'numberOfEventIndicators="0"><CoSimulation modelIdentifier="{name}" {able}>{files}'
            f"</CoSimulation>{units}{exp}<ModelVariables>{scalars}</ModelVariables>"
            f"<ModelStructure><Outputs>{unknowns}</Outputs>"
            f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>",
        )
        for file, text in (sources or {}).items():
            archive.writestr(f"sources/{file}", text)
        if not sources:
            library = _compiled(source_of(name, variables, **lines))
            archive.writestr(f"binaries/linux64/{name}.so", library)


def edited(path: str, *changes: tuple[str, str]) -> None:
    """Change the text of an FMU's description."""

    def edit(name: str, data: bytes) -> bytes:
        if name == "modelDescription.xml":
            for old, new in changes:
                assert data.count(old.encode()) == 1
                data = data.replace(old.encode(), new.encode())
        return data

    repacked(path, Path(path), edit)


# m x'' = u - d x', which is exact over a step with a constant u
PLANT_STEP = (
    "double F=$u$/$d$, v=S[1], e=exp(-$d$*h/$m$);S[0]+=F*h+(v-F)*(1-e)*$m$/$d$;S[1]=F+(v-F)*e;"
)
PLANT = [
    ("u", "input", 0, ""),
    ("x", "output", None, ""),
    ("v", "output", None, ""),
    ("m", "parameter", 1.0, ""),
    ("d", "parameter", 2.0, ""),
]


def plant(
    path: str, name: str = "cart", xa: str = "", scale: float = 1.0, bias: float = 0.0, **options
) -> None:
    """A cart with viscous friction; x is scale times metres + bias, and has the attributes `xa`."""
    names = options.pop("names", {})
    own = [(names.get(n, n), k, s, xa if n == "x" else a) for n, k, s, a in PLANT]
    own += options.pop("more", [])
    more_out = options.pop("more_out", "")
    lines = {"step": PLANT_STEP, "out": f"$x$={scale!r}*S[0]+{bias!r};$v$=S[1];{more_out}"}
    build(path, name, own, **{"deps": False} | lines | options)


def pd(path: str, name: str = "pd", scale: float = 1.0, bias: float = 0.0, **options) -> None:
    """A PD controller, which gets x in metres from scale times its measurement - bias."""
    own = [(n, "input", 0, "") for n in ("x", "v", "x_d")] + [("u", "output", None, "")]
    own += [("Kp", "parameter", 25.0, ""), ("Kd", "parameter", 8.0, "")]
    law = f"$u$=$Kp$*($x_d$-({scale!r}*$x$-{bias!r}))-$Kd$*$v$;"
    build(path, name, own, **{"out": law} | options)

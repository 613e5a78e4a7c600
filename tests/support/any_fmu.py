"""FMUs of every kind, readable and native, FMI 2 and 3, and one host for all of them."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import fmi2, fmi3

NATIVE = ("native-2", "native-3")
KINDS = ("readable", *NATIVE)


def repacked(source: Any, target: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of an archive, whose members are what `change` makes of their names and contents."""
    with zipfile.ZipFile(source) as old:
        members = {name: change(name, old.read(name)) for name in old.namelist()}
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for name, data in members.items():
            if data is not None:
                new.writestr(name, data)
    return target


def python(code: str, *arguments: Any) -> str:
    """Output of code in a process of its own, which ends without a crash."""
    head = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
    done = subprocess.run(
        [sys.executable, "-c", head + textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=tempfile.gettempdir(),  # the installed package, not this checkout
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


class Host:
    """One instance, and one name for what the two versions of FMI call differently.

    `at` are value references by name, `heard` messages that the FMU has logged.
    """

    def __init__(
        self,
        path: Any,
        values: Mapping[str, float] | None = None,
        *,
        exchange: bool = False,
        name: str = "instance",
        begun: bool = True,
    ) -> None:
        described = fmpy.read_model_description(str(path))
        self.variables = described.modelVariables
        self.at = {v.name: v.valueReference for v in self.variables}
        self.version = int(described.fmiVersion[0])
        self.heard: list[str] = []
        kind = described.modelExchange if exchange else described.coSimulation
        makers = {2: (fmi2.FMU2Slave, fmi2.FMU2Model), 3: (fmi3.FMU3Slave, fmi3.FMU3Model)}
        self.fmu = makers[self.version][exchange](
            guid=described.guid or described.instantiationToken,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=kind.modelIdentifier,
            instanceName=name,
        )
        if self.version == 2:
            self.logger = fmi2.fmi2CallbackLoggerTYPE(
                lambda _e, _n, _s, _c, text: self.heard.append(text.decode())
            )
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = self.logger
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            self.fmu.instantiate(callbacks=callbacks, loggingOn=True)
        else:
            self.fmu.instantiate(
                logMessage=lambda _e, _s, _c, text: self.heard.append(text.decode())
            )
        if begun:
            self.begin(values)

    def begin(
        self,
        values: Mapping[str, float] | None = None,
        tolerance: float | None = None,
        start: float = 0.0,
    ) -> None:
        """Initialize."""
        self.set(values or {})
        if self.version == 2:
            self.fmu.setupExperiment(tolerance=tolerance, startTime=start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(tolerance=tolerance, startTime=start)
        self.fmu.exitInitializationMode()

    def set(self, values: Mapping[str, float]) -> None:
        call = self.fmu.setReal if self.version == 2 else self.fmu.setFloat64
        call([self.at[n] for n in values], [float(v) for v in values.values()])

    def get(self, *names: str) -> list[float]:
        call = self.fmu.getReal if self.version == 2 else self.fmu.getFloat64
        return list(call([self.at[n] for n in names]))

    def step(self, t: float, h: float) -> None:
        self.fmu.doStep(t, h)

    def message(self) -> str:
        """Why it cannot go on."""
        (text,) = self.fmu.getString([self.at["message"]])
        return text.decode() if isinstance(text, bytes) else text

    def slopes(
        self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]
    ) -> list[float]:
        """Directional derivatives."""
        return list(
            self.fmu.getDirectionalDerivative(
                [self.at[n] for n in unknowns], [self.at[n] for n in knowns], [*seed]
            )
        )

    def update(self) -> bool:
        """Process events in event mode; whether states have changed."""
        three = self.version == 3
        return (self.fmu.updateDiscreteStates if three else self.fmu.newDiscreteStates)()[3]

    def set_states(self, values: Sequence[float]) -> None:
        if len(values):
            self.fmu.setContinuousStates((ctypes.c_double * len(values))(*values), len(values))

    def array(self, call: str, n: int) -> np.ndarray:
        """What a function that fills an array of `n` numbers answers."""
        room = (ctypes.c_double * n)()
        getattr(self.fmu, call)(room, n)
        return np.array(room)

    def close(self) -> None:
        self.fmu.freeInstance()

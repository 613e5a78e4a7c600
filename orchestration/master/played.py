"""A readable FMU of this version without Python calls, for runs that only check or try.

Its slave is made and initialized as by a host; then compiled code does the same as
``fmus/runtime.py``, with the FMU's own core and tapes, and with bit-identical results. A call takes
a tenth of a microsecond instead of two.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any, TypeGuard

import numpy as np

from ...fmus.carried_runtime import carried_runtime
from ...fmus.made_here import is_ours
from ...fmus.reading import UnpackedFmu
from ..fmu.fmi_versions import OK, STATE, STEP, Fmi2, Ports
from ..fmu.fmu_instance import FmuInstance, Instance
from .compiled import address_of, library, struct
from .fmi_calls import VALUES

_PLACES = ["parameters", "states", "tolerance", "time", "samples", "step_start", "sample_time"]


def reopened_to_judge(instance: Instance) -> Instance:
    """A new instance of the same FMU or group, played by compiled code if possible."""
    if can_be_played(instance):
        return instance.reopened(Played)
    return instance.reopened()


def can_be_played(instance: Instance) -> TypeGuard[FmuInstance]:
    """Whether compiled code can do what the instance does."""
    return isinstance(instance, FmuInstance) and _slave(instance._fmu) is not None


def _slave(fmu: UnpackedFmu) -> Any:
    """The slave's class, if the FMU contains the runtime of this version; else None."""
    named = fmu.folder / "resources" / "slavemodule.txt"
    if not (is_ours(fmu.path) and named.is_file()):
        return None
    slave = import_module(named.read_text("utf-8").strip()).Slave
    runtime = slave.__base__.__module__.partition(".")[0]
    # the history of delayed signals and frames of tangents are not in the memory
    plain = not (slave.layout["delays"] or slave.layout["frame"])
    return slave if plain and runtime == carried_runtime()[0] else None


class Played(Fmi2):
    """Replaces an FMU's library by its slave, in Python until it is initialized."""

    def __init__(self, fmu: UnpackedFmu, name: str, log: int) -> None:
        del log  # not used
        self._description = fmu.description
        self.ended, self.integrator, self._started = "", None, False
        self._slave = _slave(fmu)(instance_name=name, resources=str(fmu.folder / "resources"))
        self.library, *states = _functions()
        self.do_step, self.get_state, self.set_state, self.free_state = states
        slave, at = self._slave, self._slave.layout
        system, given = slave._system, slave._instance
        self._struct = struct("Played")
        self._struct.set(
            memory=slave.memory,
            nominal=slave._nominal,
            atol=slave._atol,
            update=slave._update,
            before=np.zeros(at["size"]),
            places=np.array(at["places"], dtype=np.int64),
            step=address_of(given._step),
            output=address_of(given._output),
            sample=system._system.sample,
            instance=given.address,
            system=system.address,
            discrete=at["inputs"],
            **{name: at[name] for name in _PLACES},
        )
        self.component = ctypes.c_void_p(self._struct.address)

    def transfer(self, verb: str, ports: Ports) -> int:
        if self._started:
            return super().transfer(verb, ports)
        references = list(ports.references)
        if verb == "Set":
            self._slave.set_real(references, ports.values.tolist())
        else:
            ports.values[:] = self._slave.get_real(references)
        return OK

    def text(self, reference: int) -> str:
        """The slave's message on its failure; the failure is repeated in Python."""
        told = self._struct.record
        if told.bad_value:
            self._slave.set_real([int(told.reference)], [float(told.value)])
        elif told.bad_step:
            self._slave.do_step(float(told.t), float(told.h))
        return str(self._slave.failure)

    def set_up(self, stop: float) -> None:
        self._slave.setup_experiment(0.0, stop)

    def enter(self, stop: float) -> None:
        self._slave.enter_initialization_mode()

    def leave(self) -> None:
        self._slave.exit_initialization_mode()
        self._started = True

    def terminate(self) -> None:
        pass

    def free(self) -> None:
        pass


@cache
def _functions() -> tuple[Any, ...]:
    """The library in the form of an FMU's, and its functions for a step and for states."""

    def named(name: str, kind: Any) -> Any:
        return kind((f"played_{name}", library()))

    library_of = SimpleNamespace(
        fmi2SetReal=named("set_real", VALUES), fmi2GetReal=named("get_real", VALUES)
    )
    states = (named(name, STATE) for name in ("get_state", "set_state", "free_state"))
    return library_of, named("do_step", STEP), *states

"""The master's compiled part: its records and its functions; ``c/`` says what each field is."""

from __future__ import annotations

import ctypes as ct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.core import SUFFIX, at
from .fmi_calls import CALLS, GROUP, MEMBER, CallFailed
from .structs import VECTOR, Struct

Vector = npt.NDArray[np.float64]

DIRECT, STEPPED, SAMPLED = range(3)
USES = 3  # uses of saved states
FARTHEST = 1e4  # times an output's nominal value: beyond it, a loop diverges
GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED = range(6)

OWN_STEP = ct.CFUNCTYPE(ct.c_int, ct.c_double)

CONTROLLER = np.dtype(
    [
        ("calls", CALLS),
        ("m", np.int64),
        ("n", np.int64),
        ("others", np.int64),
        ("group", np.int64),
        ("answer", np.int64),
        ("reports", np.int64),
        ("saves", np.int64),
        ("varies", np.int64),
        ("nominal", VECTOR),
        ("real", VECTOR),
        ("ahead", VECTOR),
        ("is_ahead", np.int64),
        ("moved", VECTOR),
        ("answered", VECTOR),
    ]
)
"""A controller as a function: commands for given signals."""

LOOP = np.dtype(
    [
        ("plant", CALLS),
        ("takes_law", np.int64),
        ("follows", np.int64),
        ("unsolved", np.int64),
        ("signals", VECTOR),
        ("controller", CONTROLLER),
        ("delayed", np.int64),
        ("tangent", np.int64),
        ("own", np.intp),
        ("corrected", np.int64),
        ("averaged", np.int64),
        ("outputs", VECTOR),
        ("late", VECTOR),
        ("following", VECTOR),
        ("has_following", np.int64),
        ("following_step", float),
        ("kept_outputs", VECTOR),
        ("kept_late", VECTOR),
        ("kept_following", VECTOR),
        ("kept_has_following", np.int64),
        ("residual", VECTOR),
        ("effect", VECTOR),
        ("contraction", float),
        ("start", VECTOR),
        ("end", VECTOR),
        ("mean", VECTOR),
        ("goal", VECTOR),
        ("law", VECTOR),
        ("applied", VECTOR),
        ("stepped", VECTOR),
        ("reached", VECTOR),
        ("command", VECTOR),
        ("first", VECTOR),
        ("ring", VECTOR),
        ("commands", VECTOR),
    ]
)
"""A plant and a controller that move together; made by `coupling.CoupledPair`."""


PAIR = np.dtype(
    [
        ("loop", LOOP),
        ("parts", np.int64),
        ("recorded", VECTOR),
        ("rows", np.int64),
        ("failed", float),
    ]
)
"""A loop and its record."""

COURSE = np.dtype(
    [
        ("times", VECTOR),
        ("references", VECTOR),
        ("commands", VECTOR),
        ("bounds", VECTOR),
        ("nominal", VECTOR),
        ("low", VECTOR),
        ("high", VECTOR),
        ("residual", VECTOR),
        ("effect_rate", VECTOR),
        ("accuracy", float),
        ("contraction", float),
        ("contraction_weight", float),
        ("apart", VECTOR),
        ("goal_times", VECTOR),
        ("goal_pieces", VECTOR),
        ("before", VECTOR),
        ("after", VECTOR),
    ]
)
"""The record of a run, the measurements during it, and its reference."""


CLOCK = np.dtype(
    [
        ("tick", float),
        ("stop", float),
        ("last", np.int64),
        ("longest", np.int64),
        ("adaptive", np.int64),
        ("count", np.int64),
        ("stride", np.int64),
        ("shortest_used", float),
        ("longest_used", float),
        ("close", float),
        ("breaks", VECTOR),
        ("passed", np.int64),
        ("broken", np.int64),
    ]
)
"""The time of a run."""


SIDE = np.dtype([("calls", CALLS), ("frames", CALLS), ("states", np.int64)])
"""An FMU with tangents, see ``c/joint_step.c``."""

ASKED_LAW = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p, ct.c_void_p)
ASKED_ADVANCE = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p)

JOINT = np.dtype(
    [
        ("plant", SIDE),
        ("controller", SIDE),
        ("law_asked", np.intp),
        ("advance_asked", np.intp),
        ("shown", CALLS),
        ("m", np.int64),
        ("n", np.int64),
        ("count", np.int64),
        *(
            (name, VECTOR)
            for name in (
                "reference start end middle law corrected ramped applied plain plain_logs frame "
                "logs"
            ).split()
        ),
    ]
)
"""A plant and a controller with their tangents."""

TRAIL = np.dtype(
    [
        ("times", VECTOR),
        ("outputs", VECTOR),
        ("growth", VECTOR),
        ("trace", VECTOR),
        ("rows", np.int64),
        ("bound", VECTOR),
        ("accuracy", float),
        ("relative", float),
        ("unmet", np.int64),
    ]
)
"""The record of the run, and the allowed errors of its steps."""

_At, _Number, _Whole = ct.c_void_p, ct.c_double, ct.c_int
_SIGNATURES: dict[str, tuple[Any, ...]] = {
    "clock_now": (_At,),
    "clock_step_to_come": (_At,),
    "master_march": (_At, _At, _At, _At, _At, ct.c_int64),
    "master_read_outputs": (_At, _At),
    "master_command": (_At, _Number, _Number, _At, _Whole, _At),
    "master_set_inputs": (_At, _At, _At),
    "master_read_commands": (_At, _At),
    "master_command_at": (_At, _At, _At, _At),
    "master_probe_gains": (_At, _Number, _Number, _At, _At, _At),
    "master_law_at": (_At, _Number, _Number, _At, _At, _Whole, _At),
    "master_advance": (_At, _Number, _Number, _At, _At),
    "master_sizes": (_At,),
    "joint_march": (_At, _At, _At, ct.c_int64),
    "played_set_real": (_At, _At, ct.c_size_t, _At),
    "played_get_real": (_At, _At, ct.c_size_t, _At),
}
_NUMBERS = ("clock_now", "clock_step_to_come")


@cache
def library() -> Any:
    """The compiled functions, loaded once; other threads can run during their calls."""
    loaded = ct.CDLL(str(Path(__file__).parent / "c" / f"libmaster{SUFFIX}"))
    for name, types in _SIGNATURES.items():
        function = getattr(loaded, name)
        function.argtypes = types
        function.restype = _Number if name in _NUMBERS else _Whole
    kinds = CALLS, MEMBER, GROUP, CONTROLLER, LOOP, PAIR, COURSE, CLOCK, SIDE, JOINT, TRAIL
    sizes = np.zeros(len(kinds), dtype=np.int64)
    loaded.master_sizes(sizes.ctypes.data)
    if sizes.tolist() != [kind.itemsize for kind in kinds]:
        raise ImportError("libmaster has other records than this version of ballscrew: build it")
    return loaded


def ask(function: str, whom: Struct, *arguments: Vector | float) -> None:
    """Call a compiled function on an FMU instance.

    Parameters
    ----------
    function : str
        Name without ``master_``.
    whom : Struct
    arguments : ndarray or float
        Arrays are read or written in place.

    Raises
    ------
    CallFailed
    """
    given = (at(a) if isinstance(a, np.ndarray) else a for a in arguments)
    if not getattr(library(), f"master_{function}")(whom.address, *given):
        raise CallFailed

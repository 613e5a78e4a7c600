"""The master's compiled part: its records and its functions, see ``c/``."""

from __future__ import annotations

import ctypes as ct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..solver.core import SUFFIX, at
from .fmi_calls import CALLS, CallFailed
from .structs import VECTOR, Struct

Vector = npt.NDArray[np.float64]

DIRECT, STEPPED, SAMPLED = range(3)
USES = 3  # what states are saved for
RAMP_SHARE = 2 / 3  # of a defect, that a ramp makes up for
FARTHEST = 1e4  # times an output's nominal value, beyond which a loop diverges
GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED = range(6)

OWN_STEP = ct.CFUNCTYPE(ct.c_int, ct.c_double)

CONTROLLER = np.dtype(
    [
        # inputs: n signals, references; outputs: m commands, then gains and rates if it reports,
        # and others that are only recorded
        ("calls", CALLS),
        ("m", np.int64),
        ("n", np.int64),
        ("others", np.int64),
        ("group", np.int64),  # whether it is asked for others with the signals of then
        ("answer", np.int64),
        ("reports", np.int64),
        ("saves", np.int64),
        ("varies", np.int64),  # whether its steps may be of any length
        ("nominal", VECTOR),  # of the signals
        ("real", VECTOR),  # of signals and references: whether they may be between whole numbers
        ("ahead", VECTOR),  # commands after a step that cannot be taken back,
        ("is_ahead", np.int64),  # if it has done one
        ("moved", VECTOR),  # room for n signals,
        ("answered", VECTOR),  # and for m commands
    ]
)
"""A controller as a function: commands for given signals."""

LOOP = np.dtype(
    [
        # inputs: m commands, then gains, references, rates if it takes a law; outputs: all
        ("plant", CALLS),
        ("takes_law", np.int64),
        ("follows", np.int64),  # whether outputs may follow inputs without a step
        ("unsolved", np.int64),  # communication points at which an algebraic loop had no solution
        ("signals", VECTOR),  # which outputs the controller measures
        ("controller", CONTROLLER),
        ("delayed", np.int64),
        ("tangent", np.int64),
        ("own", np.intp),  # address of an `OWN_STEP`; 0 if there is none
        ("corrected", np.int64),
        ("averaged", np.int64),
        # what goes from step to step: outputs, last commands, and the law at the end of the last
        # step, which is where the next begins
        ("outputs", VECTOR),
        ("late", VECTOR),
        ("following", VECTOR),
        ("has_following", np.int64),
        ("following_step", float),  # length of the step that it is of, where that matters [s]
        # the same, kept to come back to
        ("kept_outputs", VECTOR),
        ("kept_late", VECTOR),
        ("kept_following", VECTOR),
        ("kept_has_following", np.int64),
        # what the last step did: coupling residual as accepted; how far the correction moved each
        # output; share of the residual that was left, small if correcting converges fast, one
        # or more if the step is too long for it, NaN if nothing was corrected
        ("residual", VECTOR),
        ("effect", VECTOR),
        ("contraction", float),
        # room for one step
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
        ("ring", VECTOR),  # m (m + 2): for an algebraic loop
        ("commands", VECTOR),  # nominal values of the plant's commands
    ]
)
"""A plant and a controller that move together; made by `coupling.CoupledPair`."""


PAIR = np.dtype(
    [
        ("loop", LOOP),
        (
            "parts",
            np.int64,
        ),  # into how many a reference co-run divides each step; 0 if it is not there
        # outputs of the plant and others of the controller at the end of each step, row by row
        ("recorded", VECTOR),
        ("rows", np.int64),
        ("failed", float),  # time of the step in which a reference co-run failed [s], NaN before
    ]
)
"""A loop with what it records."""

COURSE = np.dtype(
    [
        ("times", VECTOR),
        ("references", VECTOR),
        ("commands", VECTOR),  # row by row
        ("bounds", VECTOR),  # of each output, beyond which the loop diverges
        ("nominal", VECTOR),  # of each output, and its range so far
        ("low", VECTOR),
        ("high", VECTOR),
        ("residual", VECTOR),  # largest of each command,
        ("effect_rate", VECTOR),  # and of its effect on each output, per second
        ("accuracy", float),  # share of an output's range that may be wrong in the end
        ("contraction", float),  # sums of contraction by weight and of weight
        ("contraction_weight", float),
        ("apart", VECTOR),  # run and reference co-run after the last step
        # the reference's points; polynomials in the time since each, and before them a constant:
        # what is recorded, then what each input takes; room for what the inputs take at two times
        ("goal_times", VECTOR),
        ("goal_pieces", VECTOR),
        ("before", VECTOR),
        ("after", VECTOR),
    ]
)
"""The run as it is recorded, what is measured along it, and what it is to follow."""


CLOCK = np.dtype(
    [
        ("tick", float),  # unit of time [s]
        ("stop", float),  # end [s]
        ("last", np.int64),  # ticks of the run
        ("longest", np.int64),  # ticks of the longest step
        ("adaptive", np.int64),
        ("count", np.int64),  # ticks gone
        ("stride", np.int64),  # ticks of the step to come
        ("shortest_used", float),  # [s]
        ("longest_used", float),  # [s]
        ("close", float),  # times that are closer to each other are one [s]
        ("breaks", VECTOR),  # rising times at which a step has to end, too [s]
        ("passed", np.int64),  # how many of them are gone,
        ("broken", np.int64),  # and whether time stands at the last one
    ]
)
"""Where a run stands."""


SIDE = np.dtype([("calls", CALLS), ("frames", CALLS), ("states", np.int64)])
"""An FMU with tangents, see ``c/joint_step.c``."""

ASKED_LAW = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p, ct.c_void_p)
ASKED_ADVANCE = ct.CFUNCTYPE(ct.c_int, ct.c_double, ct.c_double, ct.c_void_p)

JOINT = np.dtype(
    [
        ("plant", SIDE),
        ("controller", SIDE),
        # addresses of functions that answer for a controller without tangents
        ("law_asked", np.intp),
        ("advance_asked", np.intp),
        ("shown", CALLS),  # outputs: those of the plant that are recorded
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
        # row by row; row 0 is what was before
        ("times", VECTOR),
        ("outputs", VECTOR),
        ("growth", VECTOR),
        ("trace", VECTOR),
        ("rows", np.int64),
        ("bound", VECTOR),  # outputs beyond which the loop diverges
        ("accuracy", float),  # nats, and share of the growth, that correcting may change in all
        ("relative", float),
        ("unmet", np.int64),  # steps that were as short as they get, and changed more
    ]
)
"""The run as it is recorded, and how wrong its steps may be."""

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
    "joint_march": (_At, _At, _At, ct.c_int64),
    "played_set_real": (_At, _At, ct.c_size_t, _At),
    "played_get_real": (_At, _At, ct.c_size_t, _At),
}
_NUMBERS = ("clock_now", "clock_step_to_come")


@cache
def library() -> Any:
    """The compiled functions, loaded once; other threads run while they do."""
    loaded = ct.CDLL(str(Path(__file__).parent / "c" / f"libmaster{SUFFIX}"))
    for name, types in _SIGNATURES.items():
        function = getattr(loaded, name)
        function.argtypes = types
        function.restype = _Number if name in _NUMBERS else _Whole
    return loaded


def ask(function: str, whom: Struct, *arguments: Vector | float) -> None:
    """Call one of the functions that ask a FMU instance something.

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

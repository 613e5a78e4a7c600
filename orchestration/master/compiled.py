"""The master's compiled part: its records and its functions, see ``c/``."""

from __future__ import annotations

import ctypes as ct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...solver.core import SUFFIX, at
from .fmi_calls import CALLS, CallFailed
from .structs import VECTOR, Struct

Vector = npt.NDArray[np.float64]

DIRECT, STEPPED, SAMPLED = range(3)
USES = 3  # uses of saved states
RAMP_SHARE = 2 / 3  # of the residual, which a ramp corrects
FARTHEST = 1e4  # times an output's nominal value: beyond it, a loop diverges
GOES_ON, STEP_FAILED, COMMAND_FAILED, NOT_FINITE, DIVERGES, CALL_FAILED = range(6)

OWN_STEP = ct.CFUNCTYPE(ct.c_int, ct.c_double)

CONTROLLER = np.dtype(
    [
        # inputs: n signals, references; outputs: m commands, then gains and rates if it reports a
        # law, and others that are only recorded
        ("calls", CALLS),
        ("m", np.int64),
        ("n", np.int64),
        ("others", np.int64),
        ("group", np.int64),  # whether it gets the present signals before others are read
        ("answer", np.int64),
        ("reports", np.int64),
        ("saves", np.int64),
        ("varies", np.int64),  # whether its steps may be of any length
        ("nominal", VECTOR),  # of the signals
        ("real", VECTOR),  # whether each signal and reference is Real
        ("ahead", VECTOR),  # commands after a step that cannot be taken back
        ("is_ahead", np.int64),  # whether it has done such a step
        ("moved", VECTOR),  # room for n signals
        ("answered", VECTOR),  # room for m commands
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
        # passed from step to step: outputs, last commands, and the law at the end of the last
        # step, with which the next step begins
        ("outputs", VECTOR),
        ("late", VECTOR),
        ("following", VECTOR),
        ("has_following", np.int64),
        ("following_step", float),  # step that the law was found with, if it matters [s]
        # the same, saved to return to
        ("kept_outputs", VECTOR),
        ("kept_late", VECTOR),
        ("kept_following", VECTOR),
        ("kept_has_following", np.int64),
        # results of the last step: final coupling residual; change of each output by the
        # correction; contraction: small if correcting converges fast, 1 or more if the step is too
        # long for it, NaN if nothing was corrected
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
        ),  # of each step of a reference co-run; 0 if there is no co-run
        # outputs of the plant and others of the controller at the end of each step, row by row
        ("recorded", VECTOR),
        ("rows", np.int64),
        ("failed", float),  # time of the step in which a reference co-run failed [s], else NaN
    ]
)
"""A loop and its record."""

COURSE = np.dtype(
    [
        ("times", VECTOR),
        ("references", VECTOR),
        ("commands", VECTOR),  # row by row
        ("bounds", VECTOR),  # of each output, beyond which the loop diverges
        ("nominal", VECTOR),  # of each output, and its range so far
        ("low", VECTOR),
        ("high", VECTOR),
        ("residual", VECTOR),  # largest of each command
        ("effect_rate", VECTOR),  # its largest effect on each output, per second
        ("accuracy", float),  # allowed error at the end, as a share of an output's range
        ("contraction", float),  # sums of contraction by weight and of weight
        ("contraction_weight", float),
        ("apart", VECTOR),  # difference of run and reference co-run after the last step
        # the reference's points; a constant before them and polynomials in the time since each of
        # them: for the recorded set-point, then for each input; room for the inputs' set-points at
        # two times
        ("goal_times", VECTOR),
        ("goal_pieces", VECTOR),
        ("before", VECTOR),
        ("after", VECTOR),
    ]
)
"""The record of a run, the measurements during it, and its reference."""


CLOCK = np.dtype(
    [
        ("tick", float),  # unit of time [s]
        ("stop", float),  # end [s]
        ("last", np.int64),  # ticks of the run
        ("longest", np.int64),  # ticks of the longest step
        ("adaptive", np.int64),
        ("count", np.int64),  # elapsed ticks
        ("stride", np.int64),  # ticks of the next step
        ("shortest_used", float),  # [s]
        ("longest_used", float),  # [s]
        ("close", float),  # times that are closer to each other count as equal [s]
        ("breaks", VECTOR),  # further times at which a step has to end, rising [s]
        ("passed", np.int64),  # number of breaks that are passed
        ("broken", np.int64),  # whether the present time is the last of them
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
        # addresses of callbacks for a controller without tangents
        ("law_asked", np.intp),
        ("advance_asked", np.intp),
        ("shown", CALLS),  # outputs: the recorded outputs of the plant
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
        # row by row; row 0 is the last one before
        ("times", VECTOR),
        ("outputs", VECTOR),
        ("growth", VECTOR),
        ("trace", VECTOR),
        ("rows", np.int64),
        ("bound", VECTOR),  # outputs beyond which the loop diverges
        ("accuracy", float),  # largest change by all corrections: nats, and share of the growth
        ("relative", float),
        ("unmet", np.int64),  # number of shortest steps with a larger change
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

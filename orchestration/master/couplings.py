"""The couplings of a plant and a controller; a new one is a line here, and a separate file.

Every step begins with the controller's output at the last communication point: its commands
and, if a coupling needs the `law`, their derivatives by the signals and their own rates. The
plant applies them over the step; `late` commands arrive one step later. A coupling may have its
`own` function for this, as ``module:function``: it gets the law, a `coupling.FeedbackLaw`, and the
step [s], and changes the law's arrays to those that the plant applies. It must keep no state,
because steps are repeated.
"""

from __future__ import annotations

from enum import Enum

from ...solver.errors import CouplingError


class Coupling(Enum):
    """A coupling by its name."""

    JACOBI = "jacobi", True
    GAUSS_SEIDEL = "gauss-seidel"
    INTERFACE_JACOBIAN = "interface-jacobian", False, True

    late: bool  # whether the commands of steps that are not corrected arrive one step late
    law: bool  # whether the plant applies the feedback law inside its own solver
    own: str  # empty if there is none

    def __new__(cls, name: str, late: bool = False, law: bool = False, own: str = "") -> Coupling:
        member = object.__new__(cls)
        member._value_ = name
        member.late, member.law, member.own = late, law, own
        return member

    @classmethod
    def _missing_(cls, value: object) -> Coupling:
        """Raise `CouplingError`."""
        names = ", ".join(coupling.value for coupling in cls)
        raise CouplingError(
            f"coupling is {value!r}, expected one of {names}; without FMUs, as one system of "
            f"equations: fmus=False in Python, --coupling {WITHOUT_FMUS} in a command"
        )


WITHOUT_FMUS = "monolithic"  # what results and commands call a loop as one system of equations

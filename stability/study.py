"""What a map is about: two axes of parameters, and the loop that they belong to."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..fmus.catalogue import component, kept_as
from ..instruments import bare
from ..orchestration.memory import check_memory
from ..orchestration.parts import label_of, part_of
from ..orchestration.whole_loop import held_loop_kernel
from ..solver.component_file import names_file, remember_component
from ..solver.kernel import PLANT, Kernel, ParameterInfo
from .fmu_parts import OverFmus

Vector = npt.NDArray[np.float64]
TOLERANCE = 1e-8
TIGHTER = 0.1
SHORTER = 0.5  # a coupling of second order is four times as good
PER_CELL = 1000  # bytes of a cell while the map is merged and drawn, measured
MOST_BYTES = 10**30  # counts on the command line have any number of digits
SETPOINT, DESIGN = "setpoint", "design"
_FROM_FILES = "components from files"


class BadMap(ValueError):
    """A map that makes no sense; the message says what was got and what was expected."""


@lru_cache(maxsize=8)
def _linear(low: float, high: float, count: int) -> Vector:
    """One array for all cells of a map."""
    return np.linspace(low, high, count)


@dataclass(frozen=True)
class Axis:
    """One side of a map.

    Parameters
    ----------
    name : str
        As the user gave it; the name of the column.
    side : {"plant", "controller", "setpoint", "design"}
        Whose parameter it is. ``design``: of the plant on which the NCTF controller is designed.
    parameter : str
    low, high : float
    count : int
        Points, both ends included.
    """

    name: str
    side: str
    parameter: str
    low: float
    high: float
    count: int

    def values(self) -> Vector:
        return _linear(self.low, self.high, self.count)

    def value(self, number: int) -> float:
        return float(self.values()[number])


@dataclass(frozen=True)
class MapStudy:
    """Everything that decides a map.

    Attributes
    ----------
    plant_values, controller_values : dict of str to float
        Parameters and initial states that are not nominal, the same in all cells.
    stop : float
        Length of each run [s].
    exponents : bool
        Whether to compute the largest exponent of each cell.
    tolerance : float
        Of the solver of the equations.
    fmus : OverFmus, optional
        Of a map over FMUs; then controller and plant may be paths of FMUs.
    """

    controller: str
    x: Axis
    y: Axis
    plant: str = "plant"
    plant_values: Mapping[str, float] = field(default_factory=dict)
    controller_values: Mapping[str, float] = field(default_factory=dict)
    setpoint: float = 0.08
    stop: float = 20.0
    exponents: bool = False
    tolerance: float = TOLERANCE
    seed: int = 0
    fmus: OverFmus | None = None

    @property
    def finer(self) -> float:
        """Share of the tolerance, or of the step over FMUs, at which cells are looked at again."""
        return TIGHTER if self.fmus is None else SHORTER

    @property
    def cells(self) -> int:
        return self.x.count * self.y.count

    def check(self) -> None:
        """Make sure that the two sides differ, values are in range, and FMUs can be coupled.

        Raises
        ------
        BadMap
        NotEnoughMemory
            If the tables and pictures of so many cells do not fit.
        """
        check_memory(
            float(min(PER_CELL * self.cells, MOST_BYTES)),
            f"{self.x.count} x {self.y.count} cells need",
            "map fewer points, or one part after another",
        )
        if self.fmus is None and self.exponents and kernel_of(self).quantized:
            raise BadMap(
                f"{label_of(self.controller)} or {label_of(self.plant)} quantizes a signal, and a "
                "staircase has no tangents; map it without --exponents, and see lyapunov for "
                "single loops"
            )
        if (self.x.side, self.x.parameter) == (self.y.side, self.y.parameter):
            raise BadMap(f"--x and --y are both {self.x.parameter}; expected two parameters")
        if self.fmus is None and PLANT + "x" not in [s.name for s in kernel_of(self).states]:
            raise BadMap(f"{label_of(self.plant)} has no state x, whose motion a map judges")
        given = {"plant": self.plant_values, "controller": self.controller_values}
        for axis in (self.x, self.y):
            if axis.parameter in given.get(axis.side, {}):
                raise BadMap(f"{axis.name} is given a value and is an axis; expected one of them")
            about = _about(axis, self.plant, self.controller)
            low, high = (about.minimum, about.maximum) if about else (-math.inf, math.inf)
            if axis.low < low or axis.high > high:
                raise BadMap(
                    f"{axis.name} runs from {axis.low:g} to {axis.high:g}, expected values within "
                    f"[{low:g}, {high:g}]"
                )
        if self.fmus is not None:
            from .fmu_cell import check_parts

            check_parts(self, self.fmus)

    def __getstate__(self) -> dict[str, Any]:
        """What goes to workers: they may lack the files of parts, or find them edited."""
        bases = (bare(p) for p in (self.plant, self.controller))
        parts = {p: component(p) for p in bases if names_file(p)}
        return vars(self) | {_FROM_FILES: parts}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for part, made in state.pop(_FROM_FILES).items():
            remember_component(part, made)
        vars(self).update(state)

    def fingerprint(self) -> str:
        """Hash of the study and of the equations, or the FMUs, that it is about."""
        text = json.dumps(asdict(self), sort_keys=True)
        if self.fmus is None:
            text += kernel_of(self).module
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def point(self, cell: int) -> tuple[float, float]:
        """Values of x and y in a cell; x runs fastest."""
        row, column = divmod(cell, self.x.count)
        return self.x.value(column), self.y.value(row)

    def values_at(self, x: float, y: float) -> tuple[dict[str, float], dict[str, float], float]:
        """Values of the plant, values of the controller, and set-point [m] at a point.

        Raises
        ------
        ValueError
            If no controller can be designed on this plant.
        """
        plant, controller = dict(self.plant_values), dict(self.controller_values)
        setpoint = self.setpoint
        designed: dict[str, float] = {}
        for axis, value in ((self.x, x), (self.y, y)):
            if axis.side == SETPOINT:
                setpoint = value
            elif axis.side == DESIGN:
                designed[axis.parameter] = value
            else:
                (plant if axis.side == "plant" else controller)[axis.parameter] = value
        if designed:
            from ..controllers.nctf import design

            controller = design({**self.plant_values, **designed}).parameters() | controller
        return plant, controller, setpoint


def read_axis(text: str, plant: str, controller: str) -> Axis:
    """An axis from ``NAME=LOW:HIGH:COUNT``.

    NAME is a parameter or initial state (``x_start``) of the controller or the plant, with
    ``controller.`` or ``plant.`` before it where both have it, ``setpoint``, or ``design.NAME``.

    Raises
    ------
    BadMap
    """
    name, equals, numbers = text.partition("=")
    parts = numbers.split(":")
    if not equals or not name or len(parts) != 3:
        raise BadMap(f"{text!r} is not of the form NAME=LOW:HIGH:COUNT")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise BadMap(f"{text!r}: expected two numbers and a whole number after the =") from None
    if not (math.isfinite(low) and math.isfinite(high)):
        raise BadMap(f"{text!r}: the bounds must be finite")
    if not low < high:
        raise BadMap(f"{text!r}: the bounds are {low:g} and {high:g}, expected the lower one first")
    if count < 2:
        raise BadMap(f"{text!r}: {count} points, expected 2 or more")
    side, parameter = _owner(name, plant, controller)
    return Axis(name, side, parameter, low, high, count)


def _owner(name: str, plant: str, controller: str) -> tuple[str, str]:
    import difflib

    if name == SETPOINT:
        return SETPOINT, SETPOINT
    ours, theirs = ([*part_of(part).parameters] for part in (plant, controller))
    ours_is, theirs_is = label_of(plant), label_of(controller)
    side, dot, own = name.partition(".")
    if dot and side == DESIGN:
        if controller != "nctf":
            raise BadMap(f"{name!r}: only nctf is designed on a plant, and this is {theirs_is}")
        if own in ours:
            return DESIGN, own
    elif dot and side in ("plant", "controller"):
        if own in (ours if side == "plant" else theirs):
            return side, own
    elif name in theirs and name in ours:
        raise BadMap(f"both sides have {name!r}: say controller.{name} or plant.{name}")
    elif name in theirs:
        return "controller", name
    elif name in ours:
        return "plant", name
    near = difflib.get_close_matches(own if dot else name, [*theirs, *ours], n=3, cutoff=0.5)
    hint = f"; nearest: {', '.join(near)}" if near else ""
    raise BadMap(
        f"neither {theirs_is} nor {ours_is} has {name!r}{hint}; {theirs_is} has "
        f"{', '.join(theirs) or 'none'}; {ours_is} has {', '.join(ours)}"
    )


@lru_cache(maxsize=8)
def _loop(plant: str, controller: str, *_kept_as: object) -> Kernel:
    return held_loop_kernel(plant, controller)


def kernel_of(study: MapStudy) -> Kernel:
    """The loop of a study; of parts from files, the one of the equations that they have now."""
    return _loop(study.plant, study.controller, kept_as(study.plant), kept_as(study.controller))


def axis_unit(study: MapStudy, name: str) -> str:
    """The unit of an axis, for its label."""
    axis = study.x if name == study.x.name else study.y
    about = _about(axis, study.plant, study.controller)
    return about.unit if about else "m"


def position_unit(study: MapStudy) -> str:
    """The unit of the position x, whose motion a map judges; metres of an FMU."""
    if study.fmus is not None:
        return "m"
    return next(s.unit for s in kernel_of(study).states if s.name == PLANT + "x")


def _about(axis: Axis, plant: str, controller: str) -> ParameterInfo | None:
    """What is known of an axis' parameter; None of set-points."""
    if axis.side == SETPOINT:
        return None
    return part_of(controller if axis.side == "controller" else plant).parameters[axis.parameter]

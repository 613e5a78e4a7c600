"""Identification of a friction law: our estimator, and the thesis' formulas beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from ..orchestration.parameter_file import DRIVE, ParameterFile, Value
from ..plant.law import law as friction_law
from ..records.force_record import Record
from ..records.table import near
from ..records.velocity import INTEGRATED
from ..solver.component import ForceTerm, symbol
from ..solver.files import write_json
from .bliman_sorine_map import NoSolution, map_points, read_points
from .dahl_fit import fit_dahl
from .fit import fit_along
from .fit_result import Fit
from .fitted_law import LAWS, OFFSET
from .friction_estimation import FrictionEstimate, estimate_friction
from .identifiability import BACKWARDS, FORWARDS, ways, which_would_do, why_not
from .intervals import Interval, averaged, spread
from .layout import Course, lay_out
from .lugre_dynamics import assumed_damping, held_stiffness, secant_bias
from .stribeck_fit import STUCK, StribeckPoints, fit_stribeck, stribeck_points

Vector = npt.NDArray[np.float64]

MISFIT = 2.0  # what the law leaves, in noise of the force, beyond which it is not believed
_LEAST_DIFFERENCE = 1e-3  # probability of such different directions if they were the same
_SIDES = {FORWARDS: "_pos", BACKWARDS: "_neg"}
_TOGETHER = {  # parameters that are not fitted in coordinates of their own
    "bliman_sorine": ("f1", "f2", "eta"),
    "maxwell_slip": tuple(n for n in LAWS["maxwell_slip"].parameters if n.startswith("alpha")),
}


class UnknownLaw(ValueError):
    """There is no law of this name to identify."""


class CannotHold(ValueError):
    """A parameter cannot be held at a value; the message says why and what can."""


@dataclass(frozen=True)
class Identification:
    """What records tell of a law.

    Attributes
    ----------
    parameters : dict of str to Interval
        Of the law as it stands, and of the offset if it was asked for: our estimator on all
        records.
    per_direction : dict of str to dict of str to Interval
        ``forwards``, ``backwards`` and ``averaged``, fitted apart with the offset of
        `parameters`; empty for one direction only.
    thesis : dict
        The thesis' formulas on the same records.
    fit : Fit
    course : Course
    estimates : list of FrictionEstimate
    points : StribeckPoints
    unexplained : float
        Root mean square of what the law leaves of the force beyond the load cell's noise [N].
    doubts : tuple of str
        Why the result is not to be believed; empty if it is.
    notes : tuple of str
    told : ParameterFile or None
        What was known of the drive before; goes into the result's parameter file.
    fixed : mapping of str to float
        What was held.
    """

    law: str
    records: tuple[Record, ...]
    parameters: dict[str, Interval]
    per_direction: dict[str, dict[str, Interval]]
    thesis: dict[str, Any]
    fit: Fit
    course: Course
    estimates: tuple[FrictionEstimate, ...]
    points: StribeckPoints
    unexplained: float
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    told: ParameterFile | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def believed(self) -> bool:
        return not self.doubts

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            "law": self.law,
            "records": [r.name for r in self.records],
            "parameters": {n: asdict(i) for n, i in self.parameters.items()},
            "per_direction": {
                side: {n: asdict(i) for n, i in table.items()}
                for side, table in self.per_direction.items()
            },
            "thesis": self.thesis,
            "delay_of_force_s": [float(d) for d in self.fit.delays],
            "load_cell_noise_N": self.fit.noise,
            "unexplained_force_N": self.unexplained,
            "friction_estimation": {
                r.name: [*e.said, *r.notes]
                for r, e in zip(self.records, self.estimates, strict=True)
            },
            "believed": self.believed,
            "doubts": list(self.doubts),
            "notes": list(self.notes),
        }

    def parameter_file(self) -> ParameterFile:
        """The law's values with their intervals; of `told`, what these records do not tell.

        What is not identified has no value, unless `told` has one, and stands in a table with
        the reason.
        """
        given = self.told or ParameterFile()
        names = ", ".join(r.name for r in self.records)
        another = given.law not in ("", self.law)
        replaced = {p.name for p in _law_of(given.law).parameters} if another else set()
        values = {n: v for n, v in given.plant.items() if n not in replaced}
        for name, i in self.parameters.items():
            if i.identified and (name != OFFSET or given.kind == DRIVE):
                held = name in self.fixed
                source = "given, held" if held else f"identified from {names}"
                if not (held and name in values and values[name].value == i.value):
                    values[name] = Value(i.value, i.unit, None if held else _bounds(i), source)
        reasons = {n: i.because for n, i in self.parameters.items() if not i.identified}
        return replace(
            given,
            path=None,
            law=self.law,
            plant=values,
            found={},
            not_identified=reasons,
            diagnosis=None,
        )

    def save(self, folder: Path | str) -> None:
        """Write ``identified.json``, ``parameters.toml`` and the pictures into `folder`.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        from .identification_pictures import save_pictures

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "identified.json", self.to_dict())
        self.parameter_file().save(folder)
        save_pictures(self, folder)


def _bounds(i: Interval) -> tuple[float, float]:
    """The interval's ends; one that is not known is infinite."""
    low = -math.inf if i.low is None else i.low
    high = math.inf if i.high is None else i.high
    return min(low, i.value), max(high, i.value)


def _law_of(name: str) -> ForceTerm:
    return friction_law(name)(symbol("v"))


def check_held(law: str, fixed: Mapping[str, float], offset: bool = False) -> None:
    """Refuse what cannot be held at a value, and an offset that cannot be told.

    Parameters
    ----------
    law : str
        One of `LAWS`.
    fixed : mapping of str to float
        Values by the law's names, or `OFFSET` [N].
    offset : bool, optional
        Whether a constant force is to be fitted.

    Raises
    ------
    CannotHold
    """
    described = LAWS[law]
    names = list(described.parameters)
    if described.directional:
        names = [n + end for end in _SIDES.values() for n in names]
    together = _TOGETHER.get(law, ())
    for name, value in fixed.items():
        if name in together:
            others = ", ".join(n for n in together if n != name)
            raise CannotHold(
                f"{name} of {law} is fitted together with {others} and cannot be held alone"
            )
        if name != OFFSET and name not in names:
            raise CannotHold(
                f"{law} has no parameter {name!r}{near(name, [*names, OFFSET])}; it has "
                f"{', '.join(names)}, and there is {OFFSET}"
            )
        if not math.isfinite(value) or (name != OFFSET and value <= 0):
            raise CannotHold(
                f"{name} is {value:g}, expected a {'finite number' if name == OFFSET else 'number'}"
                + ("" if name == OFFSET else " above 0; a small one leaves its effect out")
            )
    if offset and OFFSET in fixed:
        raise CannotHold(
            f"{OFFSET} is held at {fixed[OFFSET]:g} N and fitted; expected one of them"
        )
    if offset and described.directional:
        raise CannotHold(
            f"{law} has a friction of its own for each direction, from which a constant force is "
            f"not told; hold {OFFSET} at a value"
        )


def identify(
    records: Sequence[Record],
    law: str,
    told: ParameterFile | None = None,
    fixed: Mapping[str, float] | None = None,
    offset: bool = False,
) -> Identification:
    """Identify a law's parameters from records.

    Parameters
    ----------
    records : sequence of Record
    law : str
        One of `LAWS`.
    told : ParameterFile, optional
        What is known of the drive beside; the result's parameter file keeps it.
    fixed : mapping of str to float, optional
        Parameters that are held at a value, SI; `OFFSET` may be one.
    offset : bool, optional
        Whether a constant force is fitted beside the law, as a load or a load cell's zero makes it.

    Raises
    ------
    UnknownLaw
        If there is no such law here.
    CannotHold
    ValueError
        If there are no records.
    """
    if law not in LAWS:
        raise UnknownLaw(f"no law {law!r} to identify; there are {', '.join(LAWS)}")
    if not records:
        raise ValueError("no records to identify from")
    estimates = [estimate_friction(r) for r in records]
    course = lay_out(records, estimates)
    fixed = dict(fixed or {})
    check_held(law, fixed, offset)
    fit = fit_along(records, law, course, fixed=fixed, offset=offset)
    judged = {n: _judged(fit, n, course) for n in fit.names}
    per_direction: dict[str, dict[str, Interval]] = {}
    notes = []
    moved = ways(course)
    if fit.tied and len(moved) == 2:
        guess = {n: i.value for n, i in judged.items()}
        held = fixed | ({OFFSET: guess[OFFSET]} if offset else {})
        apart = fit_along(records, law, course, tied=False, guess=guess, follow=False, fixed=held)
        split = {n: _judged(apart, n, course) for n in apart.names}
        per_direction = _by_direction(split, fit.law.parameters)
        notes += _difference(apart, split, fixed)
    elif not fit.tied:
        per_direction = _by_direction(judged, fit.law.parameters)
    else:
        notes.append(f"motion {moved[0]} only: nothing is known of the other direction")
    points = stribeck_points(list(records), estimates)
    residual = (course.force - fit.predicted)[fit.spoken]
    noise = float(np.median([e.force_noise for e in estimates]))
    square = float(np.mean(residual**2)) if len(residual) else 0.0
    unexplained = math.sqrt(max(square - noise**2, 0.0))
    doubts = [f"{n}: {i.because}" for n, i in judged.items() if not i.identified]
    if unexplained > MISFIT * noise:
        doubts.append(
            f"the law leaves {unexplained:.3g} N of the force unexplained, "
            f"{unexplained / noise:.3g} times its noise of {noise:.3g} N: this is not the friction "
            "of these records"
        )
    strangers = [r for r in records if not r.about]
    if strangers:
        way = max(float(np.ptp(r.position)) for r in strangers)
        pull = max(float(np.abs(r.force).max()) for r in strangers)
        notes.append(
            f"without trial.json, by name and --unit, positions cover up to {way:.3g} m, forces "
            f"reach {pull:.3g} N, samples come every {strangers[0].step:.3g} s: if that is not so, "
            "say the units"
        )
    if offset:
        notes.append(
            "a constant force and a Coulomb friction that differs by direction look alike while "
            "sliding: the offset is that of a friction that is the same both ways"
        )
    if OFFSET in judged and (told is None or told.kind != DRIVE):
        notes.append(
            'the offset is not in parameters.toml: only kind = "drive" has such a parameter'
        )
    if any(r.velocity_alone for r in records):
        notes.append(INTEGRATED)
    if law == "classical":
        notes.append(
            f"presliding stiffness: the law has none; {np.mean(~fit.spoken):.0%} of the samples, "
            "where the block may stick, say nothing but how much force it stood"
        )
    if law in ("modified_lugre", "directional_lugre"):
        notes.append("Kv is held at 1e8 s/m: no record here resolves |v| of 1e-8 m/s")
    if len({round(math.log(r.step), 2) for r in records}) > 1:
        rates = ", ".join(f"{1 / s:.4g} Hz" for s in sorted({r.step for r in records}))
        notes.append(f"records of different rates ({rates}), each used at its own")
    return Identification(
        law=law,
        records=tuple(records),
        parameters=judged,
        per_direction=per_direction,
        thesis=thesis_estimates(records, estimates, points, law),
        fit=fit,
        course=course,
        estimates=tuple(estimates),
        points=points,
        unexplained=unexplained,
        doubts=tuple(doubts),
        notes=tuple(notes),
        told=told,
        fixed=fixed,
    )


def _judged(fit: Fit, name: str, course: Course) -> Interval:
    interval = fit.intervals[name]
    if interval.identified:
        return interval
    return replace(
        interval,
        because=why_not(fit, name, course),
        would_do=which_would_do(fit, name, course.count),
    )


def _by_direction(
    split: Mapping[str, Interval], names: Sequence[str]
) -> dict[str, dict[str, Interval]]:
    table = {side: {n: split[n + end] for n in names} for side, end in _SIDES.items()}
    table["averaged"] = {n: averaged(table["forwards"][n], table["backwards"][n]) for n in names}
    return table


def _difference(apart: Fit, split: Mapping[str, Interval], fixed: Mapping[str, float]) -> list[str]:
    """Whether the two directions differ by more than chance."""
    half = len(apart.law.parameters)
    seen = [
        j
        for j, n in enumerate(apart.law.parameters)
        if n not in fixed and all(split[n + end].identified for end in _SIDES.values())
    ]
    if not seen:
        return []
    turn = np.zeros((len(seen), len(apart.coordinates)))
    for row, j in enumerate(seen):
        turn[row, j], turn[row, j + half] = 1.0, -1.0
    gap = turn @ apart.coordinates
    distance = float(gap @ np.linalg.solve(turn @ apart.covariance @ turn.T, gap))
    if chi2.sf(distance, len(seen)) > _LEAST_DIFFERENCE:
        return []
    worst = max(seen, key=lambda j: abs(apart.coordinates[j] - apart.coordinates[j + half]))
    name = apart.law.parameters[worst]
    one, other = split[name + "_pos"], split[name + "_neg"]
    return [
        f"the two directions differ by more than chance (most in {name}: "
        f"{one.value:.4g} and {other.value:.4g} {one.unit}); "
        "one set of parameters for both is a compromise, and its intervals are too narrow"
    ]


def thesis_estimates(
    records: Sequence[Record],
    estimates: Sequence[FrictionEstimate],
    points: StribeckPoints,
    law: str,
) -> dict[str, Any]:
    """What the thesis' own formulas give on the records, and what is known to be wrong with it."""
    if law == "dahl":
        return _thesis_dahl(records, estimates)
    if law == "bliman_sorine":
        return _thesis_bliman_sorine(records, estimates)
    found = _thesis_lugre(records, estimates, points)
    if law in ("classical", "maxwell_slip"):  # of these laws the thesis has the static curve only
        return {"stribeck_eq_1_8": found["stribeck_eq_1_8"]}
    return found


def _thesis_lugre(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate], points: StribeckPoints
) -> dict[str, Any]:
    result: dict[str, Any] = {"stribeck_eq_1_8": {}}
    sides: dict[str, dict[str, Interval]] = {}
    for side, sign in (("forwards", 1), ("backwards", -1)):
        try:
            sides[side] = fit_stribeck(points, sign)
            result["stribeck_eq_1_8"][side] = {n: asdict(i) for n, i in sides[side].items()}
        except ValueError as error:
            result["stribeck_eq_1_8"][side] = f"no fit: {error}"
    static = sides.get("forwards") or sides.get("backwards")
    if len(sides) == 2:
        static = {
            n: averaged(sides["forwards"][n], sides["backwards"][n])
            for n in ("Fc", "Fs", "Vs", "sigma2")
        }
        result["stribeck_eq_1_8"]["averaged"] = {n: asdict(i) for n, i in static.items()}
    trials = []
    fine = any(r.position_name == "x_fine" for r in records)
    for record, estimate in zip(records, estimates, strict=True):
        if fine and record.position_name != "x_fine":
            continue
        found = held_stiffness(record, estimate)
        if found is None:
            continue
        row: dict[str, Any] = {"record": record.name, "sigma0": found[0], "force": found[1]}
        if static and abs(found[1]) < static["Fs"].value:
            row["true_sigma0_share"] = secant_bias(abs(found[1]), static["Fs"].value)
        trials.append(row)
    if trials:
        values = [row["sigma0"] for row in trials]
        eq: dict[str, Any] = {"trials": trials, "mean": float(np.mean(values))}
        if len(values) > 1:
            eq["spread"] = asdict(spread(values))
        eq["bias"] = (
            "Eq. 2.14 takes presliding for a spring; on a true LuGre surface it gives "
            "`true_sigma0_share` of sigma0, less the nearer the force is to Fs"
        )
        result["sigma0_eq_2_14"] = eq
        if static:
            result["sigma1_eq_2_17"] = {
                "value": assumed_damping(
                    max(eq["mean"], 0.0), static["sigma2"].value, records[0].mass
                ),
                "note": "critical damping is assumed, not identified",
            }
    return result


def _thesis_dahl(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate]
) -> dict[str, Any]:
    trials: list[dict[str, Any]] = []
    for record, estimate in zip(records, estimates, strict=True):
        x = estimate.motion.x - estimate.motion.x[0]
        end = int(np.argmax(np.abs(x))) + 1  # up to the first reversal
        if abs(x[end - 1]) < STUCK:
            continue
        try:
            found = fit_dahl(x[:end], estimate.friction[:end])
        except (ValueError, RuntimeError) as error:
            trials.append({"record": record.name, "no_fit": str(error)})
            continue
        trials.append(
            {
                "record": record.name,
                "direction": int(np.sign(x[end - 1])),
                **{n: asdict(i) for n, i in found.items()},
            }
        )
    result: dict[str, Any] = {"eqs_2_5_to_2_7": trials}
    for name in ("sigma", "Fc"):
        values = [t[name]["value"] for t in trials if name in t]
        table: dict[str, Any] = {}
        for side, sign in (("forwards", 1), ("backwards", -1)):
            own = [t[name]["value"] for t in trials if name in t and t["direction"] == sign]
            if own:
                table[side] = float(np.mean(own))
        if len(values) > 1:
            table["averaged"] = asdict(spread(values))
        result[name] = table
    return result


def _thesis_bliman_sorine(
    records: Sequence[Record], estimates: Sequence[FrictionEstimate]
) -> dict[str, Any]:
    trials = []
    for record, estimate in zip(records, estimates, strict=True):
        row: dict[str, Any] = {"record": record.name}
        branch = last_branch(estimate.motion.x)
        if branch is None:
            row["no_solution"] = "the motion has no whole branch of a second cycle"
        else:
            way = estimate.motion.x[branch] - estimate.motion.x[branch.start]
            sign = float(np.sign(way[-1]))
            try:
                row.update(
                    asdict(map_points(read_points(sign * way, sign * estimate.friction[branch])))
                )
            except NoSolution as error:
                row["no_solution"] = str(error)
        trials.append(row)
    return {"eqs_2_8_to_2_11": trials}


def last_branch(x: Vector) -> slice | None:
    """The last whole way from one reversal to the next, after the first two; None if there is none.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Position [m].
    """
    least = max(2 * STUCK, 0.1 * float(np.ptp(x)))
    turns: list[int] = []
    extreme, direction = 0, 0
    for k in range(1, len(x)):
        if direction == 0:
            if abs(x[k] - x[0]) > least:
                direction, extreme = (1 if x[k] > x[0] else -1), k
        elif direction * (x[k] - x[extreme]) > 0:
            extreme = k
        elif direction * (x[extreme] - x[k]) > least:
            turns.append(extreme)
            direction, extreme = -direction, k
    if len(turns) < 3:
        return None
    return slice(turns[-2], turns[-1] + 1)

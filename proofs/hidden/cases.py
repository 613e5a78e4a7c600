"""Cases for a diagnosis: an effect drawn, sized by its signal-to-noise ratio, hidden in a record.

The truth and its size come from `effects` and `signal`. No part of an estimator is
known here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hidden.effects import (
    COUNT,
    CURRENT_NOISE,
    NOMINAL,
    OPEN,
    SAMPLE,
    SAMPLES,
    Array,
    Motion,
    friction_noise,
    simulate,
)
from hidden.excitations import Excitation, draw_excitation
from hidden.signal import KNOWN_BEFORE, NO_BURSTS, WRONG, Scale, Scene, same_force, signal

LOWEST, HIGHEST = 8.0, 20.0  # signal-to-noise ratio
ALIKE = 3.0  # less than this left by another cause: the same force in this record
REDRAWS = 20
OFF = ("m", "Jm", "kt", "ke", "R", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs")
TRAVEL = 0.3  # m


@dataclass(frozen=True)
class Size:
    """The number that is scaled: where it starts, how far it may go, in the unit named."""

    start: float
    bound: float
    unit: str


SIZES = {
    "direction_asymmetry": Size(0.02, 0.5, "share"),
    "position_periodic_friction": Size(0.03, 0.5, "share"),
    "position_trend_friction": Size(0.03, 0.5, "share at the ends of the travel"),
    "torque_ripple": Size(0.03, 1.0, "N"),
    "load_bias": Size(0.02, 0.6, "N"),
    "nonlinear_viscous": Size(40.0, 5000.0, "N s^2/m^2"),
    "stribeck_mismatch": Size(0.05, 1.0, "N"),
    "presliding_hysteresis": Size(1.5e-5, 3.4e-4, "m/N, one over sigma0"),
    "unmodelled_inertia": Size(3.5, 10.0, "kg"),
    "input_delay": Size(3e-4, 8e-3, "s"),
    "friction_drift": Size(0.05, 0.5, "share over the record"),
    "resistance_drift": Size(0.03, 0.3, "share over the record"),
    "backlash": Size(5e-6, 3e-4, "m"),
    "compliance": Size(1e-6, 1e-4, "m/N, one over k"),
    "voltage_saturation": Size(0.01, 0.6, "share of the peak command that is cut off"),
    "parameter_error": Size(0.2, 0.6, "share"),
    "detent": Size(0.3, 3.0, "N, largest"),
    "bursts": Size(0.1, 1.0, "share"),
    "reversal_memory": Size(0.05, 0.8, "share"),
}
CATALOGUE = tuple(n for n in SIZES if n not in ("detent", "bursts", "reversal_memory"))
OUTSIDE = ("detent", "bursts", "reversal_memory")
STIFFEST = 1.5e6  # N/m of the bristles; where the record asks for more, it is out of reach
LOWEST_SIZE = {"presliding_hysteresis": 1 / STIFFEST}
STATIC_BELOW = 0.4  # a believed Fs this much too low is still above Fc


@dataclass(frozen=True)
class HiddenCase:
    """A record and what is hidden in it.

    Attributes
    ----------
    seed : int
    effects : tuple of str
        True names; ``("none",)`` where there is nothing.
    sizes : dict of str to dict
        The parameters of each effect.
    law : str
        The believed friction law.
    believed : dict of str to float
        Its parameters and those of the axis, by the plant's names.
    exact : bool
        The believed parameters are the true ones (but for a ``parameter_error``).
    excitation : str
    record : dict of str to array, shape (samples,)
        time, u, x, perhaps i, and in closed loop x_ref.
    target : tuple of float
        The signal-to-noise ratios drawn.
    snr : tuple of float
        Those achieved, one per effect.
    same_force : frozenset of str
        Causes that no estimator can tell from the effect in this record.
    out_of_reach : bool
        No excitation drawn shows the effect below its bound.
    """

    seed: int
    effects: tuple[str, ...]
    sizes: dict[str, dict[str, float | str]]
    law: str
    believed: dict[str, float]
    exact: bool
    excitation: str
    record: dict[str, Array]
    target: tuple[float, ...]
    snr: tuple[float, ...]
    same_force: frozenset[str]
    out_of_reach: bool


@dataclass
class Plan:
    """A case before its size is known."""

    effects: tuple[str, ...]
    excitation: Excitation
    noise: Array
    with_current: bool
    law: str
    shapes: dict[str, dict[str, float | str]]
    bursts: Array = field(default_factory=lambda: NO_BURSTS)


def _draw_shape(effect: str, random: np.random.Generator) -> dict[str, float | str]:
    """What an effect has beside its size."""
    sign = float(random.choice([-1.0, 1.0]))
    turn = random.uniform(0, 2 * math.pi)
    shapes: dict[str, dict[str, float | str]] = {
        "position_periodic_friction": {"periodic_phase": turn},
        "torque_ripple": {"ripple_phase": turn, "ripple_n": float(random.choice([1, 2, 4, 6]))},
        "stribeck_mismatch": {"sign": sign, "V2": random.uniform(3e-3, 1e-2)},
        "parameter_error": {"sign": sign, "parameter": str(random.choice(WRONG))},
        "detent": {
            "detent_width": random.uniform(0.25e-3, 1e-3),
            "place": random.uniform(0.2, 0.8),
        },
        "reversal_memory": {"sign": sign, "memory_length": random.uniform(2e-3, 6e-3)},
    }
    signed = ("direction_asymmetry", "position_trend_friction", "load_bias", "nonlinear_viscous")
    if effect in (*signed, "friction_drift", "resistance_drift"):
        return {"sign": sign}
    return shapes.get(effect, {})


def _draw_bursts(random: np.random.Generator) -> Array:
    begins = np.sort(random.uniform(0.5, 18.5, int(random.integers(3, 7))))
    return np.stack([begins, begins + random.uniform(0.3, 0.8, len(begins))], 1)


def _numbers_of(effect: str, size: float, shape: Mapping[str, float | str]) -> dict[str, float]:
    """What an effect of this size changes in the truth."""
    kept = {k: float(v) for k, v in shape.items() if k not in ("sign", "parameter", "place")}
    a = size * float(shape.get("sign", 1.0))
    direct = {
        "direction_asymmetry": "asymmetry",
        "position_periodic_friction": "periodic",
        "position_trend_friction": "trend",
        "torque_ripple": "ripple",
        "load_bias": "load",
        "nonlinear_viscous": "s3",
        "stribeck_mismatch": "rise",
        "input_delay": "delay",
        "friction_drift": "drift",
        "resistance_drift": "R_drift",
        "backlash": "gap",
        "detent": "detent",
        "bursts": "burst",
        "reversal_memory": "memory",
    }
    if effect in direct:
        return kept | {direct[effect]: a}
    if effect == "unmodelled_inertia":
        return {"m": NOMINAL["m"] + size}
    if effect == "compliance":
        return {"stiffness": 1 / size}
    if effect == "voltage_saturation":
        return {"limit": kept["peak"] * (1 - size)}
    if effect == "presliding_hysteresis":
        softer = 1 / size / NOMINAL["sigma0"]
        return {
            "sigma0": NOMINAL["sigma0"] * softer,
            "sigma1": NOMINAL["sigma1"] * math.sqrt(softer),
        }
    return {}  # a wrong belief changes nothing in the truth


def _run(plan: Plan, sizes: Mapping[str, float]) -> Scene:
    values: dict[str, float] = {}
    for effect, size in sizes.items():
        values |= _numbers_of(effect, size, plan.shapes[effect])
    e = plan.excitation
    motion = simulate(values, e.given, plan.noise, e.controller, e.gains, plan.bursts)
    return Scene(motion, {"m": NOMINAL["m"], **values}, plan.with_current, plan.law, plan.bursts)


def _believed_relative(size: float, shape: Mapping[str, float | str]) -> float:
    return size * float(shape["sign"])


def _signals(plan: Plan, scene: Scene, sizes: Mapping[str, float]) -> dict[str, Array]:
    found = {}
    for effect, size in sizes.items():
        given: dict[str, object] = dict(plan.shapes[effect])
        if effect == "parameter_error":
            given["relative"] = _believed_relative(size, plan.shapes[effect])
        found[effect] = signal(scene, effect, given)
    return found


def _ratios(scene: Scene, found: Mapping[str, Array]) -> dict[str, float]:
    """Each effect's signal-to-noise ratio, the others projected out."""
    ratios = {}
    for effect in found:
        others = tuple(found[o] for o in found if o != effect)
        ratios[effect] = Scale(scene, effect in KNOWN_BEFORE, others).snr(found[effect])
    return ratios


def usable(motion: Motion) -> bool:
    """Stays on the screw and moves both ways."""
    forth, back = motion.motor_speed.max() > 1e-3, motion.motor_speed.min() < -1e-3
    return bool(np.abs(motion.motor_position).max() < TRAVEL and forth and back)


def _bound(effect: str, shape: Mapping[str, float | str]) -> float:
    if shape.get("parameter") == "Fs" and shape["sign"] == -1.0:
        return STATIC_BELOW
    return SIZES[effect].bound


def _sized(plan: Plan, targets: Mapping[str, float]) -> tuple[dict[str, float], Scene] | None:
    """Sizes at which every effect has about the ratio asked for, or None within the bounds."""
    sizes = {e: SIZES[e].start for e in plan.effects}
    slopes = dict.fromkeys(sizes, 1.0)
    before: dict[str, tuple[float, float]] = {}
    scene = None
    for _ in range(12):
        if scene is None or plan.effects != ("parameter_error",):  # which leaves the truth alone
            scene = _run(plan, sizes)
        if not usable(scene.motion):
            return None
        ratios = _ratios(scene, _signals(plan, scene, sizes))
        if all(
            abs(math.log(max(ratios[e], 1e-9) / targets[e])) < 0.1
            and LOWEST <= ratios[e] <= HIGHEST
            for e in sizes
        ):
            return sizes, scene
        new = {}
        for e, size in sizes.items():
            x, y = math.log(size), math.log(max(ratios[e], 1e-9))
            if e in before and abs(x - before[e][0]) > 1e-3:
                slope = (y - before[e][1]) / (x - before[e][0])
                slopes[e] = min(max(slope, 0.3), 3.0)
            before[e] = (x, y)
            step = (math.log(targets[e]) - y) / slopes[e]
            low = LOWEST_SIZE.get(e, 1e-4 * SIZES[e].start)
            bound = _bound(e, plan.shapes[e])
            new[e] = min(max(size * math.exp(min(max(step, -4.0), 4.0)), low), bound)
        if new == sizes:
            return None
        sizes = new
    return None


def draw_case(effects: tuple[str, ...], seed: int) -> HiddenCase:
    """Draw a case with these effects, all else by the seed.

    Parameters
    ----------
    effects : tuple of str
        Names of `CATALOGUE` or `OUTSIDE`, or ``("none",)``.
    seed : int

    Returns
    -------
    HiddenCase
    """
    known = [*SIZES, "none"]
    random = np.random.default_rng([seed, *(known.index(e) for e in effects)])
    hidden = tuple(e for e in effects if e != "none")
    with_current, exact = bool(random.random() < 0.5), bool(random.random() < 0.5)
    law = "classical" if "presliding_hysteresis" in hidden else "modified_lugre"
    targets = {e: float(random.uniform(LOWEST, HIGHEST)) for e in hidden}
    done = None
    for _ in range(REDRAWS):
        shapes = {e: _draw_shape(e, random) for e in hidden}
        plan = Plan(
            hidden, draw_excitation(random), friction_noise(random), with_current, law, shapes
        )
        if "bursts" in hidden:
            plan.bursts = _draw_bursts(random)
        bare = _run(plan, {})
        if not usable(bare.motion):
            continue
        _fit_to_travel(plan, bare)
        done = _sized(plan, targets) if hidden else ({}, bare)
        if done:
            break
    out_of_reach = done is None
    sizes, scene = done or ({e: _bound(e, plan.shapes[e]) for e in hidden}, None)
    scene = scene or _run(plan, sizes)
    found = _signals(plan, scene, sizes)
    ratios = _ratios(scene, found)
    alike: frozenset[str] = frozenset()
    if len(hidden) == 1:
        (effect,) = hidden
        scale = Scale(scene, effect in KNOWN_BEFORE)
        alike = frozenset(same_force(scene, scale, effect, found[effect], ALIKE))
    described: dict[str, dict[str, float | str]] = {
        e: {"size": sizes[e], **_numbers_of(e, sizes[e], plan.shapes[e]), **plan.shapes[e]}
        for e in hidden
    }
    if "bursts" in hidden:
        described["bursts"]["times"] = " ".join(f"{a:.3f}-{b:.3f}" for a, b in plan.bursts)
    believed = _believe(plan, sizes, exact, random)
    record = _record(plan, scene, random)
    return HiddenCase(
        seed,
        effects,
        described,
        law,
        believed,
        exact,
        plan.excitation.name,
        record,
        tuple(targets.values()),
        tuple(ratios[e] for e in hidden),
        alike,
        out_of_reach,
    )


def _fit_to_travel(plan: Plan, bare: Scene) -> None:
    """Numbers of a shape that refer to the travel or the command."""
    x, v = bare.motion.position, np.abs(bare.motion.speed)
    for effect, shape in plan.shapes.items():
        if effect == "position_trend_friction":
            shape |= {"middle": float(x.min() + x.max()) / 2, "half_range": float(np.ptp(x)) / 2}
        if effect == "detent":
            moving = np.sort(x[v > 1e-3])
            shape["detent_place"] = float(moving[int(float(shape["place"]) * len(moving))])
        if effect == "voltage_saturation":
            shape["peak"] = float(np.abs(bare.motion.command).max())


def _believe(
    plan: Plan, sizes: Mapping[str, float], exact: bool, random: np.random.Generator
) -> dict[str, float]:
    believed = dict(NOMINAL)
    if not exact:
        believed |= {n: NOMINAL[n] * (1 + random.uniform(-0.03, 0.03)) for n in OFF}
    if "parameter_error" in sizes:
        shape = plan.shapes["parameter_error"]
        name = str(shape["parameter"])
        relative = _believed_relative(sizes["parameter_error"], shape)
        believed[name] = NOMINAL[name] * (1 + relative)
    if plan.law == "classical":
        for name in ("sigma0", "sigma1", "Kv"):
            del believed[name]
    return believed


def _record(plan: Plan, scene: Scene, random: np.random.Generator) -> dict[str, Array]:
    motion = scene.motion
    phase = random.uniform(0.0, COUNT)  # where the encoder's first count lies
    counted = np.floor((motion.motor_position + phase) / COUNT) * COUNT
    closed = plan.excitation.controller != OPEN
    record = {
        "time": np.arange(SAMPLES + 1) * SAMPLE,
        "u": motion.command,
        "x": motion.encoder if closed else counted - counted[0],
    }
    noise = CURRENT_NOISE * random.standard_normal(len(motion.current))
    if plan.with_current:
        record["i"] = motion.current + noise
    if closed:
        record["x_ref"] = plan.excitation.given
    return {name: np.asarray(values[:SAMPLES]) for name, values in record.items()}


@dataclass(frozen=True)
class CaseFiles:
    """Where a case was written."""

    record: Path
    parameters: Path


def write_case(case: HiddenCase, folder: Path) -> CaseFiles:
    """Write what an estimator gets: ``record.csv`` and ``believed.toml``, and nothing of the truth.

    Parameters
    ----------
    case : HiddenCase
    folder : Path
        Made if it is not there.

    Returns
    -------
    CaseFiles
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = CaseFiles(folder / "record.csv", folder / "believed.toml")
    table = np.stack(list(case.record.values()), 1)
    header = ",".join(case.record)
    np.savetxt(files.record, table, fmt="%.9g", delimiter=",", header=header, comments="")
    lines = [f'law = "{case.law}"', "", "[plant]"]
    lines += [f"{name} = {value!r}" for name, value in case.believed.items()]
    files.parameters.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return files

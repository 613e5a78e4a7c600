"""One record with or without hidden effects, and what the truth says of it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from worlds import layout as at
from worlds.axes import BALL_SCREW, DRIVE, misjudged
from worlds.effects import CATALOGUE, Effect, Setting
from worlds.instruments import Instruments, read_current, read_position
from worlds.outside import OUTSIDE
from worlds.scenes import Columns, Scene, make_scene
from worlds.shapes import Along
from worlds.simulator import Motion
from worlds.visibility import Errors, Sight, needs, sampled, see, weigh
from worlds.worlds import WORLDS, Conditions

TRIES = 12
REST = 1e-5  # m/s
SAME_LAW = 3.0  # ratio up to which another formulation of friction is the believed one
BELIEVED = {
    BALL_SCREW: ("kt", "ke", "R", "L", "p", "m", "Jm"),
    DRIVE: ("m", "gain", "offset"),
}
OF_LAW = {
    "lugre": ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs"),
    "classical": ("sigma2", "Fc", "Fs", "Vs"),
}


class Unusable(Exception):
    """No draw of a world gave a record that moves both ways and stays in range."""


@dataclass(frozen=True)
class Case:
    """A record, what its user believes, and the truth.

    Attributes
    ----------
    world, seed
        Where it comes from.
    effects : tuple of Effect
    record : dict
        Columns t [s], u [V], x [m] and perhaps i [A], each shape (samples,).
    plant, law : str
    believed : dict
        Values that the parameter file says.
    wrong : dict
        Factors by which believed values are off.
    sights : tuple of Sight
        Of each effect.
    law_ratio : float
        What the record shows of friction formulated otherwise than the believed law.
    conditions : Conditions
    instruments : Instruments
    """

    world: str
    seed: int
    effects: tuple[Effect, ...]
    record: dict[str, Columns]
    plant: str
    law: str
    believed: dict[str, float]
    wrong: dict[str, float]
    sights: tuple[Sight, ...]
    law_ratio: float
    conditions: Conditions
    instruments: Instruments


def draw_case(world: str, effects: tuple[str, ...], seed: int) -> Case:
    """Draw a record of a world.

    Parameters
    ----------
    world : str
        One of `WORLDS`.
    effects : tuple of str
        Names of the catalogue or of the outside effects; none for a faultless record.
    seed : int

    Raises
    ------
    ValueError
        For a world or an effect that there is not.
    Unusable
        If no draw of the world moves both ways and stays in range.
    """
    if world not in WORLDS:
        raise ValueError(f"world {world!r}, expected one of {', '.join(WORLDS)}")
    for name in effects:
        if name not in CATALOGUE and name not in OUTSIDE:
            known = ", ".join([*CATALOGUE, *OUTSIDE])
            raise ValueError(f"effect {name!r}, expected one of {known}")
    words = zlib.crc32("+".join([world, *effects]).encode())
    rng = np.random.default_rng([words, seed])
    for tried in range(TRIES):
        scene = make_scene(WORLDS[world](rng), rng, bare="presliding_hysteresis" in effects)
        faultless = scene.run({}, 0.0, clean=False)
        if not _usable(faultless, scene):
            continue
        case = _hide(world, seed, effects, scene, faultless, 0.5**tried)
        if case is not None:
            return case
    raise Unusable(f"{world}, {'+'.join(effects) or 'faultless'}, seed {seed}: {TRIES} tries")


def _usable(motion: Motion, scene: Scene) -> bool:
    """Whether it moves both ways, far enough to be read, and stays in range."""
    x, v = motion.log[:, at.X], motion.log[:, at.V]
    if not np.all(np.isfinite(motion.log)) or np.abs(x).max() > 1.1 * scene.conditions.axis.travel:
        return False
    moving = 0.02 * np.abs(v).max()
    both = min(np.mean(v > moving), np.mean(v < -moving))
    return bool(both > 0.03 and np.ptp(x) > max(200 * scene.faultless[at.RESOLUTION], 2e-4))


def _setting(scene: Scene, faultless: Motion, shrink: float) -> Setting:
    log = faultless.log
    return Setting(
        axis=scene.conditions.axis,
        double=scene.double,
        sampling=scene.conditions.sampling,
        duration=scene.conditions.duration,
        peak=float(np.abs(faultless.commands).max()),
        fastest=float(np.abs(log[:, at.V]).max()),
        reach=float(np.abs(log[:, at.X]).max()),
        shrink=shrink,
        finest=scene.conditions.finest,
    )


def _hide(
    world: str,
    seed: int,
    names: tuple[str, ...],
    scene: Scene,
    faultless: Motion,
    shrink: float,
) -> Case | None:
    """The scene with effects; none if they leave no usable record."""
    rng = scene.rng
    setting = _setting(scene, faultless, shrink)
    scene, faultless, law_ratio = _same_law(scene, faultless, setting)
    effects = tuple((CATALOGUE | OUTSIDE)[name](rng, setting) for name in names)
    changes = {k: v for e in effects for k, v in e.changes.items()}
    bursts = sum(e.bursts for e in effects)
    motion = scene.run(changes, bursts, clean=False) if effects else faultless
    if not _usable(motion, scene):
        return None
    with_current = scene.instruments.current != "none"
    record, _ = _record(scene, motion, changes)
    _, errors = _record(scene, faultless, {})
    noise = sampled(needs(faultless.log, with_current), scene.per_sample)
    weights = weigh(setting, noise, errors, _resting(faultless))
    sights = []
    for effect in effects:
        clean = scene.run(effect.changes, effect.bursts, clean=True).log
        if not np.all(np.isfinite(clean)):
            return None
        if effect.name == "scale_error":
            clean = _misread(clean, scene, effect)
        along = Along(setting, clean, scene.period / scene.logged, with_current)
        sights.append(see(effect, along, weights, scene.per_sample))
    believed, wrong = misjudged(rng, scene.conditions.axis, scene.conditions.exact)
    axis = scene.conditions.axis
    return Case(
        world, seed, effects, record, axis.plant, axis.law, believed, wrong, tuple(sights),
        law_ratio, scene.conditions, scene.instruments,
    )  # fmt: skip


def _same_law(scene: Scene, faultless: Motion, setting: Setting) -> tuple[Scene, Motion, float]:
    """The scene with a friction that the record cannot tell from the believed law's."""
    axis = scene.conditions.axis
    own = {"classical": (at.SET_VALUED,), "lugre": (at.LUGRE, at.MODIFIED_LUGRE)}[axis.law]
    if axis.formulation in own:
        return scene, faultless, 0.0
    with_current = scene.instruments.current != "none"
    _, errors = _record(scene, faultless, {})
    noise = sampled(needs(faultless.log, with_current), scene.per_sample)
    clean = scene.run({}, 0.0, clean=True).log
    along = Along(setting, clean, scene.period / scene.logged, with_current)
    ratio = see(
        None, along, weigh(setting, noise, errors, _resting(faultless)), scene.per_sample
    ).ratio
    if ratio <= SAME_LAW:
        return scene, faultless, ratio
    plain = replace(axis, formulation=own[0])
    par = scene.faultless.copy()
    par[at.LAW] = own[0]
    scene = replace(scene, faultless=par, conditions=replace(scene.conditions, axis=plain))
    return scene, scene.run({}, 0.0, clean=False), 0.0


def _resting(motion: Motion) -> float:
    """Share of the time that the bristles hold it."""
    return float(np.mean(np.abs(motion.log[:, at.V]) < REST))


def _misread(log: Columns, scene: Scene, effect: Effect) -> Columns:
    """A log whose needs are those of the motion as a bent scale reads it."""
    axis = scene.faultless.copy()
    axis[at.RESOLUTION] = axis[at.INTERPOLATION] = 0.0
    for place, value in effect.changes.items():
        axis[place] = value
    period = scene.period / scene.logged
    off = read_position(replace(scene.instruments, encoder="exact"), axis, log[:, at.X])
    off = off - log[:, at.X]
    speed = np.gradient(off, period)
    double = scene.double
    mass = double[at.MOTOR_MASS] + double[at.BLOCK_MASS]
    force = mass * np.gradient(speed, period) + double[at.SIGMA2] * speed
    log = log.copy()
    log[:, at.NEED_FORCE] -= force
    log[:, at.NEED_VOLTAGE] -= double[at.KE] * speed
    volts = 0.0 if double[at.IS_DRIVE] else double[at.KT] / double[at.R] * double[at.KE]
    log[:, at.NEED] -= force + volts * speed
    return log


def _record(
    scene: Scene, motion: Motion, changes: dict[int, float]
) -> tuple[dict[str, Columns], Errors]:
    """The columns of a record, and their errors."""
    conditions, step = scene.conditions, scene.per_sample
    axis = scene.faultless.copy()
    for place, value in changes.items():
        axis[place] = value
    log = motion.log
    x = log[::step, at.X]
    commands = motion.commands[:: conditions.faster]
    if conditions.command == "averaged":
        commands = sampled(motion.commands, conditions.faster)
    record = {
        "time": np.arange(x.size) * conditions.sampling,
        "u": commands,
        "x": read_position(scene.instruments, axis, x),
    }
    error_i = None
    if scene.instruments.current != "none":
        i = log[::step, at.CURRENT]
        rng = np.random.default_rng(x.size)  # of its own: a record's other draws stay the same
        record["i"] = read_current(scene.instruments, rng, i, conditions.sampling)
        line = np.polyfit(i, record["i"], 1)  # a sensor's gain and offset are refitted
        error_i = record["i"] - np.polyval(line, i)
    return record, Errors(record["x"] - x, error_i)


def write_case(case: Case, folder: Path) -> tuple[Path, Path]:
    """Write ``record.csv`` and ``believed.toml``, and nothing of the truth; return their paths."""
    record, believed = folder / "record.csv", folder / "believed.toml"
    columns = list(case.record)
    table = np.column_stack([case.record[c] for c in columns])
    np.savetxt(record, table, fmt="%.12g", delimiter=",", header=",".join(columns), comments="")
    names = (*BELIEVED[case.plant], *OF_LAW[case.law])
    lines = [f'kind = "{case.plant}"', f'law = "{case.law}"', "", "[plant]"]
    lines += [f"{name} = {case.believed[name]:.10g}" for name in names]
    believed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return record, believed

"""One machine with or without hidden effects: its records, and the truth on them."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from worlds import layout as at
from worlds.axes import BALL_SCREW, DRIVE, misjudged
from worlds.conditions import Conditions
from worlds.effects import CATALOGUE, Effect, Setting
from worlds.instruments import Instruments, read_position
from worlds.outside import OUTSIDE
from worlds.records import make_record
from worlds.scenes import Columns, Scene, commanded, make_scenes
from worlds.shapes import Along
from worlds.signals import SIGNALS, misread, spoilt
from worlds.simulator import Motion
from worlds.visibility import Sight, Weights, needs, sampled, see, weigh
from worlds.worlds import WORLDS

TRIES = 12
REST = 1e-5  # m/s
SAME_LAW = 3.0  # ratio up to which another formulation of friction counts as the believed one
UNSEEN = 2.5  # largest ratio of all tolerated effects together
BELIEVED = {
    BALL_SCREW: ("kt", "ke", "R", "L", "p", "m", "Jm"),
    DRIVE: ("m", "gain", "offset"),
}
OF_LAW = {
    "lugre": ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs"),
    "classical": ("sigma2", "Fc", "Fs", "Vs"),
}
EFFECTS = CATALOGUE | OUTSIDE | SIGNALS


class Unusable(Exception):
    """No draw of a world gave a record that moves in both directions and stays in range."""


@dataclass(frozen=True)
class Case:
    """Records of a machine, the model assumed by their user, and the truth.

    Attributes
    ----------
    world, seed
        World and seed of the case.
    effects : tuple of Effect
    records : list of dict
        Columns time [s], u [V], x [m] and optionally i [A], each shape (samples,).
    plant, law : str
    believed : dict
        Values in the parameter file.
    wrong : dict
        Factors by which believed values are wrong.
    sights : tuple of Sight
        Visibility of each effect.
    law_ratio : float
        Ratio of the difference between the machine's friction and the believed law.
    tolerated_ratio : float
        Largest ratio of tolerated properties of the machine, which are not effects.
    conditions : Conditions
    instruments : Instruments
    scenes : tuple of Scene
        Scene of each record; `more_of` runs them again.
    """

    world: str
    seed: int
    effects: tuple[Effect, ...]
    records: list[dict[str, Columns]]
    plant: str
    law: str
    believed: dict[str, float]
    wrong: dict[str, float]
    sights: tuple[Sight, ...]
    law_ratio: float
    tolerated_ratio: float
    conditions: Conditions
    instruments: Instruments
    scenes: tuple[Scene, ...] = field(repr=False, compare=False)

    @property
    def record(self) -> dict[str, Columns]:
        """The first record."""
        return self.records[0]


def draw_case(world: str, effects: tuple[str, ...], seed: int) -> Case:
    """Draw a record of a world.

    Parameters
    ----------
    world : str
        One of `WORLDS`.
    effects : tuple of str
        Names of the catalogue, of the outside effects or of the wrong signals; none for a
        faultless record.
    seed : int

    Raises
    ------
    ValueError
        For an unknown world or effect.
    Unusable
        If no draw of the world moves in both directions and stays in range.
    """
    if world not in WORLDS:
        raise ValueError(f"world {world!r}, expected one of {', '.join(WORLDS)}")
    for name in effects:
        if name not in EFFECTS:
            raise ValueError(f"effect {name!r}, expected one of {', '.join(EFFECTS)}")
    words = zlib.crc32("+".join([world, *effects]).encode())
    rng = np.random.default_rng([words, seed])
    for tried in range(TRIES):
        conditions = WORLDS[world](rng)
        if "scale_of_i" in effects:
            currents = {n: odds for n, odds in conditions.currents.items() if n != "none"}
            if not currents:
                raise ValueError(f"scale_of_i: no current is recorded in {world}")
            conditions = replace(conditions, currents=currents)
        scenes = make_scenes(conditions, rng, bare="presliding_hysteresis" in effects)
        takes = [Take(scene, scene.run({}, 0.0, clean=False)) for scene in scenes]
        if not _usable([take.motion for take in takes], scenes[0]):
            continue
        case = _hide(world, seed, effects, takes, 0.5**tried)
        if case is not None:
            return case
    raise Unusable(f"{world}, {'+'.join(effects) or 'faultless'}, seed {seed}: {TRIES} tries")


@dataclass(frozen=True)
class Take:
    """One record of a machine without an effect: its inputs, and its motion."""

    scene: Scene
    motion: Motion

    @property
    def with_current(self) -> bool:
        """Whether its current is recorded."""
        return self.scene.instruments.current != "none"

    def again(self, scene: Scene) -> Take:
        """The same with something changed."""
        return Take(scene, scene.run({}, 0.0, clean=False))

    def weights(self, setting: Setting) -> Weights:
        """Weights by its noise."""
        _, errors = make_record(self.scene, self.motion, {})
        noise = sampled(needs(self.motion.log, self.with_current), self.scene.per_sample)
        return weigh(setting, noise, errors, _resting(self.motion))

    def along(self, setting: Setting, log: Columns) -> Along:
        """Shapes along another log of the record."""
        return Along(setting, log, self.scene.period / self.scene.logged, self.with_current)


def _usable(motions: list[Motion], scene: Scene) -> bool:
    """Whether they move in both directions, far enough to be measured, and stay in range."""
    x, v = (np.concatenate([m.log[:, c] for m in motions]) for c in (at.X, at.V))
    if not all(np.all(np.isfinite(m.log)) for m in motions):
        return False
    if np.abs(x).max() > 1.1 * scene.conditions.axis.travel:
        return False
    moving = 0.02 * np.abs(v).max()
    both = min(np.mean(v > moving), np.mean(v < -moving))
    way = min(float(np.ptp(m.log[:, at.X])) for m in motions)
    return bool(both > 0.03 and way > max(200 * scene.faultless[at.RESOLUTION], 2e-4))


def _setting(takes: list[Take], shrink: float) -> Setting:
    conditions = takes[0].scene.conditions

    def most(column: int) -> float:
        return max(float(np.abs(take.motion.log[:, column]).max()) for take in takes)

    return Setting(
        axis=conditions.axis,
        double=takes[0].scene.double,
        sampling=conditions.sampling,
        duration=conditions.duration,
        peak=max(float(np.abs(take.motion.commands).max()) for take in takes),
        fastest=most(at.V),
        reach=most(at.X),
        shrink=shrink,
        finest=conditions.finest,
    )


def _hide(
    world: str, seed: int, names: tuple[str, ...], takes: list[Take], shrink: float
) -> Case | None:
    """The machine with effects; none if they leave no usable record."""
    rng = takes[0].scene.rng
    setting = _setting(takes, shrink)
    takes, law_ratio = _same_law(takes, setting)
    takes, tolerated_ratio = _tolerated(takes, setting)
    effects = tuple(EFFECTS[name](rng, setting) for name in names)
    changes, bursts = _together(effects)
    motions = [take.motion for take in takes]
    if changes or bursts:
        motions = [take.scene.run(changes, bursts, clean=False) for take in takes]
    scenes = tuple(take.scene for take in takes)
    if not _usable(motions, scenes[0]):
        return None
    records = [
        spoilt(make_record(scene, motion, changes)[0], effects)
        for scene, motion in zip(scenes, motions, strict=True)
    ]
    weights = [take.weights(setting) for take in takes] if effects else []
    sights = []
    for effect in effects:
        alongs = []
        for take in takes:
            log = take.scene.run(effect.changes, effect.bursts, clean=True).log
            if not np.all(np.isfinite(log)):
                return None
            if effect.name == "scale_error":
                log = _misread(log, take.scene, effect)
            along = take.along(setting, log)
            alongs.append(misread(along, effect) if effect.name in SIGNALS else along)
        sights.append(see(effect, alongs, weights, scenes[0].per_sample))
    conditions = scenes[0].conditions
    axis = conditions.axis
    believed, wrong = misjudged(rng, axis, conditions.exact)
    return Case(
        world, seed, effects, records, axis.plant, axis.law, believed, wrong, tuple(sights),
        law_ratio, tolerated_ratio, conditions, scenes[0].instruments, scenes,
    )  # fmt: skip


def _together(effects: tuple[Effect, ...]) -> tuple[dict[int, float], float]:
    """Changes of the axis, and bursts, of all effects."""
    changes = {place: value for e in effects for place, value in e.changes.items()}
    return changes, sum(e.bursts for e in effects)


def _same_law(takes: list[Take], setting: Setting) -> tuple[list[Take], float]:
    """The takes with a friction that the records cannot distinguish from the believed law."""
    axis = takes[0].scene.conditions.axis
    own = {"classical": (at.SET_VALUED,), "lugre": (at.LUGRE, at.MODIFIED_LUGRE)}[axis.law]
    if axis.formulation in own:
        return takes, 0.0
    ratio = _ratio(takes, setting, None)
    if ratio <= SAME_LAW:
        return takes, ratio
    plain = replace(axis, formulation=own[0])
    changed = []
    for take in takes:
        par = take.scene.faultless.copy()
        par[at.LAW] = own[0]
        conditions = replace(take.scene.conditions, axis=plain)
        changed.append(take.again(replace(take.scene, faultless=par, conditions=conditions)))
    return changed, 0.0


def _tolerated(takes: list[Take], setting: Setting) -> tuple[list[Take], float]:
    """The takes with tolerated properties of the machine, reduced until they are not visible."""
    most, places = 0.0, {}
    tolerated = takes[0].scene.conditions.tolerated
    for effect in tolerated:
        ratio = _ratio(takes, setting, effect)
        share = min(1.0, UNSEEN / len(tolerated) / max(ratio, 1e-9))
        most = max(most, share * ratio)
        for place, value in effect.changes.items():
            believed = takes[0].scene.double[place]
            # forms and times do not change, sizes are reduced
            whole = place in (at.DRIFT_FORM, at.DRIFT_TIME)
            places[place] = value if whole else believed + share * (value - believed)
    if not places:
        return takes, 0.0
    return [take.again(replace(take.scene, tolerated=places)) for take in takes], most


def _ratio(takes: list[Take], setting: Setting, effect: Effect | None) -> float:
    """Ratio of an effect, or of the law's formulation, in the records."""
    alongs, weights = [], []
    for take in takes:
        weights.append(take.weights(setting))
        changes = effect.changes if effect else {}
        alongs.append(take.along(setting, take.scene.run(changes, 0.0, clean=True).log))
    return see(effect, alongs, weights, takes[0].scene.per_sample, alike=False).ratio


def _resting(motion: Motion) -> float:
    """Share of the time in which the bristles hold the body."""
    return float(np.mean(np.abs(motion.log[:, at.V]) < REST))


def _misread(log: Columns, scene: Scene, effect: Effect) -> Columns:
    """A log whose needs are those of the motion measured by a bent scale."""
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


def more_of(case: Case, command: Mapping[str, Columns]) -> dict[str, Columns]:
    """Another record of the same machine, its hidden effects and its instruments, as `Case.record`.

    Parameters
    ----------
    case : Case
    command : mapping
        Columns time [s] and either x_d [m], which the world's controller follows (a default one if
        the world has none), or u [V], which is held between its times. The record begins with the
        command and has the world's sampling and new friction noise.

    Raises
    ------
    ValueError
        For a command without these columns.
    Unusable
        If the motion leaves the travel.
    """
    drawn = np.concatenate([np.asarray(v, dtype=float) for v in command.values()])
    rng = np.random.default_rng([case.seed, zlib.crc32(drawn.tobytes())])
    scene = commanded(case.scenes[0], command, rng)
    changes, bursts = _together(case.effects)
    motion = scene.run(changes, bursts, clean=False)
    x = motion.log[:, at.X]
    if not np.all(np.isfinite(motion.log)) or np.abs(x).max() > 1.5 * case.conditions.axis.travel:
        raise Unusable(f"{case.world}, seed {case.seed}: the command leaves the travel")
    return spoilt(make_record(scene, motion, changes)[0], case.effects)


def write_case(case: Case, folder: Path) -> tuple[list[Path], Path]:
    """Write ``record.csv`` (and ``record_2.csv`` ...) and ``believed.toml``; return their paths.

    They do not contain the truth.
    """
    paths, believed = [], folder / "believed.toml"
    for k, record in enumerate(case.records, 1):
        paths.append(write_record(record, folder / (f"record_{k}.csv" if k > 1 else "record.csv")))
    names = (*BELIEVED[case.plant], *OF_LAW[case.law])
    lines = [f'kind = "{case.plant}"', f'law = "{case.law}"', "", "[plant]"]
    lines += [f"{name} = {case.believed[name]:.10g}" for name in names]
    believed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return paths, believed


def write_record(record: Mapping[str, Columns], path: Path) -> Path:
    """Write a record's columns; return the path."""
    table = np.column_stack(list(record.values()))
    np.savetxt(path, table, fmt="%.12g", delimiter=",", header=",".join(record), comments="")
    return path

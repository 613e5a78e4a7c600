"""Simulated records of machines with known truth: the worlds in which the diagnosis is tested.

Nothing of the estimator is imported. In the order of their making: `axis` (names of all values),
`friction`, `simulator`, `machines` (the worlds), `scenes` (motions, noise, instruments, records),
`effects` (what is hidden), `visibility`, and here whole cases.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from worlds import axis as at
from worlds.axis import BALL_SCREW, DRIVE, changed, misjudged
from worlds.effects import CATALOGUE, EFFECTS, OUTSIDE, SIGNALS, Effect, spoilt
from worlds.machines import HELD_BACK, WORLDS, Conditions
from worlds.scenes import Columns, Motion, Scene, make_record, make_scenes
from worlds.visibility import Along, Sight, finite, see, see_effect

__all__ = [
    "CATALOGUE", "HELD_BACK", "OUTSIDE", "SIGNALS", "WORLDS", "Case", "Unusable", "draw_case",
    "effects_of", "write_case",
]  # fmt: skip

TRIES = 12
SAME_LAW = 3.0  # ratio up to which another formulation of friction counts as the believed one
UNSEEN = 2.5  # largest ratio of all tolerated effects together
BELIEVED = {
    BALL_SCREW: ("kt", "ke", "R", "L", "p", "m", "Jm"),
    DRIVE: ("m", "gain", "offset"),
    "lugre": ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs"),
    "classical": ("sigma2", "Fc", "Fs", "Vs"),
}
# worlds with some or all records of a slide driven by a force: no resistance and no current
NO_MOTOR = (
    "linear_drive", "heavy_friction", "slow_noise", "jittered", "one_way", "geared_joint",
    "low_sampling", "held_back_gantry",
)  # fmt: skip
# causes that look like a wrong scale and must be distinguished from it
LIKE_A_SCALE = (
    "direction_asymmetry", "load_bias", "unmodelled_inertia", "input_delay", "parameter_error",
)  # fmt: skip
Scenes = tuple[Scene, ...]


class Unusable(Exception):
    """No draw of a world gave a record that moves in both directions and stays in range."""


@dataclass(frozen=True)
class Case:
    """Records of a machine, the model assumed by their user, and the truth."""

    effects: tuple[Effect, ...]
    # columns time [s], u [V], x [m] and optionally i [A], each shape (samples,)
    records: list[Columns]
    believed: dict[str, float]  # values in the parameter file
    wrong: dict[str, float]  # factors by which they are wrong
    sights: tuple[Sight, ...]  # visibility of each effect
    law_ratio: float  # of the difference between the machine's friction and the believed law
    tolerated_ratio: float  # largest of tolerated properties of the machine
    scenes: Scenes = field(repr=False)  # of each record

    @property
    def conditions(self) -> Conditions:
        return self.scenes[0].conditions


def effects_of(world: str) -> tuple[tuple[str, ...], ...]:
    """Names of the causes, outside effects and wrong signals that a world can have."""
    if world == "wrong_scales":
        return LIKE_A_SCALE, (), tuple(SIGNALS)
    lacking = {"resistance_drift", "scale_of_i"} if world in NO_MOTOR else set()
    if world not in ("fast_screw", "heavy_screw"):  # whose law always has bristles
        lacking.add("other_bristles")
    groups = CATALOGUE, OUTSIDE, SIGNALS
    return tuple(tuple(n for n in names if n not in lacking) for names in groups)


def draw_case(world: str, effects: tuple[str, ...], seed: int) -> Case:
    """Draw the case of a seed from a world of `WORLDS`, with some of its `effects_of` or with none.

    `ValueError` is for an unknown name or an effect that it cannot have, `Unusable` see there.
    """
    for name, known in ((world, WORLDS), *((name, EFFECTS) for name in effects)):
        if name not in known:
            raise ValueError(f"got {name!r}, expected one of {', '.join(known)}")
    words = zlib.crc32("+".join([world, *effects]).encode())
    rng = np.random.default_rng([words, seed])
    for tried in range(TRIES):
        conditions = WORLDS[world](rng)
        if "scale_of_i" in effects:
            currents = {n: odds for n, odds in conditions.currents.items() if n != "none"}
            if not currents:
                raise ValueError(f"scale_of_i: no current is recorded in {world}")
            conditions = replace(conditions, currents=currents)
        drawn = make_scenes(conditions, rng, bare="presliding_hysteresis" in effects)
        scenes = tuple(scene.taken() for scene in drawn)
        motions = [scene.motion for scene in scenes]
        if not _usable(motions, scenes[0]):
            continue
        extent = {
            "peak": max(float(np.abs(commands).max()) for _, commands in motions),
            "fastest": max(float(np.abs(log["v"]).max()) for log, _ in motions),
            "reach": max(float(np.abs(log["x"]).max()) for log, _ in motions),
            "shrink": 0.5**tried,
        }
        case = _hide(effects, tuple(replace(scene, **extent) for scene in scenes))
        if case is not None:
            return case
    raise Unusable(f"{world}, {'+'.join(effects) or 'faultless'}, seed {seed}: {TRIES} tries")


def _usable(motions: list[Motion], scene: Scene) -> bool:
    """Whether they move in both directions, far enough to be measured, and stay in range."""
    x, v = (np.concatenate([log[name] for log, _ in motions]) for name in ("x", "v"))
    if not all(finite(log) for log, _ in motions):
        return False
    if np.abs(x).max() > 1.1 * scene.conditions.axis.travel:
        return False
    moving = 0.02 * np.abs(v).max()
    both = min(np.mean(v > moving), np.mean(v < -moving))
    way = min(float(np.ptp(log["x"])) for log, _ in motions)
    return bool(both > 0.03 and way > max(200 * scene.faultless.resolution, 2e-4))


def _hide(names: tuple[str, ...], scenes: Scenes) -> Case | None:
    """The machine with effects; none if they leave no usable record."""
    rng, drawn = scenes[0].rng, scenes[0]
    scenes, law_ratio = _same_law(scenes)
    scenes, tolerated_ratio = _tolerated(scenes)
    effects = tuple(replace(EFFECTS[name](rng, drawn), name=name) for name in names)
    changes = {place: value for e in effects for place, value in e.changes.items()}
    motions = [scene.run(changes) if changes else scene.motion for scene in scenes]
    if not _usable(motions, scenes[0]):
        return None
    records = [
        spoilt(make_record(scene, motion, changes)[0], effects)
        for scene, motion in zip(scenes, motions, strict=True)
    ]
    axis, sights = scenes[0].conditions.axis, []
    for effect in effects:
        alongs = [see_effect(scene, effect) for scene in scenes]
        if None in alongs:
            return None
        sights.append(see(effect.name, alongs, [p for p in (axis.lead, effect.period) if p]))
    believed, wrong = misjudged(rng, axis, scenes[0].conditions.exact)
    ratios = law_ratio, tolerated_ratio
    return Case(effects, records, believed, wrong, tuple(sights), *ratios, scenes)


def _same_law(scenes: Scenes) -> tuple[Scenes, float]:
    """The scenes with a friction that the records cannot distinguish from the believed law."""
    conditions = scenes[0].conditions
    axis = conditions.axis
    own = {"classical": (at.SET_VALUED,), "lugre": (at.LUGRE, at.MODIFIED_LUGRE)}[axis.law]
    if axis.formulation in own:
        return scenes, 0.0
    ratio = _ratio(scenes, "", {})
    if ratio <= SAME_LAW:
        return scenes, ratio
    conditions, plain = replace(conditions, axis=replace(axis, formulation=own[0])), {"law": own[0]}
    taken = (s.taken(conditions=conditions, faultless=changed(s.faultless, plain)) for s in scenes)
    return tuple(taken), 0.0


def _tolerated(scenes: Scenes) -> tuple[Scenes, float]:
    """The scenes with tolerated properties of the machine, whose sizes are reduced until unseen."""
    most, values, tolerated = 0.0, {}, scenes[0].conditions.tolerated
    for name, changes in tolerated.items():
        ratio = _ratio(scenes, name, changes)
        share = min(1.0, UNSEEN / len(tolerated) / max(ratio, 1e-9))
        most = max(most, share * ratio)
        for place, value in changes.items():
            believed, whole = scenes[0].double[place], place in ("drift_form", "drift_time")
            values[place] = value if whole else believed + share * (value - believed)
    return tuple(s.taken(tolerated=values) for s in scenes) if values else scenes, most


def _ratio(scenes: Scenes, name: str, changes: dict[str, float]) -> float:
    """Ratio of changes, or of the law's formulation, in the records."""
    return see(name, [Along(s, s.run(changes, clean=True)[0]) for s in scenes]).ratio


def write_case(case: Case, folder: Path) -> tuple[list[Path], Path]:
    """Write ``record.csv`` (and ``record_2.csv`` ...) and ``believed.toml``; return their paths.

    They do not contain the truth.
    """
    paths, believed = [], folder / "believed.toml"
    for k, record in enumerate(case.records, 1):
        path, table = folder / (f"record_{k}.csv" if k > 1 else "record.csv"), [*record.values()]
        head = ",".join(record)
        np.savetxt(path, np.stack(table, 1), fmt="%.12g", delimiter=",", header=head, comments="")
        paths.append(path)
    plant, law = case.conditions.axis.plant, case.conditions.axis.law
    lines = [f'kind = "{plant}"', f'law = "{law}"', "", "[plant]"]
    lines += [f"{n} = {case.believed[n]:.10g}" for n in (*BELIEVED[plant], *BELIEVED[law])]
    believed.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return paths, believed

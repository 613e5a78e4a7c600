"""Trials of the worlds: what is hidden where, what the diagnosis answers, and how that counts."""

from __future__ import annotations

import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

from worlds import WORLDS, Case, Unusable, draw_case, effects_of, write_case

FAULTLESS, CAUSE, OUTSIDE, SIGNAL = "faultless", "cause", "outside", "signal"
NAMEABLE = (CAUSE, SIGNAL)
FIRST_SEED = 120000  # those below have been looked at; the proof's are looked at once
EACH = 6  # records of every cause in every world
FAULTLESS_EACH = 10  # faultless records to one of each cause
REFUSED, FAILED, UNUSABLE = "refused", "failed", "unusable"
VISIBLE = 12.0  # ratio from which on an answer is asked for
# the same thing by another name: a wrong value of these is that cause
SYNONYMS = {"m": "unmodelled_inertia", "Jm": "unmodelled_inertia", "offset": "load_bias"}


@dataclass(frozen=True)
class Trial:
    """One record to be diagnosed."""

    world: str
    group: str
    effect: str  # empty where there is none
    seed: int

    @property
    def key(self) -> str:
        """The trial in one word."""
        return f"{self.world}:{self.effect or FAULTLESS}:{self.seed}"


@dataclass(frozen=True)
class Row:
    """One trial: the truth, the answer, and what it took.

    Attributes
    ----------
    ratio : float
        What the truth says that the record can show of the effect.
    shared : list of str
        Other causes of the same shape, by the truth.
    truth : dict
        Values of the effect that have a counterpart in an answer.
    conditions : dict
    wrong_values : dict
        Factors by which prior values are off.
    verdict : str
        The diagnosis' own, or ``refused`` (bad input, said so), ``failed`` (a crash),
        ``unusable`` (the world gave no record).
    named : list of str
        All causes in the answer, in its order.
    values, intervals : list of dict
        Of each cause.
    evidence : float or None
        Of the strongest cause by itself, in natural logarithms.
    kind : list of float
        What of the record says how much of it there is without a fault; empty without an answer.
    seconds : float
        Of processor time.
    message : str
        The last line of what was raised instead of an answer.
    """

    key: str
    world: str
    group: str
    effect: str
    form: str
    seed: int
    ratio: float
    shared: list[str]
    truth: dict[str, float]
    conditions: dict[str, str | float]
    wrong_values: dict[str, float]
    verdict: str
    named: list[str]
    values: list[dict[str, float]]
    intervals: list[dict[str, tuple[float, float]]]
    evidence: float | None
    kind: list[float]
    seconds: float
    message: str

    @property
    def said(self) -> list[str]:
        """The names, a wrong mass as inertia and a wrong offset as a load."""
        said = []
        for name, values in zip(self.named, self.values, strict=True):
            meant = {SYNONYMS.get(v, "") for v in values} if name == "parameter_error" else set()
            said.append(meant.pop() if len(meant) == 1 and "" not in meant else name)
        return said

    @property
    def first(self) -> str:
        """What comes first, or that nothing does."""
        if self.said:
            return self.said[0]
        return self.verdict if self.verdict in ("unexplained", REFUSED, FAILED) else "none"

    @property
    def allowed(self) -> set[str]:
        """Names that are not wrong: the effect's and, beside it, those of its shape."""
        if self.group not in NAMEABLE:
            return set()
        return {self.effect, *self.shared} if self.effect in self.said else {self.effect}

    @property
    def wrong(self) -> bool:
        """Whether any name in the answer is wrong, or there was a crash."""
        return self.verdict == FAILED or not set(self.said) <= self.allowed

    @property
    def visible(self) -> bool:
        """Whether the record shows a cause well enough that an answer is asked for."""
        return self.group in NAMEABLE and self.ratio > VISIBLE

    @property
    def right_first(self) -> bool:
        """Whether the first name is right."""
        return bool(self.said) and self.said[0] in self.allowed

    def held(self) -> list[bool]:
        """For each value of a rightly named cause with a counterpart: is it in its interval?"""
        if self.effect not in self.said:
            return []
        intervals = self.intervals[self.said.index(self.effect)]
        pairs = [(self.truth[n], intervals[n]) for n in self.truth if n in intervals]
        return [bool(low <= value <= high) for value, (low, high) in pairs]


def plan_trials(
    each: int,
    first_seed: int,
    worlds: tuple[str, ...] = tuple(WORLDS),
    at_least: tuple[int, int] = (0, 0),
) -> list[Trial]:
    """The trials, those of all worlds and effects side by side.

    Parameters
    ----------
    each : int
        Records of every cause in every world; ten times as many faultless ones, and four for
        every five of each effect outside the catalogue.
    first_seed : int
    worlds : tuple of str
    at_least : tuple of int
        Faultless records of every world, and records with effects, as evenly of each effect as it
        goes.
    """
    placed = []
    for world in worlds:
        causes, outside, signals = effects_of(world)
        kinds = [(CAUSE, name, each) for name in causes]
        kinds += [(OUTSIDE, name, -(-4 * each // 5)) for name in outside]
        kinds += [(SIGNAL, name, each) for name in signals]
        missing = max(at_least[1] - sum(count for *_, count in kinds), 0)
        share, rest = divmod(missing, len(kinds))
        kinds = [(*kind, n + share + (k < rest)) for k, (*kind, n) in enumerate(kinds)]
        kinds.insert(0, (FAULTLESS, "", max(FAULTLESS_EACH * each, at_least[0])))
        for kind, (group, name, count) in enumerate(kinds):
            for k in range(count):
                trial = Trial(world, group, name, first_seed + k)
                placed.append(((k + 0.5) / count, kind, trial))
    return [trial for *_, trial in sorted(placed, key=lambda p: p[:2])]


def run_trial(trial: Trial) -> Row:
    """Draw, write, diagnose."""
    try:
        case = draw_case(trial.world, (trial.effect,) if trial.effect else (), trial.seed)
    except Unusable as reason:
        return _row(trial, None, UNUSABLE, [], None, [], 0.0, str(reason))
    # here, so that the truth can be drawn where there is no estimator
    from ballscrew.diagnosis.diagnose import diagnose

    verdict, causes, evidence, kind, message = FAILED, [], None, [], ""
    with tempfile.TemporaryDirectory() as folder:
        records, prior_model = write_case(case, Path(folder))
        started = time.process_time()
        try:
            found = diagnose(records, params=prior_model)
            verdict = str(found.verdict)
            causes = [(str(c.name), dict(c.parameters), dict(c.intervals)) for c in found.causes]
            evidence, kind = float(found.evidence), [float(one) for one in found.kind]
        except ValueError as reason:  # what is said of input that cannot be used
            verdict, message = REFUSED, str(reason).strip().splitlines()[-1]
        except Exception:  # a crash; counted, and the others go on
            message = traceback.format_exc().strip().splitlines()[-1]
        seconds = time.process_time() - started
    return _row(trial, case, verdict, causes, evidence, kind, seconds, message)


def _row(
    trial: Trial,
    case: Case | None,
    verdict: str,
    causes: list[tuple[str, dict[str, float], dict[str, tuple[float, float]]]],
    evidence: float | None,
    kind: list[float],
    seconds: float,
    message: str,
) -> Row:
    effect = case.effects[0] if case and case.effects else None
    sight = case.sights[0] if case and case.sights else None
    numbers = [
        {n: float(v) for n, v in values.items() if isinstance(v, int | float)}
        for _, values, _ in causes
    ]
    return Row(
        key=trial.key,
        world=trial.world,
        group=trial.group,
        effect=trial.effect,
        form=effect.form if effect else "",
        seed=trial.seed,
        ratio=sight.ratio if sight else 0.0,
        shared=list(sight.shared) if sight else [],
        truth=effect.truth if effect else {},
        conditions=conditions_of(case) if case else {},
        wrong_values=case.wrong if case else {},
        verdict=verdict,
        named=[name for name, _, _ in causes],
        values=numbers,
        intervals=[
            {n: (float(low), float(high)) for n, (low, high) in bounds.items()}
            for _, _, bounds in causes
        ],
        evidence=evidence,
        kind=kind,
        seconds=seconds,
        message=message,
    )


def conditions_of(case: Case) -> dict[str, str | float]:
    """What else is in a record, for the tables of a report."""
    c, i = case.conditions, case.instruments
    return {
        "law": case.law,
        "loop": c.loop,
        "excitation": c.excitation,
        "command": c.command,
        "encoder": i.encoder,
        "current": i.current,
        "noise": c.noise,
        "noise_size": c.noise_size,
        "sampling": c.sampling,
        "duration": c.duration,
        "jitter": c.jitter,
        "resampled": c.resampled,
        "records": len(case.records),
    }

"""Sentences and numbers of the report."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .diagnosis import (
    EXPLAINED,
    NONE,
    PARTLY,
    UNDECIDED,
    Diagnosis,
    Level,
    SuspectFound,
    holds,
    names_of,
)

_SCALED = {"scale_of_u": "command", "scale_of_i": "current", "scale_of_x": "position"}
_TIMES = 2.0  # shares of friction above this are written as multiples
_FEW = 3  # suspects that a sentence lists
DOES_NOT_HOLD = (
    "The result is not confirmed on held-out data: there it may be worse than the adjusted "
    "model. Do not rely on it."
)


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one paragraph."""
    certain = [c for c in diagnosis.causes if c.certain]
    likeliest = [c for c in diagnosis.causes if not c.certain]
    explain = "explain" if len(certain) > 1 else "explains"
    named = f"{names_of(certain)} {explain}"
    lives = " and ".join(diagnosis.unnamed)
    left, floor = diagnosis.final_residual.force, diagnosis.floor.force
    unseen = f"a fault up to {percent(diagnosis.unseen)} of the friction would not be seen"
    suspects = suspicion_sentence(diagnosis.suspects)
    if diagnosis.verdict == NONE:
        return (
            f"These records show no error of the model: with values within their tolerances "
            f"{left:.3g} N are left, with a noise of {floor:.3g} N; {unseen}."
        )
    if diagnosis.alternatives:
        return _either(diagnosis)
    if diagnosis.verdict == UNDECIDED:
        return f"{unseen}.{_built_in(likeliest)}{suspects}"
    if diagnosis.verdict == EXPLAINED:
        names, one = names_of(diagnosis.causes), len(diagnosis.causes) == 1
        return (
            f"{names} explain{'s' if one else ''} the error of the model; the rest is noise."
            f"{scale_sentence(diagnosis.causes)}"
        )
    if diagnosis.verdict == PARTLY and diagnosis.unnamed:
        return (
            f"{named} part of the error of the model; the rest has no "
            f"cause in the catalogue: it varies {lives}.{scale_sentence(certain)}"
            f"{_built_in(likeliest)}"
        )
    if diagnosis.verdict == PARTLY and does_not_hold(diagnosis):
        return (
            f"{named} the data best, but this is not confirmed: on held-out data the model may "
            "be worse."
        )
    if diagnosis.verdict == PARTLY:
        return (
            f"{named} part of the error of the model: on held-out data {left:.3g} N of "
            f"{diagnosis.adjusted_residual.force:.3g} N remain, with a noise of {floor:.3g} N; "
            f"{unseen}.{scale_sentence(certain)}{_built_in(likeliest)}{suspects}"
        )
    lives = f" It varies {lives}." if lives else ""
    return (
        f"{percent(diagnosis.left_of_friction)} of the friction is unexplained, and no "
        f"cause is certain: {left:.3g} N on held-out data, "
        f"with a noise of {floor:.3g} N.{lives}{_built_in(likeliest)}{suspects}"
    )


def _either(diagnosis: Diagnosis) -> str:
    """The causes with their alternatives, each with its size."""
    sizes = {s.name: _sized(s) for s in (*diagnosis.causes, *diagnosis.suspects)}
    ways = []
    for cause in diagnosis.causes:
        others = [sizes.get(n, n) for n in diagnosis.alternatives.get(cause.name, ())]
        ways.append(" or ".join([sizes[cause.name], *others]))
    return (
        f"{' and '.join(ways)} explain the error of the model: the rest is noise, and these "
        "records cannot tell which."
    )


def _sized(suspect: SuspectFound) -> str:
    """A suspect with its first size."""
    for name, value in suspect.parameters.items():
        unit = suspect.units.get(name, "")
        return f"{suspect.name} ({name} {value:.3g}{'' if unit in ('', '1') else f' {unit}'})"
    return suspect.name


SET = (
    "for records like those of the calibration, the true cause is among these and the named ones "
    "in 95 of 100 cases; for "
    "other records the share is not known"
)
NAMED = "for records like those of the calibration, at most 2 of 100 get a wrong name"


def suspect_lines(suspects: Sequence[SuspectFound]) -> list[str]:
    """The set of suspects, for a terminal."""
    if not suspects:
        return []
    lines = [f"suspects ({SET}):"]
    for s in suspects:
        lines.append(
            f"  {s.name}: {s.says}; {s.force:.3g} N rms, {of_friction(s.of_friction)}; "
            f"probability {s.probability:.2f}"
        )
        for name, (low, high) in s.intervals.items():
            unit = f" {s.units[name]}" if s.units[name] not in ("", "1") else ""
            lines.append(f"    {name} = {s.parameters[name]:.4g}{unit}  {low:.4g} .. {high:.4g}")
    return lines


def suspicion_sentence(suspects: Sequence[SuspectFound]) -> str:
    """The set of suspects in a sentence; empty without one."""
    if not suspects:
        return ""
    names = [s.name.replace("_", " ") for s in suspects]
    if len(names) == 1:
        said = f" The suspect is {names[0]}."
    elif len(names) > _FEW:
        said = f" There are {len(names)} suspects, the most probable {names[0]}."
    else:
        said = f" It is one of {', '.join(names[:-1])} or {names[-1]}."
    return said + scale_sentence(suspects[:1])


def _built_in(likeliest: Sequence[SuspectFound]) -> str:
    """The included causes that are not certain, in a sentence; empty without any."""
    if not likeliest:
        return ""
    verb = "are" if len(likeliest) > 1 else "is"
    said = f" The most probable one, {names_of(likeliest)}, {verb} built in."
    return said + scale_sentence(likeliest)


def scale_sentence(found: Sequence[SuspectFound]) -> str:
    """Sentence on the factor by which a signal fits, if a wrong scale was found."""
    return "".join(
        f" The {_SCALED[s.name]} fits with a factor of {s.parameters[s.name]:.3g}: check its unit."
        for s in found
        if s.name in _SCALED
    )


def of_friction(share: float) -> str:
    """A force as a share of friction, as text."""
    if share < _TIMES:
        return f"{percent(share)} of the friction"
    return f"{share:.3g} times the friction"


def does_not_hold(diagnosis: Diagnosis) -> bool:
    """Whether the corrected model may be worse on held-out data than the model without it."""
    found = bool(diagnosis.causes or diagnosis.unnamed)
    levels = diagnosis.adjusted_residual, diagnosis.final_residual
    return found and not holds(diagnosis.gain_interval, *levels)


def length(metres: float | None) -> str:
    """A length as text, with a suitable unit."""
    if metres is None:
        return "-"
    size = abs(metres)
    if size >= 1e-1:
        return f"{metres:.3g} m"
    return f"{1e3 * metres:.3g} mm" if size >= 1e-4 else f"{1e6 * metres:.3g} µm"


def interval(low: float, high: float) -> str:
    """An interval as text, for tables."""
    return f"{low:.4g} to {high:.4g}"


def micro(text: str) -> str:
    """A sentence for terminals, with the micro sign for a page."""
    return re.sub(r"\bum\b", "µm", text)


def sentence_for_page(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def times(value: float | None, floor: float | None) -> str:
    return f"{value / floor:.3g}" if value is not None and floor else "-"


def percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def as_share(before: Level, after: Level) -> float:
    """Share of the mean square that goes in position; zero if it is not known."""
    if not before.position or after.position is None:
        return 0.0
    return 1.0 - (after.position / before.position) ** 2

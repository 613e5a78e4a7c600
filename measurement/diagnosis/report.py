"""The report of a diagnosis: its sentence and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ...orchestration.loop.shown import Table, length
from .causes import OUTSIDE
from .diagnosis import Diagnosis, Finding
from .experiment import COMMAND_FILE

WORDS = {
    "none": "no fault seen",
    "explained": "cause found",
    "partly": "partly explained",
    "unexplained": "cause not found",
    "undecided": "cannot tell",
}
"""Verdicts for a person."""

_SCALED = {"scale_of_u": "command", "scale_of_i": "current", "scale_of_x": "position"}
_TIMES = 2.0  # shares of friction above this are written as multiples
_FEW = 3  # suspects that a sentence lists
_NOT_SHOWN = 1e-9  # relative change below which a value counts as unchanged
_KINDS = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
_NOISE = {"force_N": "noise in the force", "voltage_N": "noise in the voltage, as a force"}


# -- the sentence ----------------------------------------------------------------------------


def verdict_sentence(d: Diagnosis) -> str:
    """What is wrong in newtons and per cent, by which cause, and what is not known."""
    names = " and ".join(_either(d, c) for c in d.causes)
    begin, fitted, left = (
        level.force for level in (d.baseline_residual, d.adjusted_residual, d.final_residual)
    )
    built = "this cause" if len(d.causes) == 1 else "these causes"
    said = [f"{names}."] if names else []
    said.append(
        f"The model's force is wrong by {begin:.3g} N rms, {of_friction(begin / d.friction)}; "
        + (f"with {built} by {left:.3g} N" if names else f"with adjusted values by {fitted:.3g} N")
        + f"; noise alone makes {d.floor.force:.3g} N."
    )
    if any(d.alternatives.values()):
        said.append("These records cannot tell which.")
    elif doubtful := [c.name for c in d.causes if not c.certain]:
        said.append(f"Not certain: {', '.join(doubtful)}.")
    said += [f"What is left varies {lives}; no known cause does this." for lives in d.unnamed]
    others = {n for names in d.alternatives.values() for n in names}
    if possible := [s.name for s in d.suspects if s.name not in (*others, OUTSIDE)]:
        more = f" or {len(possible) - _FEW} more" if len(possible) > _FEW else ""
        said.append(f"It may {'also ' * bool(names)}be {', '.join(possible[:_FEW])}{more}.")
    said += [
        f"The {_SCALED[s.name]} fits with a factor of {s.parameters[s.name]:.3g}: check its unit."
        for s in (*d.causes, *d.suspects)[: max(len(d.causes), 1)]
        if s.name in _SCALED
    ]
    if not d.confirmed:
        said.append("This is not confirmed on held-out data: do not rely on it.")
    elif d.verdict in ("none", "undecided", "partly"):
        said.append(f"A fault up to {of_friction(d.unseen)} would not be seen.")
    return " ".join(said)


def _either(d: Diagnosis, cause: Finding) -> str:
    """A cause, or the causes that explain as much in its place, each with its first size."""
    found = {s.name: s for s in (*d.suspects, *d.causes)}
    words = []
    for name in (cause.name, *d.alternatives.get(cause.name, cause.alike)):
        size = _first_size(found[name]) if name in found else ""
        words.append(f"{name} ({size})" if size else name)
    return " or ".join(words)


def _first_size(found: Finding) -> str:
    """The first size; of waves, the largest amplitude of a cosine and its sine."""
    values = found.parameters
    pairs = [(n, n.replace("_cos", "_sin")) for n in values if "_cos" in n]
    waves = {n: math.hypot(values[n], values[s]) for n, s in pairs if s in values}
    if not waves:
        return next((_size(found, name, value) for name, value in values.items()), "")
    name = max(waves, key=lambda n: waves[n])
    return _size(found, name, waves[name]).replace(name, "amplitude")


def _size(found: Finding, name: str, value: float) -> str:
    unit = found.units.get(name, "")
    return f"{name} = {value:.4g} {'' if unit == '1' else unit}".rstrip()


def _sizes(found: Finding) -> list[str]:
    """Sizes with their units and 95 % intervals."""
    words = []
    for name, value in found.parameters.items():
        words.append(_size(found, name, value))
        if name in found.intervals:
            low, high = found.intervals[name]
            words[-1] += f" ({low:.4g} to {high:.4g})"
    return words


def of_friction(share: float) -> str:
    """A force as a share of the friction, as text."""
    if share < _TIMES:
        return f"{percent(share)} of the friction"
    return f"{share:.3g} times the friction"


def percent(share: float) -> str:
    return f"{100 * share:.3g} %"


# -- the tables ------------------------------------------------------------------------------


def tables_of(d: Diagnosis) -> list[Table]:
    """Errors before and after, causes, what they are, what to do, values, and the records."""
    return [_before_and_after(d), *_causes(d), *_next_experiment(d), _values(d), _about(d)]


def _before_and_after(d: Diagnosis) -> Table:
    levels = (
        ("your model", d.baseline_residual),
        ("with values within their tolerances *", d.adjusted_residual),
        *([("with the causes found *", d.final_residual)] if d.causes else []),
        ("noise alone", d.floor),
    )
    rows = [
        (
            name,
            f"{level.force:.4g} N",
            percent(level.force / d.friction),
            "-" if level.position is None else length(level.position),
        )
        for name, level in levels
    ]
    says = "* On data that neither the choice nor the fit has seen."
    if d.causes:
        low, high = map(percent, d.gain_interval)
        says += f" Of the squares there, the causes remove {low} to {high} (90 %)."
    columns = ("error, rms", "force", "of the friction", "position after up to 1 s")
    return Table("Before and after", columns, rows, says=says)


def _causes(d: Diagnosis) -> Iterator[Table]:
    """A row for each size of each cause, and what the causes are."""
    found: Sequence[Finding] = (*d.causes, *d.suspects)
    if not found:
        return
    rows = []
    for c in found:
        kept, removes = "possible", ""
        if c in d.causes:
            kept = "named" if c.certain else "built in, not certain"
            low, high = map(percent, c.gain_interval)
            removes = f"{percent(c.gain_heldout)} ({low} to {high})"
        force = (
            f"{c.force:.3g} N",
            percent(c.of_friction),
            removes,
            f"{c.score:.0f}, {c.lead:.0f}",
        )
        first, *others = _sizes(c) or ["-"]
        rows += [(c.name, kept, first, *force), *(("", "", more, *[""] * 4) for more in others)]
    columns = ("cause", "", "size (95 %)", "force, rms", "of the friction")
    yield Table("Causes", (*columns, "removes, held out (90 %)", "score, lead"), rows)
    said = [(c.name, c.says, c.confirm) for c in found]
    yield Table("What they are", ("cause", "what it does", "would confirm it"), said)


def _next_experiment(d: Diagnosis) -> Iterator[Table]:
    if d.next_experiment:
        rows = [("motion", d.next_experiment.motion["says"]), ("commands", COMMAND_FILE)]
        text = d.next_experiment.says
        yield Table("Do next", ("", ""), rows, says=f"{text[:1].upper()}{text[1:]}.")


def _values(d: Diagnosis) -> Table:
    rows = [
        (
            name,
            f"{d.prior.values[name]:.5g}",
            f"{d.corrected.values[name]:.5g}",
            f"{100 * change:+.2g} %" if abs(change) > _NOT_SHOWN else "0",
            percent(d.prior.tolerance.get(name, 0.0)),
            d.prior.units[name],
        )
        for name, change in d.adjustments.items()
    ]
    columns = ("value", "prior", "adjusted", "change", "tolerance", "unit")
    return Table("Values adjusted", columns, rows)


def _about(d: Diagnosis) -> Table:
    kind = _KINDS.get(d.prior.kind, d.prior.kind)
    if d.prior.turns:
        kind = "rotating body, driven by a torque"
    rows = [("records", ", ".join(d.records)), ("model", kind), ("law", d.prior.law)]
    rows += [(_NOISE.get(name, name), f"{size:.3g} N rms") for name, size in d.noise.items()]
    rows += [("held out", d.held_out), ("computing time", f"{d.seconds:.1f} s")]
    return Table("What was diagnosed", ("", ""), rows)

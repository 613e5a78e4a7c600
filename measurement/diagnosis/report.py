"""What is shown of a diagnosis and of a comparison: sentence, tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...orchestration.loop.pictures import COLOURS, DASHES, styled_figure
from ...orchestration.loop.shown import Table, length, shown_unit
from ...solver.arrays import Mask, Vector
from ..identification.identification_pictures import MOST_POINTS, PARTS
from .causes import OUTSIDE
from .compare import Compared
from .corrected import ends_of_seconds
from .diagnosis import Curves, Diagnosis, Finding
from .experiment import COMMAND_FILE, MOST_NAMED

WORDS = {
    "none": "no fault seen",
    "explained": "cause found",
    "partly": "partly explained",
    "unexplained": "cause not found",
    "undecided": "cannot tell",
}
"""Verdicts for a person."""

_SCALED = {"scale_of_u": "command", "scale_of_i": "current", "scale_of_x": "position"}
_KINDS = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
_MEASURED, _REST = "#000000", "#e8e8e8"
_LEAST_IN_BIN = 20  # samples that count in a part of a signal's range
_NOISE = {"force_N": "noise in the force", "voltage_N": "noise in the voltage, as a force"}


# -- the sentence ----------------------------------------------------------------------------


def verdict_sentence(d: Diagnosis) -> str:
    """What is wrong in newtons and per cent, by which cause, and what is not known."""
    names = " and ".join(_either(d, c) for c in d.causes)
    begin, left = d.baseline_residual.force, (d.final_residual if names else d.adjusted_residual)
    built = ("this cause" if len(d.causes) == 1 else "these causes") if names else "adjusted values"
    said = [f"{names}."] if names else []
    said.append(
        f"The model's force is wrong by {begin:.3g} N rms, {of_friction(begin / d.friction)}; "
        f"with {built} by {left.force:.3g} N; noise alone makes {d.floor.force:.3g} N."
    )
    if any(d.alternatives.values()):
        said.append("These records cannot tell which.")
    elif doubtful := [c.name for c in d.causes if not c.certain]:
        said.append(f"Not certain: {', '.join(doubtful)}.")
    said += [f"What is left varies {lives}; no known cause does this." for lives in d.unnamed]
    others = {n for names in d.alternatives.values() for n in names}
    if possible := [s.name for s in d.suspects if s.name not in (*others, OUTSIDE)]:
        more = f" or {len(possible) - MOST_NAMED} more" if len(possible) > MOST_NAMED else ""
        said.append(f"It may {'also ' * bool(names)}be {', '.join(possible[:MOST_NAMED])}{more}.")
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
    ends = {n: f" ({low:.4g} to {high:.4g})" for n, (low, high) in found.intervals.items()}
    return [_size(found, n, value) + ends.get(n, "") for n, value in found.parameters.items()]


def of_friction(share: float) -> str:
    """A force as a share of the friction, as text."""
    return f"{percent(share)} of the friction" if share < 1.0 else f"{share:.3g} times the friction"


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
    rows = []
    for name, level in levels:
        position = "-" if level.position is None else length(level.position)
        rows.append((name, f"{level.force:.4g} N", percent(level.force / d.friction), position))
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
        score = f"{c.score:.0f}, {c.lead:.0f}"
        force = f"{c.force:.3g} N", percent(c.of_friction), removes, score
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
    rows = []
    for name, change in d.adjustments.items():
        before, after = (f"{model.values[name]:.5g}" for model in (d.prior, d.corrected))
        changed = f"{100 * change:+.2g} %" if after != before else "0"
        tolerance = percent(d.prior.tolerance.get(name, 0.0))
        rows.append((name, before, after, changed, tolerance, d.prior.units[name]))
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


# -- the pictures ----------------------------------------------------------------------------


def diagnosis_figure(d: Diagnosis) -> Any:
    """Mean error of the force before and after, over what it may go with."""
    c = d.curves
    ways = (("forwards", c.v > 0.0, "-"), ("backwards", c.v <= 0.0, "--"))
    with styled_figure(2, 2, (12, 7.5)) as (figure, grid):
        for axes, (name, unit, signal, alike) in zip(grid.flat, _signals(c), strict=True):
            share = 0.0
            axes.sharey(grid[0][0])
            for label, colour, wide, values in (
                ("your model", COLOURS[1], 2.8, c.before),
                ("corrected", COLOURS[0], 1.2, c.after),
            ):
                for way, there, dash in ways:
                    kept = c.telling & there
                    x, y = binned(signal, values, kept, alike)
                    axes.plot(x, y, dash, color=colour, lw=wide, label=f"{label}, {way}")
                    share += _share(signal, c.before, c.telling, kept, x, y) * (values is c.before)
            axes.set_title(f"{100 * share:.0f} % goes with the {name}", loc="left")
            axes.set(xlabel=f"{name} [{unit}]", ylabel="mean error of the force [N]")
        figure.suptitle(f"What the error of the force goes with: {WORDS[d.verdict]}", fontsize=12)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _signals(c: Curves) -> list[tuple[str, str, Vector, bool]]:
    """Name, unit and signal of each panel; whether its parts have equal numbers of samples."""
    steps = np.diff(c.time, prepend=c.time[0])
    again = np.append(True, np.diff(c.record) > 0)
    time = np.cumsum(np.where(again, 0.0, steps))
    turned = again | (np.diff(np.sign(c.v), prepend=np.sign(c.v[0])) != 0.0)
    since = time - np.maximum.accumulate(np.where(turned, time, 0.0))
    return [
        ("position", "mm", 1e3 * c.x, False),
        ("velocity", "mm/s", 1e3 * c.v, True),
        ("time since reversal", "ms", 1e3 * since, True),
        ("time", "s", time, False),
    ]


def _share(signal: Vector, error: Vector, all_: Mask, kept: Mask, x: Vector, y: Vector) -> float:
    """Share of the mean square of an error that its means over a signal have."""
    known = np.isfinite(y)
    if not known.any():
        return 0.0
    whole = float(np.sum(error[all_] ** 2))
    mean = np.interp(signal[kept], x[known], y[known])
    gone = np.sum(error[kept] ** 2) - np.sum((error[kept] - mean) ** 2)
    return max(float(gone) / whole, 0.0) if whole else 0.0


def compare_figure(found: Compared) -> Any:
    """Error of the position and the force over time, and friction over velocity."""
    courses, (first, *_) = found.courses, found.traces.values()
    x, v, rests = (np.concatenate([getattr(c, n) for c in courses]) for n in ("x", "v", "rests"))
    begins = np.cumsum([0.0, *(len(c.x) * c.step for c in courses)])
    time = np.concatenate([c.time + t for c, t in zip(courses, begins, strict=False)])
    last = np.array(ends_of_seconds(courses)[1:-1], dtype=int) - 1  # the state is set anew then
    with styled_figure(1, 3, (18, 5.5)) as (figure, ((off, force, over_velocity),)):
        off.sharex(force)
        figure.suptitle(found.says[0].upper() + found.says[1:], fontsize=12)
        errors = {n: t.predicted - x for n, t in found.traces.items() if not t.why}
        size, unit = shown_unit(np.concatenate([*errors.values(), np.zeros(1)]), "m")
        look = {"color": _MEASURED, "lw": 1.2, "label": "required by the motion"}
        force.plot(time, first.required, **look)
        some = np.flatnonzero(first.counted)
        some = some[:: max(1, len(some) // MOST_POINTS)]
        look = {"ms": 2.5, "color": COLOURS[5], "label": "record, while moving", "rasterized": True}
        over_velocity.plot(1e3 * v[some], first.required[some], ".", **look)
        for k, (name, t) in enumerate(found.traces.items()):
            label = name if name == "model" else f"{name} model"
            style = {"color": COLOURS[(1, 4, 0)[k]], "ls": DASHES[k], "lw": 1.3, "label": label}
            if name in errors:
                errors[name][last] = np.nan
                off.plot(time, size * errors[name], **style)
            of_law = first.required - t.force
            force.plot(time, of_law, **style)
            speed, friction = binned(v, of_law, first.counted, alike=True)
            over_velocity.plot(1e3 * speed, friction, **{**style, "lw": 2.0})
        grey = "; grey: at rest" if rests.any() else ""
        off.set_title("Error of the position, predicted each second", loc="left")
        off.set(ylabel=f"predicted minus measured [{unit}]", xlabel=f"time [s]{grey}")
        force.set_title("Force against the motion", loc="left")
        force.set(ylabel="force [N]", xlabel="time [s]")
        over_velocity.set_title("Friction over velocity", loc="left")
        over_velocity.set(xlabel="velocity [mm/s]", ylabel="friction [N]")
        known = first.required[first.counted if first.counted.any() else ...]  # without jumps
        low, high = known.min(), known.max()
        room = 0.1 * max(high - low, 1e-9)
        force.set_ylim(low - room, high + room)
        over_velocity.sharey(force)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], rests, [0]])))
        for begin, end in zip(time[edges[::2]], time[edges[1::2] - 1], strict=True):
            for axes in (off, force):
                axes.axvspan(begin, end, color=_REST, lw=0, zorder=0)
        known = force.get_legend_handles_labels()
        figure.legend(*known, loc="outside lower left", ncols=4, fontsize=10)
        over_velocity.legend(loc="upper left", fontsize=10)
    return figure


def binned(x: Vector, y: Vector, keep: Mask, alike: bool = False) -> tuple[Vector, Vector]:
    """Means of y over parts of the range of x, NaN for parts with almost no samples.

    The parts have equal width or, with `alike`, equal numbers of samples, for speeds held constant.
    """
    if not np.any(keep) or np.ptp(x[keep]) == 0:
        return np.array([np.nan]), np.array([np.nan])
    if alike:
        order = np.flatnonzero(keep)[np.argsort(x[keep], kind="stable")]
        parts = np.array_split(order, min(2 * PARTS, max(1, len(order) // _LEAST_IN_BIN)))
        return np.array([x[k].mean() for k in parts]), np.array([y[k].mean() for k in parts])
    count, edges = np.histogram(x[keep], PARTS)
    total, _ = np.histogram(x[keep], edges, weights=y[keep])
    mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean

"""A diagnosis as tables, for its page."""

from __future__ import annotations

from collections.abc import Iterator

from ...orchestration.loop.shown import Table
from . import report_words as words
from .causes import CAUSES
from .diagnosis import Diagnosis, FoundCause, SuspectFound
from .experiment_motions import COMMAND_FILE

_NOT_SHOWN = 1e-9  # relative change below which a value counts as unchanged
_KINDS = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
_NOISE = {
    "force_N": ("balance of force, rms", "N"),
    "voltage_N": ("balance of voltage, converted to a force, rms", "N"),
}


def tables_of(diagnosis: Diagnosis) -> list[Table]:
    """Residuals, causes, suspects, the next experiment, adjusted values, noise and records."""
    return [
        _before_and_after(diagnosis),
        *(_cause(c) for c in diagnosis.causes),
        *_suspects(diagnosis),
        *_next_experiment(diagnosis),
        _values(diagnosis),
        _noise(diagnosis),
        _records(diagnosis),
    ]


def _before_and_after(d: Diagnosis) -> Table:
    levels = (
        ("prior model", d.baseline_residual),
        ("values adjusted within tolerance *", d.adjusted_residual),
        ("with all causes found *", d.final_residual),
        ("noise alone (floor)", d.floor),
    )
    rows = [
        (
            name,
            f"{level.force:.4g} N",
            words.times(level.force, d.floor.force),
            words.length(level.position),
            words.times(level.position, d.floor.position),
        )
        for name, level in levels
    ]
    says = "* On data that neither the choice nor the fit has seen."
    says = f"{says} {words.micro(d.where)}".rstrip()
    if words.does_not_hold(d):
        says = f"{words.DOES_NOT_HOLD} {says}"
    elif d.causes or d.unnamed:
        low, high = map(words.percent, d.gain_interval)
        share = words.percent(words.as_share(d.adjusted_residual, d.final_residual))
        says = (
            f"Of the adjusted model's mean square, {low} to {high} (95 %) goes in force and "
            f"{share} in position. {says}"
        )
    columns = ("residual, rms", "force", "times floor", "position over 1 s", "times floor")
    return Table("Before and after", columns, rows, says=says)


def _cause(c: FoundCause) -> Table:
    low, high = map(words.percent, c.gain_interval)
    kept = words.NAMED if c.certain else "not enough for a name"
    others = CAUSES[c.name].mistaken_for if c.name in CAUSES else ()
    rows = [
        *((name, _sized(c, name)) for name in c.parameters),
        (
            "gain on held-out data",
            f"{words.percent(c.gain_heldout)} of the mean square in force ({low} to {high}), "
            f"residual {c.before:.4g} N to {c.after:.4g} N; alone, {words.percent(c.gain_alone)}",
        ),
        ("beside the friction", f"{c.force:.3g} N rms, {words.of_friction(c.of_friction)}"),
        ("how sure", f"probability {c.probability:.2f}; {kept}"),
        ("easily mistaken for, in others", ", ".join(others) or "nothing"),
        ("would confirm it", c.confirm),
    ]
    title = f"Cause: {c.name}{'' if c.certain else ' (most probable, not certain)'}"
    return Table(title, ("", ""), rows, says=c.says)


def _sized(found: SuspectFound, name: str) -> str:
    """A size with its unit and its 95 % interval."""
    unit = found.units.get(name, "")
    ends = found.intervals.get(name)
    value = f"{found.parameters[name]:.4g} {unit}".rstrip()
    return f"{value} ({words.interval(*ends)})" if ends else value


def _suspects(d: Diagnosis) -> Iterator[Table]:
    if not d.suspects:
        return
    columns = ("suspect", "size (95 %)", "force, rms", "beside the friction", "probability")
    rows = [
        (
            s.name,
            "; ".join(f"{name} = {_sized(s, name)}" for name in s.parameters) or "-",
            f"{s.force:.3g} N",
            words.of_friction(s.of_friction),
            f"{s.probability:.2f}",
            s.confirm,
        )
        for s in d.suspects
    ]
    title = "What else it may be" if d.causes else "Suspects"
    says = f"{words.sentence_for_page(words.SET)} A cause among them is built in with --take."
    yield Table(title, (*columns, "would confirm it"), rows, says=says)


def _next_experiment(d: Diagnosis) -> Iterator[Table]:
    if d.next_experiment:
        rows = [("for this machine", d.next_experiment.motion.says), ("commands", COMMAND_FILE)]
        says = words.sentence_for_page(d.next_experiment.says)
        yield Table("Next experiment", ("", ""), rows, says=says)


def _values(d: Diagnosis) -> Table:
    rows = [
        (
            name,
            f"{d.prior.values[name]:.5g}",
            f"{d.corrected.values[name]:.5g}",
            f"{100 * change:+.2g} %" if abs(change) > _NOT_SHOWN else "0",
            words.percent(d.prior.tolerance.get(name, 0.0)),
            d.prior.units[name],
        )
        for name, change in d.adjustments.items()
    ]
    columns = ("value", "prior", "adjusted", "change", "tolerance", "unit")
    return Table("Values adjusted", columns, rows)


def _noise(d: Diagnosis) -> Table:
    named = ((*_NOISE.get(key, (key, "")), size) for key, size in d.noise.items())
    return Table("Noise, as found", ("of", "size"), [(n, f"{x:.3g} {u}") for n, u, x in named])


def _records(d: Diagnosis) -> Table:
    kind = _KINDS.get(d.prior.kind, d.prior.kind)
    if d.prior.turns:
        kind = "rotating body, driven by a torque"
    rows = [("records", ", ".join(d.records)), ("model", kind), ("law", d.prior.law)]
    return Table("What was diagnosed", ("", ""), [*rows, ("time", f"{d.seconds:.1f} s")])

"""A diagnosis as one page that opens without a network, for an engineer who has five minutes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..solver.files import write_atomically
from .causes import CAUSES
from .closed_loop_effect import CONTROLLER, SETPOINT, STOP, ClosedLoopEffect, LoopCourse
from .diagnosis import NONE, Diagnosis, FoundCause, Level, names_of
from .diagnosis_pictures import pictures_of, pictures_of_loop
from .experiment_motions import COMMAND_FILE
from .found_cause import UNITS
from .load_cell import ValidationSignal
from .page_pictures import drawn
from .report_style import SCRIPT, STYLE
from .report_words import (
    DOES_NOT_HOLD,
    as_share,
    as_text,
    does_not_hold,
    interval,
    length,
    micro,
    percent,
    rig_command,
    sentence_for_page,
    times,
    verdict_sentence,
)

REPORT = "report.html"
_NOT_SHOWN = 1e-9  # relative change of a value that is the prior one


@dataclass(frozen=True)
class ClosedLoopSection:
    """What the page says of the closed loop: its effect, or why there is none to show."""

    effect: ClosedLoopEffect | None
    because: str = ""


def save_report(diagnosis: Diagnosis, closed_loop: ClosedLoopSection, folder: Path) -> None:
    """Write ``report.html``.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    write_atomically(folder / REPORT, report(diagnosis, closed_loop).encode())


def report(diagnosis: Diagnosis, closed_loop: ClosedLoopSection) -> str:
    """The page as text."""
    body = "\n".join(
        [
            f'<header><p class="verdict {diagnosis.verdict}">{diagnosis.verdict}</p>'
            f"<h1>{as_text(verdict_sentence(diagnosis))}</h1>"
            f"<p>{as_text(micro(diagnosis.where))}</p></header>",
            _levels(diagnosis),
            _causes(diagnosis),
            _pictures(diagnosis),
            _closed_loop(closed_loop),
            _next_experiment(diagnosis),
            _not_named(diagnosis),
            _out_of_reach(diagnosis),
            _adjusted(diagnosis),
            _noise(diagnosis),
            _warnings(diagnosis),
            _footer(diagnosis),
        ]
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Diagnosis: {as_text(diagnosis.verdict)}, {as_text(names_of(diagnosis.causes))}</title>
<link rel="icon" href="data:,">
<style>{STYLE}</style>
</head>
<body>
<main>
{body}
</main>
<script>{SCRIPT}</script>
</body>
</html>
"""


def _section(title: str, *parts: str) -> str:
    inside = "\n".join(p for p in parts if p)
    return f"<section><h2>{as_text(title)}</h2>\n{inside}\n</section>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names its rows; cells are text."""
    top = "".join(f'<th scope="col">{as_text(h)}</th>' for h in head)
    lines = "\n".join(
        f'<tr><th scope="row">{as_text(row[0])}</th>'
        + "".join(f"<td>{as_text(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>\n{lines}\n'
        "</tbody></table></div>"
    )


def _levels(diagnosis: Diagnosis) -> str:
    floor = diagnosis.floor

    def row(name: str, level: Level) -> list[str]:
        return [
            name,
            f"{level.force:.4g} N",
            times(level.force, floor.force),
            length(level.position),
            times(level.position, floor.position),
        ]

    low, high = diagnosis.gain_interval
    rows = [
        row("prior model", diagnosis.baseline_residual),
        row("values adjusted within tolerance *", diagnosis.adjusted_residual),
        row("with everything that was found *", diagnosis.final_residual),
        row("noise alone (floor)", floor),
    ]
    adjusted, final = diagnosis.adjusted_residual, diagnosis.final_residual
    gain = ""
    if does_not_hold(diagnosis):
        gain = f"{DOES_NOT_HOLD} "
    elif diagnosis.verdict != NONE:
        gain = (
            f"Of the adjusted model's mean square, {percent(low)} to {percent(high)} (95 %) goes "
            f"in force and {percent(as_share(adjusted, final))} in position. "
        )
    return _section(
        "Before and after",
        _table(["residual, rms", "force", "times floor", "position over 1 s", "times floor"], rows),
        f'<p class="small">{gain}* On data that neither the choice nor the fit has seen.</p>',
        _load_cell(diagnosis.load_cell),
    )


def _load_cell(found: ValidationSignal | None) -> str:
    if found is None:
        return ""
    return (
        "<p>The load cell, which took no part in this, is off the prediction of the prior model "
        f"by {found.prior:.3g} N rms, and off that of the corrected one by {found.corrected:.3g} N."
        "</p>"
    )


def _causes(diagnosis: Diagnosis) -> str:
    if not diagnosis.causes:
        return _section("Causes", "<p>None is named.</p>")
    return _section("Causes, in order of gain", *(_cause(c) for c in diagnosis.causes))


def _cause(c: FoundCause) -> str:
    low, high = c.gain_interval
    rows = [
        [n, f"{v:.4g}", interval(*c.intervals[n]) if n in c.intervals else "-", c.units.get(n, "")]
        for n, v in c.parameters.items()
    ]
    usual = CAUSES[c.name].mistaken_for
    facts = {
        "gain on held-out data": f"{percent(c.gain_heldout)} of the mean square in force "
        f"({percent(low)} to {percent(high)}), "
        f"{percent(as_share(c.before, c.after))} in position; "
        f"residual {c.before.force:.4g} N to {c.after.force:.4g} N, "
        f"{length(c.before.position)} to {length(c.after.position)}; "
        f"alone, {percent(c.gain_alone)} in force",
        "how sure": f"logarithm of the odds {c.evidence:.3g}, p = {c.p_value:.2g}: "
        "the share of like faultless records with as much",
        "easily mistaken for, in others": ", ".join(usual) or "nothing",
        "would confirm it": c.confirm,
    }
    return (
        f'<article><h3>{as_text(c.name)}</h3><p class="says">{as_text(c.says)}</p>'
        + _table(["size", "value", "95 % interval", "unit"], rows)
        + _facts(facts)
        + "</article>"
    )


def _facts(facts: Mapping[str, str]) -> str:
    inside = "".join(f"<dt>{as_text(n)}</dt><dd>{as_text(v)}</dd>" for n, v in facts.items())
    return f"<dl>{inside}</dl>"


def _pictures(diagnosis: Diagnosis) -> str:
    return _section(
        "Pictures",
        '<p class="small">Wheel: zoom (with Shift across only). Drag: move. Double click: back. '
        "Long records are thinned; every peak is kept. Curves are of the fit to all data; the "
        "table is of data held out.</p>",
        *(drawn(p) for p in pictures_of(diagnosis)),
    )


def _closed_loop(section: ClosedLoopSection) -> str:
    effect = section.effect
    if effect is None:
        return _section("In a closed loop", f"<p>{as_text(section.because)}</p>")

    def row(name: str, loop: LoopCourse) -> list[str]:
        return [
            name,
            "-" if loop.settling is None else f"{loop.settling:.3f} s",
            length(loop.overshoot),
            length(loop.error),
            f"{loop.peak:.3g} V",
            loop.becomes,
            "-" if loop.slowest is None else f"{loop.slowest:.4g} 1/s",
        ]

    head = ["plant", "settling (2 %)", "overshoot", "error at the end", "peak command"]
    return _section(
        "In a closed loop",
        f"<p>{as_text(micro(sentence_for_page(effect.says)))}</p>",
        _table(
            [*head, "its motion becomes", "slowest eigenvalue"],
            [row("prior model", effect.prior), row("with the causes", effect.extended)],
        ),
        f'<p class="small">{CONTROLLER} with its default gains, a step to {length(SETPOINT)}, '
        f"{STOP:g} s, plant and controller in one solver.</p>",
        "<details><summary>What the stability verdicts rest on</summary>"
        f"<p>Prior model: {as_text(effect.prior.evidence)}.</p>"
        f"<p>With the causes: {as_text(effect.extended.evidence)}.</p></details>",
        *(drawn(p) for p in pictures_of_loop(effect)),
    )


def _next_experiment(diagnosis: Diagnosis) -> str:
    wanted = diagnosis.next_experiment
    if wanted is None:
        return _section(
            "Next experiment", "<p>None is needed to tell what was found from anything else.</p>"
        )
    return _section(
        "Next experiment",
        f"<p>{as_text(sentence_for_page(wanted.says))}</p>",
        f"<p>For this machine: {as_text(wanted.motion.says)}. Command file: "
        f"<code>{COMMAND_FILE}</code></p>",
        f"<p>On the virtual rig: <code>{as_text(rig_command(wanted.trial))}</code></p>",
    )


def _not_named(diagnosis: Diagnosis) -> str:
    if not diagnosis.not_named:
        return ""
    rows = [[n.name, n.because] for n in diagnosis.not_named]
    return f"<h2>Looked at and not named</h2>{_table(['cause', 'why not'], rows)}"


def _out_of_reach(diagnosis: Diagnosis) -> str:
    if not diagnosis.out_of_reach:
        text = "<p>Any cause of the catalogue would have shown at a twentieth of the friction.</p>"
        return _section("What these records could not have shown", text)
    rows = [[o.name, o.because] for o in diagnosis.out_of_reach]
    return _section("What these records could not have shown", _table(["cause", "why"], rows))


def _adjusted(diagnosis: Diagnosis) -> str:
    prior, corrected = diagnosis.prior, diagnosis.corrected
    rows = [
        [
            n,
            f"{prior.values[n]:.5g}",
            f"{corrected.values[n]:.5g}",
            f"{100 * change:+.2g} %" if abs(change) > _NOT_SHOWN else "0",
            f"{100 * prior.tolerance.get(n, 0.0):.3g} %",
            UNITS.get(n, UNITS.get(n.partition("_")[0], "")),
        ]
        for n, change in diagnosis.adjustments.items()
    ]
    head = ["value", "prior", "adjusted", "change", "tolerance", "unit"]
    return _section("Values adjusted", _table(head, rows))


def _noise(diagnosis: Diagnosis) -> str:
    names = {
        "unmodelled_force_N": ("force that no model has, rms", "N"),
        "position_m": ("position", "m"),
        "current_A": ("current", "A"),
    }
    rows = []
    for key, value in diagnosis.noise.items():
        label, unit = names.get(key, (key, ""))
        rows.append([label, f"{value:.3g}", unit])
    return _section("Noise, as found", _table(["of", "size", "unit"], rows))


def _warnings(diagnosis: Diagnosis) -> str:
    if not diagnosis.notes:
        return ""
    items = "".join(f"<li>{as_text(n)}</li>" for n in diagnosis.notes)
    return _section("Warnings", f"<ul>{items}</ul>")


def _footer(diagnosis: Diagnosis) -> str:
    from .. import __version__

    kind = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
    model = f"{kind.get(diagnosis.prior.kind, diagnosis.prior.kind)}, {diagnosis.prior.law}"
    records = ", ".join(diagnosis.records)
    return (
        f"<footer>Records: {as_text(records)}. Model: {as_text(model)}. Diagnosed in "
        f"{diagnosis.seconds:.1f} s by ballscrew {as_text(__version__)}.</footer>"
    )

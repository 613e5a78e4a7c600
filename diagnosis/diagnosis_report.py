"""A diagnosis as one page that opens without a network, for an engineer who has five minutes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from ..solver.files import write_atomically
from .causes import CAUSES
from .closed_loop_effect import CONTROLLER, SETPOINT, STOP, ClosedLoopEffect, LoopCourse
from .diagnose import UNITS
from .diagnosis import EXPLAINED, NONE, PARTLY, Diagnosis, FoundCause, Level, holds, names_of
from .diagnosis_pictures import drawn, pictures_of, pictures_of_loop
from .load_cell import Witness
from .next_experiment import COMMAND_FILE

REPORT = "report.html"
DOES_NOT_HOLD = (
    "What was found does not hold on data held out: there it may be worse than the adjusted model, "
    "and must not be relied on."
)
_NOT_SHOWN = 1e-9  # relative change of a value that is as believed


@dataclass(frozen=True)
class ClosedLoopSection:
    """What the page says of the closed loop: its effect, or why there is none to show."""

    effect: ClosedLoopEffect | None
    because: str = ""


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict, for a reader who reads nothing else."""
    explain = "explain" if len(diagnosis.causes) > 1 else "explains"
    named = f"{names_of(diagnosis.causes)} {explain}"
    lives = " and ".join(diagnosis.unnamed)
    if diagnosis.verdict == NONE:
        return (
            "Nothing is wrong with the model that these records could show: noise, and values "
            "within their tolerances, explain what it leaves."
        )
    if diagnosis.verdict == EXPLAINED:
        return f"{named} what the model gets wrong; no structure beyond noise is left."
    if diagnosis.verdict == PARTLY and diagnosis.unnamed:
        return (
            f"{named} part of what the model gets wrong; structure is left that no cause "
            f"of the catalogue has: it lives {lives}."
        )
    if diagnosis.verdict == PARTLY and does_not_hold(diagnosis):
        return f"{named} the data best, and this does not hold: on data held out it may be worse."
    if diagnosis.verdict == PARTLY:
        return (
            f"{named} part of what the model gets wrong: on data held out "
            f"{diagnosis.final_residual.force:.3g} N of "
            f"{diagnosis.adjusted_residual.force:.3g} N is left, more than the "
            f"{diagnosis.floor.force:.3g} N that is noise."
        )
    return (
        "The model gets something wrong that no cause of the catalogue explains; the structure "
        f"lives {lives}."
    )


def does_not_hold(diagnosis: Diagnosis) -> bool:
    """Whether, on data held out, what was found may be worse than the model without it."""
    found = bool(diagnosis.causes or diagnosis.unnamed)
    levels = diagnosis.adjusted_residual, diagnosis.final_residual
    return found and not holds(diagnosis.gain_interval, *levels)


def rig_command(trial: str) -> str:
    """The command that makes a trial on the virtual rig."""
    return f"ballscrew rig {trial} --out out/next"


def length(metres: float) -> str:
    """A length with a unit that suits it."""
    size = abs(metres)
    if size >= 1e-1:
        return f"{metres:.3g} m"
    return f"{1e3 * metres:.3g} mm" if size >= 1e-4 else f"{1e6 * metres:.3g} µm"


def interval(low: float, high: float) -> str:
    """An interval, for tables."""
    return f"{low:.4g} to {high:.4g}"


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
            f"<h1>{_text(verdict_sentence(diagnosis))}</h1>"
            f"<p>{_text(_micro(diagnosis.where))}</p></header>",
            _levels(diagnosis),
            _causes(diagnosis),
            _pictures(diagnosis),
            _closed_loop(closed_loop),
            _next_experiment(diagnosis),
            _not_named(diagnosis),
            _out_of_reach(diagnosis),
            _adjusted(diagnosis),
            _noise(diagnosis),
            _doubts(diagnosis),
            _footer(diagnosis),
        ]
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Diagnosis: {_text(diagnosis.verdict)}, {_text(names_of(diagnosis.causes))}</title>
<link rel="icon" href="data:,">
<style>{_STYLE}</style>
</head>
<body>
<main>
{body}
</main>
<script>{_SCRIPT}</script>
</body>
</html>
"""


def _text(value: str) -> str:
    return escape(value)


def _micro(text: str) -> str:
    """A sentence made for terminals, with the sign for a page."""
    return re.sub(r"\bum\b", "µm", text)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _section(title: str, *parts: str) -> str:
    inside = "\n".join(p for p in parts if p)
    return f"<section><h2>{_text(title)}</h2>\n{inside}\n</section>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names its rows; cells are text."""
    top = "".join(f'<th scope="col">{_text(h)}</th>' for h in head)
    lines = "\n".join(
        f'<tr><th scope="row">{_text(row[0])}</th>'
        + "".join(f"<td>{_text(cell)}</td>" for cell in row[1:])
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
            _times(level.force, floor.force),
            length(level.position),
            _times(level.position, floor.position),
        ]

    low, high = diagnosis.gain_interval
    rows = [
        row("model as believed", diagnosis.baseline_residual),
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
            f"Of the adjusted model's mean square, {_percent(low)} to {_percent(high)} (95 %) goes "
            f"in force and {_percent(_share(adjusted, final))} in position. "
        )
    return _section(
        "Before and after",
        _table(["residual, rms", "force", "times floor", "position over 1 s", "times floor"], rows),
        f'<p class="small">{gain}* On data that neither the choice nor the fit has seen.</p>',
        _load_cell(diagnosis.load_cell),
    )


def _load_cell(found: Witness | None) -> str:
    if found is None:
        return ""
    return (
        "<p>The load cell, which took no part in this, is off what the model as believed foretells "
        f"by {found.believed:.3g} N rms, and off what the mended one does by {found.mended:.3g} N."
        "</p>"
    )


def _times(value: float, floor: float) -> str:
    return f"{value / floor:.3g}" if floor > 0 else "-"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _share(before: Level, after: Level) -> float:
    return 1.0 - (after.position / before.position) ** 2 if before.position > 0 else 0.0


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
        "gain on held-out data": f"{_percent(c.gain_heldout)} of the mean square in force "
        f"({_percent(low)} to {_percent(high)}), "
        f"{_percent(_share(c.before, c.after))} in position; "
        f"residual {c.before.force:.4g} N to {c.after.force:.4g} N, "
        f"{length(c.before.position)} to {length(c.after.position)}; "
        f"alone, {_percent(c.gain_alone)} in force",
        "how sure": f"logarithm of the odds {c.evidence:.3g}, p = {c.p_value:.2g}: "
        "the share of like faultless records with as much",
        "easily mistaken for, in others": ", ".join(usual) or "nothing",
        "would confirm it": c.confirm,
    }
    return (
        f'<article><h3>{_text(c.name)}</h3><p class="says">{_text(c.says)}</p>'
        + _table(["size", "value", "95 % interval", "unit"], rows)
        + _facts(facts)
        + "</article>"
    )


def _facts(facts: Mapping[str, str]) -> str:
    inside = "".join(f"<dt>{_text(n)}</dt><dd>{_text(v)}</dd>" for n, v in facts.items())
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
        return _section("In a closed loop", f"<p>{_text(section.because)}</p>")

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
        f"<p>{_text(_micro(_sentence(effect.says)))}</p>",
        _table(
            [*head, "its motion becomes", "slowest eigenvalue"],
            [row("as believed", effect.believed), row("with the causes", effect.extended)],
        ),
        f'<p class="small">{CONTROLLER} with its default gains, a step to {length(SETPOINT)}, '
        f"{STOP:g} s, plant and controller in one solver.</p>",
        "<details><summary>What the stability verdicts rest on</summary>"
        f"<p>As believed: {_text(effect.believed.evidence)}.</p>"
        f"<p>With the causes: {_text(effect.extended.evidence)}.</p></details>",
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
        f"<p>{_text(_sentence(wanted.says))}</p>",
        f"<p>For this machine: {_text(wanted.motion.says)}. Command file: "
        f"<code>{COMMAND_FILE}</code></p>",
        f"<p>On the virtual rig: <code>{_text(rig_command(wanted.trial))}</code></p>",
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
    believed, mended = diagnosis.believed, diagnosis.mended
    rows = [
        [
            n,
            f"{believed.values[n]:.5g}",
            f"{mended.values[n]:.5g}",
            f"{100 * change:+.2g} %" if abs(change) > _NOT_SHOWN else "0",
            f"{100 * believed.tolerance.get(n, 0.0):.3g} %",
            UNITS.get(n, UNITS.get(n.partition("_")[0], "")),
        ]
        for n, change in diagnosis.adjustments.items()
    ]
    head = ["value", "believed", "adjusted", "change", "tolerance", "unit"]
    return _section("Values adjusted", _table(head, rows))


def _noise(diagnosis: Diagnosis) -> str:
    names = {
        "unmodelled_force_N": ("force that no model has, rms", "N"),
        "its_memory_s": ("its memory", "s"),
        "position_m": ("position", "m"),
        "current_A": ("current", "A"),
    }
    rows = []
    for key, value in diagnosis.noise.items():
        label, unit = names.get(key, (key, ""))
        rows.append([label, f"{value:.3g}", unit])
    return _section("Noise, as found", _table(["of", "size", "unit"], rows))


def _doubts(diagnosis: Diagnosis) -> str:
    if not diagnosis.notes:
        return ""
    items = "".join(f"<li>{_text(n)}</li>" for n in diagnosis.notes)
    return _section("Doubts", f"<ul>{items}</ul>")


def _footer(diagnosis: Diagnosis) -> str:
    from .. import __version__

    kind = {"ball_screw": "ball screw with a motor", "drive": "drive whose command is a force"}
    model = (
        f"{kind.get(diagnosis.believed.kind, diagnosis.believed.kind)}, {diagnosis.believed.law}"
    )
    records = ", ".join(diagnosis.records)
    return (
        f"<footer>Records: {_text(records)}. Model: {_text(model)}. Diagnosed in "
        f"{diagnosis.seconds:.1f} s by ballscrew {_text(__version__)}.</footer>"
    )


_STYLE = """
:root { --ink: #1a1a1a; --soft: #555; --paper: #fff; --panel: #f5f5f2; --rule: #d8d8d4;
 --before: #d55e00; --after: #0072b2; --cause: #009e73; --shape: #cc79a7; --measured: #777; }
@media (prefers-color-scheme: dark) {
:root { --ink: #ececec; --soft: #b0b0b0; --paper: #161616; --panel: #222; --rule: #3c3c3c;
 --before: #e69f00; --after: #56b4e9; --cause: #19c491; --shape: #e5a3c8; --measured: #999; }
}
@media print {
:root { --ink: #000; --soft: #333; --paper: #fff; --panel: #fff; --rule: #ccc;
 --before: #d55e00; --after: #0072b2; --cause: #009e73; --shape: #cc79a7; --measured: #777; }
figure, article, table { break-inside: avoid; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
 font: 16px/1.5 system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 1.5rem 1.25rem 3rem; }
h1 { font-size: 1.5rem; line-height: 1.3; margin: .4rem 0 .6rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; border-bottom: 1px solid var(--rule); }
h3 { font-size: 1rem; margin: 0; }
p { margin: .4rem 0; max-width: 50rem; }
.small, figcaption, footer { font-size: .875rem; color: var(--soft); }
footer { margin-top: 2.5rem; overflow-wrap: anywhere; }
.verdict { display: inline-block; margin: 0; padding: .1rem .7rem; border-radius: 1rem;
 border: 2px solid var(--after); font-weight: 600; }
.verdict.partly, .verdict.unexplained { border-color: var(--before); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: .6rem 0; font-size: .9375rem; }
th, td { text-align: left; padding: .25rem 1.1rem .25rem 0; vertical-align: top;
 border-bottom: 1px solid var(--rule); font-variant-numeric: tabular-nums; }
thead th { color: var(--soft); font-weight: 600; }
tbody th { font-weight: 500; }
article { background: var(--panel); border-radius: .5rem; padding: .8rem 1rem; margin: .8rem 0; }
.says { font-style: italic; }
dl { display: grid; grid-template-columns: minmax(9rem, 14rem) 1fr; gap: .3rem 1rem;
 margin: .6rem 0; }
dt { color: var(--soft); }
dd { margin: 0; }
code { background: var(--panel); padding: .1rem .4rem; border-radius: .25rem; }
figure { margin: 1.8rem 0; }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; font-size: .875rem; margin: .3rem 0; }
.key { width: 26px; height: 8px; margin-right: .4rem; vertical-align: middle; }
.picture { display: block; width: 100%; height: auto; }
.picture text { font-size: 13px; fill: var(--soft); }
.picture .x, .picture .label { text-anchor: middle; }
.picture .y { text-anchor: end; }
.picture .label { fill: var(--ink); }
.ticks path { stroke: var(--rule); }
.plot { cursor: grab; touch-action: pan-y; }
.plot.held { cursor: grabbing; }
.paper { fill: transparent; }
.plot path, .key path { fill: none; stroke: currentColor; stroke-width: 1.6;
 vector-effect: non-scaling-stroke; stroke-linejoin: round; }
path.before { stroke: var(--before); }
path.after { stroke: var(--after); }
path.cause { stroke: var(--cause); }
path.shape { stroke: var(--shape); }
path.measured { stroke: var(--measured); stroke-opacity: .5; }
.plot path.measured, .key path.measured { stroke-width: 5; }
path.level { stroke: var(--soft); }
.plot path.faint { stroke-width: 1; stroke-opacity: .4; }
.key path.faint { stroke-width: 4; stroke-opacity: .4; }
path.dots, .plot path.dots { stroke-width: 5; stroke-linecap: round; stroke-opacity: .8; }
.key path.dots { stroke-width: 6; stroke-linecap: round; }
path.dashed { stroke-dasharray: 6 4; }
@media (max-width: 40rem) { dl { grid-template-columns: 1fr; } .picture text { font-size: 20px; } }
"""

_SCRIPT = r"""
"use strict";
(() => {
  const UNITS = 1000, SMALLEST = 2;
  const LEFT = 78, TOP = 10, WIDE = 808, HIGH = 268;
  const view = plot => plot.getAttribute("viewBox").split(/\s+/).map(Number);
  const roundNumbers = (low, high, most) => {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map(f => f * power).find(s => s >= raw * (1 - 1e-9));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++)
      found.push([k * step, (k * step).toFixed(digits)]);
    return found;
  };
  const part = (name, attributes, text = "") => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    made.textContent = text;
    return made;
  };
  const drawTicks = (plot, ticks) => {
    const [x, y, w, h] = view(plot), [x0, x1, y0, y1] = plot.dataset.range.split(" ").map(Number);
    const low = [x0 + (x1 - x0) * x / UNITS, y1 - (y1 - y0) * (y + h) / UNITS];
    const high = [x0 + (x1 - x0) * (x + w) / UNITS, y1 - (y1 - y0) * y / UNITS];
    ticks.replaceChildren();
    for (const [value, text] of roundNumbers(low[0], high[0], 9)) {
      const at = LEFT + WIDE * (value - low[0]) / (high[0] - low[0]);
      ticks.append(part("path", {d: `M${at} ${TOP}V${TOP + HIGH}`}),
                   part("text", {class: "x", x: at, y: TOP + HIGH + 17}, text));
    }
    for (const [value, text] of roundNumbers(low[1], high[1], 6)) {
      const at = TOP + HIGH * (high[1] - value) / (high[1] - low[1]);
      ticks.append(part("path", {d: `M${LEFT} ${at}H${LEFT + WIDE}`}),
                   part("text", {class: "y", x: LEFT - 7, y: at + 4}, text));
    }
  };
  const figures = document.querySelectorAll("figure");
  for (const figure of figures) {
    const plot = figure.querySelector(".plot"), ticks = figure.querySelector(".ticks");
    const home = plot.getAttribute("viewBox");
    const show = (x, y, w, h) => {
      x = Math.min(Math.max(x, 0), UNITS - w);
      y = Math.min(Math.max(y, 0), UNITS - h);
      plot.setAttribute("viewBox", [x, y, w, h].join(" "));
      drawTicks(plot, ticks);
    };
    const place = event => {
      const frame = figure.querySelector(".picture").getBoundingClientRect();
      const scale = frame.width / 900;
      return [((event.clientX - frame.left) / scale - LEFT) / WIDE,
              ((event.clientY - frame.top) / scale - TOP) / HIGH];
    };
    plot.addEventListener("wheel", event => {
      const [x, y, w, h] = view(plot), turn = event.deltaY || event.deltaX;
      if (turn > 0 && w >= UNITS && h >= UNITS) return; // nothing to zoom out of: the page scrolls
      event.preventDefault();
      const factor = Math.exp(Math.max(-0.5, Math.min(0.5, turn * 0.002))), [a, b] = place(event);
      const wide = Math.min(UNITS, Math.max(SMALLEST, w * factor));
      const high = event.shiftKey ? h : Math.min(UNITS, Math.max(SMALLEST, h * factor));
      show(x + a * (w - wide), y + b * (h - high), wide, high);
    }, {passive: false});
    let from = null;
    plot.addEventListener("pointerdown", event => {
      from = [place(event), view(plot)];
      plot.setPointerCapture(event.pointerId);
      plot.classList.add("held");
    });
    plot.addEventListener("pointermove", event => {
      if (!from) return;
      const [[a, b], [x, y, w, h]] = from, [c, d] = place(event);
      show(x + (a - c) * w, y + (b - d) * h, w, h);
    });
    for (const end of ["pointerup", "pointercancel"])
      plot.addEventListener(end, () => { from = null; plot.classList.remove("held"); });
    plot.addEventListener("dblclick", () => show(...home.split(" ").map(Number)));
  }
  document.documentElement.dataset.pictures = figures.length;
})();
"""

"""Style and script of the report's page."""

from __future__ import annotations

STYLE = """
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


SCRIPT = r"""
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

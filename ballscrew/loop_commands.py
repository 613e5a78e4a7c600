"""``ballscrew run``, ``swap``, ``lyapunov`` and ``map``: what is done with a closed loop."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import api
from .console import (
    BAD_REQUEST,
    NOT_TRUSTED,
    TRUSTED,
    Count,
    Progress,
    Stages,
    complain,
    print_notes,
    print_result,
    side_by_side,
    text_of,
    warn,
)
from .loop_options import coupled, followed_loop, loops_of, system_of
from .options import exclude, given, open_workers
from .orchestration.fmu.limits import FIRST_STEP
from .results_folder import prepare_folder, save_result, save_results, write_or_refuse
from .solver.errors import UserError

if TYPE_CHECKING:
    from .stability.stability_map import MapSummary

RUN = r"""
Write report.html, trajectory.csv, metrics.json, parameters.toml and pictures.

examples:
  ballscrew run --controller iol --set controller.sigma0_hat=66966.331 --out out
  ballscrew run --controller mine.py:pi --out out
  ballscrew run --controller mine.fmu --map position=x --map voltage=u --out out
  ballscrew run --controller theirs.fmu --sampled 1e-3 --out out
  ballscrew run --controller iol --coupling monolithic --out reference
  ballscrew run --system loop.ssp --set plant.sigma0=6e4 --out out
  ballscrew run --controller pid --params out/identified/parameters.toml --out out/pid
"""
SWAP = r"""
Write report.html, comparison.csv, comparison.json, comparison.png, parameters.toml and a
trajectory of each controller.

examples:
  ballscrew swap --controllers iol mine.py:pi hand.fmu --out out/swap
  ballscrew swap --controllers pid theirs.fmu --sampled 1e-3 --out out/digital
  ballscrew swap --controllers iol_observed pid --sampled 1e-3 --noise --out out/real
"""
LYAPUNOV = r"""
Write report.html, lyapunov.json, lyapunov.csv (the running estimates), parameters.toml and a
picture of their convergence. When the budget is used up, the verdict comes from the motion alone,
which gets half as much time. Exit code 1: computed, but the verdict is undecided.

examples:
  ballscrew lyapunov --controller nctf --stop 300 --out out/nctf
  ballscrew lyapunov --controller iol --set controller.sigma1_hat=342.5 --stop 20 --out out/cycle
  ballscrew lyapunov --controller nctf --stop 20 --via fmu --out out/over_fmus
  ballscrew lyapunov --controller hand.fmu --map position=x --map voltage=u --via fmu --out out
"""
MAP = r"""
Write report.html, map.parquet (a row a cell: the two parameters, verdict, final_error,
lambda1_bits_per_s, oscillation_amplitude, reason of an undecided one; map.csv without pyarrow),
map.json and a picture. Finished chunks are written at once; an interrupted run continues with
--resume.

examples:
  ballscrew map --controller iol --x sigma0_hat=66965.89:66969.24:68 \
      --y sigma1_hat=339.56:367.56:561 --workers 2 --out out/gamma1
  ballscrew map --controller nctf --x design.sigma0=50000:85000:21 \
      --y design.sigma1=250:450:21 --exponents --out out/gamma2
  ballscrew map --controller pid --x plant.Fc=0.5:2:16 --y plant.Fs=2.1:3:16 --out out/fcfs
"""
OF_A_STEP, OF_A_MOTION = ("settling_time_2pct", "overshoot"), ("rms_error", "largest_error")


def run(options: argparse.Namespace) -> int:
    if options.system:
        loop: Any = system_of(options)
    else:
        (loop,) = loops_of(options, [options.controller], **coupled(options))
    prepare_folder(options.out, [options.params, options.reference])
    from .loop_results import units_of_figures

    with Progress(loop.stop) as progress:
        result = api.run(loop, progress=progress)
    save_result(options, result)
    figures = result.figures()
    rows = [*_rows(figures, units_of_figures(result.run)), ("written to", options.out)]
    text = "\n".join(f"{label:<22}{value}" for label, value in rows)
    print_result(options.json, figures, text)
    if not result.trusted:
        warn(f"{figures['verdict']}: {figures['verdict_reason']}")
        if figures["advice"]:
            warn(figures["advice"])
    print_notes(result.notes)
    return TRUSTED if result.trusted else NOT_TRUSTED


def swap(options: argparse.Namespace) -> int:
    loops = loops_of(options, options.controllers, options.noise, **coupled(options))
    prepare_folder(options.out, [options.params, options.reference])
    from .loop_results import units_of_figures

    with Progress(loops[0].stop) as progress:
        result = api.swap(loops, progress=lambda name, t: progress(t, name))
    save_result(options, result)
    rows = [r.figures() for r in result.results]
    files = "report.html, comparison.csv, comparison.json, comparison.png, parameters.toml"
    files = ", ".join([files, *result.trajectories])
    table = _comparison_table(rows, units_of_figures(result.results[0].run))
    print_result(options.json, rows, table, files, options.out)
    for r, figures in zip(result.results, rows, strict=True):
        print_notes(f"{r.loop.label}: {note}" for note in r.notes)
        if not r.trusted:
            warn(f"{r.loop.label}: {figures['verdict']}: {figures['verdict_reason']}")
    for label, why in result.failures:
        complain(f"{label} was left out: {why}")
    if result.failures:
        return BAD_REQUEST
    return TRUSTED if result.trusted else NOT_TRUSTED


def _rows(figures: dict[str, Any], units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """The figures of a run with their labels, in the units of `units_of_figures`."""
    labels = {
        "peak_voltage": "peak voltage" if units["peak_voltage"] == "V" else "peak command",
        "peak_voltage_time": "  at",
        "settling_time_2pct": "2 % settling time",
        "overshoot": "overshoot",
        "steady_state_error": "steady-state error",
        "iae": "integral of |error|",
        "rms_error": "rms error",
        "largest_error": "largest error",
        "coupling_residual_max": "coupling residual",
    }
    shown = list(labels) if "peak_voltage" in figures else ["coupling_residual_max"]
    # one pair is for a step, the other for a motion: only one of them applies
    other = OF_A_STEP if figures.get("rms_error") is not None else OF_A_MOTION
    for name in (n for n in shown if n not in other):
        value = figures.get(name)
        finite = value is not None and math.isfinite(value)
        yield labels[name], f"{value:.6g} {units[name]}".rstrip() if finite else "-"
    yield "coupling", f"{figures['coupling']} ({figures['coupling_reason']})"
    yield "communication steps", figures["macro_steps"]
    if tried := figures["steps_tried"]:
        step = next((h for h, word in tried if word == "trusted"), tried[-1][0])
        yield "step", f"{step:g} s ({figures['step_reason']})"
    yield "verdict", f"{figures['verdict']}: {figures['verdict_reason']}"
    if figures["stopped"]:
        yield "stopped", figures["stopped"]


def _comparison_table(rows: list[dict[str, Any]], units: Mapping[str, str]) -> str:
    """The figures of several runs on one plant, in the units of `units_of_figures`."""
    columns = {
        "controller": ("controller", "{}"),
        "peak_voltage": (f"peak [{units['peak_voltage']}]", "{:.2f}"),
        "settling_time_2pct": ("settling [s]", "{:.3f}"),
        "overshoot": (f"overshoot [{units['overshoot']}]", "{:.3g}"),
        "steady_state_error": (f"final error [{units['steady_state_error']}]", "{:.3g}"),
        "iae": (f"IAE [{units['iae']}]", "{:.5f}"),
        "rms_error": (f"rms error [{units['rms_error']}]", "{:.3g}"),
        "largest_error": (f"largest error [{units['largest_error']}]", "{:.3g}"),
        "sampling_period": ("sampled [s]", "{:g}"),
        "coupling": ("coupling", "{}"),
        "verdict": ("verdict", "{}"),
    }
    moving = any(row.get("rms_error") is not None for row in rows)
    for name in OF_A_STEP if moving else OF_A_MOTION:
        del columns[name]
    cells = [[title for title, _ in columns.values()]]
    for row in rows:
        values = ((row.get(key), form) for key, (_, form) in columns.items())
        cells.append(["-" if value is None else form.format(value) for value, form in values])
    return side_by_side(cells)


def lyapunov(options: argparse.Namespace) -> int:
    if options.via == "fmu":
        exclude(options, "via", "tolerance", "is for --via model; FMUs have solvers of their own")
        loop = followed_loop(options, options.step or str(FIRST_STEP))
    else:
        why = "is for --via fmu; without it no FMU is run, and one solver chooses its steps"
        exclude(options, "via", "step map", why)
        loop = followed_loop(options)
    api.checked(loop)
    prepare_folder(options.out, [options.params])
    how = given(options, "tolerance", "budget")
    with Stages() as stages:
        result = api.lyapunov(loop, progress=stages, **how)

    def save(folder: Path) -> None:
        loop.parameters().save(folder)
        result.save(folder, command=options.command)

    save_results(options.out, save)
    figures, exponents = result.figures(), result.tables()[0]
    files = "report.html, lyapunov.json, lyapunov.csv, parameters.toml, lyapunov.png"
    text = f"{result.headline()}\n{exponents.title}:\n{text_of(exponents)}"
    print_result(options.json, figures, text, files, options.out)
    if figures["time_s"] < loop.stop and figures["diverges_at_s"] is None:
        reached = f"t = {figures['time_s']:g} s, not {loop.stop:g} s"
        print_notes([f"the exponents are computed up to {reached}"])
    if not result.decided:
        warn(f"undecided; what would decide: {figures['would_decide']}")
    return TRUSTED if result.decided else NOT_TRUSTED


def stability_map(options: argparse.Namespace) -> int:
    loop = followed_loop(options)
    plan = api.plan_of(loop, options.x, options.y, options.exponents, options.tolerance)
    if options.setpoint is not None and "setpoint" in (plan.x.side, plan.y.side):
        raise UserError("--setpoint, and an axis of set-points: expected one of them")
    prepare_folder(options.out, [options.params])
    from .solver.files import table_path
    from .stability.stability_map import make_map
    from .study_results import StabilityMap

    workers = open_workers(options)

    def computed() -> tuple[MapSummary, list[str]]:
        with Count("cells", "chunks") as progress:
            summary = make_map(plan, options.out, workers, options.resume, progress)
        return summary, StabilityMap(summary, options.out).add_report(options.command)

    advice = "; finished work is kept, continue with --resume"
    summary, notes = write_or_refuse(computed, advice)
    print_notes([*summary.notes, *notes])
    figures = summary.figures()
    table = table_path(options.out, "map").name
    files = f"{table}, map.json, parameters.toml, map.png, report.html"
    print_result(options.json, figures, "\n".join(_map_lines(figures)), files, options.out)
    return TRUSTED


def _map_lines(figures: dict[str, Any]) -> Iterator[str]:
    from .stability.stability_map import AGAIN

    cells = figures["cells"]
    for verdict, number in sorted(figures["verdicts"].items(), key=lambda row: -row[1]):
        yield f"{number:>9} of {cells}  {verdict}"
        if verdict == "undecided":
            for reason, count in figures["undecided"].items():
                yield f"{'':>11}{count} of them: {reason}"
    yield (
        f"again at {AGAIN}: {figures['checked_tighter']} cells, "
        f"{figures['disagreed']} with another verdict; of {figures['checked_at_random']} away from "
        f"borders, {figures['disagreed_at_random']}"
    )
    if figures["undecided"]:
        yield figures["budget"]


COMMANDS = {
    "run": (run, RUN),
    "swap": (swap, SWAP),
    "lyapunov": (lyapunov, LYAPUNOV),
    "map": (stability_map, MAP),
}

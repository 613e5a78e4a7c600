"""``ballscrew tune`` and ``ballscrew study``: gains of one controller, and several compared."""

from __future__ import annotations

import argparse

from .console import NOT_TRUSTED, TRUSTED, Count, print_json, text_of, warn
from .loop_options import loops_of
from .options import given, open_workers
from .results_folder import prepare_folder, save_result
from .study_api import tune as tuned

TUNE = r"""
Write parameters.toml with the gains, for run, swap and export, tuning.json, report.html, and
pictures of motions and of the frequency response. Exit code 1: done, but a run failed or is not
converged, or the linearized loop is unstable.

examples:
  ballscrew tune --controller p_pi --out out/tuned
  ballscrew tune --controller p_pi --params axis.toml --limit 500 --out out/tuned
  ballscrew tune --controller pid --plant drive_lugre --set plant.m=40 --limit 500 --out out/tuned
  ballscrew run --controller p_pi --params out/tuned/parameters.toml --setpoint 0.02 --out out/run
"""
STUDY = r"""
Write report.html, study.json and runs.parquet (a row a run; runs.csv without pyarrow). Finished
tasks are kept; an interrupted study continues with --resume. Exit code 1: done, but runs failed, or
runs over FMUs differ.

examples:
  ballscrew study STUDY.toml --out out/study
  ballscrew study STUDY.toml --workers 2 --out out/study --resume
"""


def tune(options: argparse.Namespace) -> int:
    (loop,) = loops_of(options, [options.controller])
    prepare_folder(options.out, [options.params, options.reference])
    how = given(options, "reference", "stop", "limit", "budget", "seed")
    with Count("candidates") as progress:
        result = tuned(loop, progress=progress, **how)
    save_result(options, result)
    if options.json:
        print_json(result.to_dict())
    else:
        print(result.headline())
        gains, motions, *_ = result.tables()
        print(text_of(gains), text_of(motions), sep="\n")
        files = ["report.html", "tuning.json", *(f"{name}.png" for name in result.pictures())]
        with_gains = "parameters.toml with the gains for --params"
        print(f"{with_gains}, {', '.join(files)} in {options.out}")
    if not result.trusted:
        warn(f"not trusted: {', '.join(result.doubts())}")
    return TRUSTED if result.trusted else NOT_TRUSTED


def study(options: argparse.Namespace) -> int:
    from .orchestration.study.plan import read_plan
    from .orchestration.study.study import discard_parts, do_study
    from .study_results import SwapStudy

    plan = read_plan(options.study)
    prepare_folder(options.out, [options.study])
    workers = open_workers(options)
    with Count("tasks", "tasks") as progress:
        done = do_study(
            plan,
            options.out,
            workers,
            options.resume,
            lambda stage, count, total: progress(count, total, stage),
        )
    result = SwapStudy.of(done)
    save_result(options, result)
    discard_parts(options.out)
    if options.json:
        print_json(result.to_dict()["answers"])
    else:
        print(result.headline())
        answers, *_ = result.tables()
        print(text_of(answers), answers.says, sep="\n")
        print(f"report.html, study.json, runs in {options.out}")
    return TRUSTED if result.trusted else NOT_TRUSTED


COMMANDS = {"tune": (tune, TUNE), "study": (study, STUDY)}

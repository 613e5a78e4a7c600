"""``ballscrew study``: tune controllers in the same way, test them on unseen duties, compare."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import Bar, text_of
from .options import NOT_TRUSTED, TRUSTED, out_folder
from .results_folder import prepare_folder, save_results
from .supervision import tell, tell_kept
from .worker_options import add_worker_options, open_workers, read_worker_count

if TYPE_CHECKING:
    from .study_results import SwapStudy

_EXAMPLES = """examples:
  ballscrew study STUDY.toml --out out/study
  ballscrew study STUDY.toml --workers 2 --out out/study --resume
"""


def add_parser(commands: Any, parser_class: type[argparse.ArgumentParser]) -> None:
    """Add the sub-command to the sub-parsers of the command; its parser is a `parser_class`."""
    del parser_class
    parser = commands.add_parser(
        "study",
        help="tune several controllers in the same way, test them on other plants and duties, and "
        "compare them",
        description="Write report.html, study.json and runs.parquet (a row a run; runs.csv without "
        "pyarrow). Finished tasks are kept; an interrupted study continues with --resume. Exit "
        "code 1: done, but runs failed, or runs over FMUs differ.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("study", type=Path, metavar="STUDY.toml", help="study file, see docs/study.md")
    add("--out", required=True, type=out_folder, metavar="DIR", help="folder for the results")
    add_worker_options(parser)
    add("--resume", action="store_true", help="finish the study in this folder")
    add("--json", action="store_true", help="print the answers as JSON")
    parser.set_defaults(action=_study)


def _study(options: argparse.Namespace) -> int:
    count = read_worker_count(options)
    from .orchestration.study.plan import read_plan
    from .orchestration.study.study import discard_parts, do_study
    from .study_results import SwapStudy

    plan = read_plan(options.study)
    prepare_folder(options.out, [options.study])
    workers = open_workers(options, count)
    progress = _StudyProgress()
    result = SwapStudy.of(do_study(plan, options.out, workers, options.resume, progress))
    progress.finish()
    save_results(options.out, lambda folder: result.save(folder, command=options.command))
    discard_parts(options.out)
    if options.json:
        print(json.dumps(result.to_dict()["answers"]))
    else:
        _show(result, options.out)
    return TRUSTED if result.trusted else NOT_TRUSTED


def _show(result: SwapStudy, folder: Path) -> None:
    print(result.headline())
    answers, *_ = result.tables()
    print(text_of(answers), answers.says, sep="\n")
    print(f"report.html, study.json, runs in {folder}")


class _StudyProgress:
    """Progress of each stage."""

    def __init__(self) -> None:
        self.bar: Bar | None = None
        self.stage = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        tell(f"{stage}: {done} of {total} tasks")
        tell_kept("finished tasks are kept, continue with --resume")
        if self.bar is None or stage != self.stage:
            self.finish()
            self.stage = stage
            self.bar = Bar("{desc}: {bar} {n} of {total} tasks, {remaining} left", total)
        self.bar.show(done, stage)

    def finish(self) -> None:
        if self.bar is not None:
            self.bar.close()

"""Tables of costs, here and in other programs: ``python benchmarks [SUBJECT ...]``.

Each time is the median of up to seven rounds, in which all programs take turns, with half of the
range between the quartiles. "times ours", or the number in brackets, is its ratio to this program,
bold if the other is faster. At a load above one, before the start, only ratios mean something.
"""

import argparse
import importlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SUBJECTS = "masters exponents maps loading swap identification scale".split()


def tables_of(subject: str, rounds: int) -> None:
    """Measure and print the tables of a subject in this process, from an empty cache on."""
    with tempfile.TemporaryDirectory() as cache:
        # before the package is imported; one thread, as in the command and its workers
        os.environ |= {"BALLSCREW_CACHE": cache, "OPENBLAS_NUM_THREADS": "1"}
        sys.path.insert(0, str(HERE.parent / "tests" / "support"))
        report = importlib.import_module("report")
        print(f"{subject}: {report.machine()}\n", flush=True)
        for table in importlib.import_module(subject).TABLES:
            with tempfile.TemporaryDirectory() as folder:
                print(report.page(table, rounds, Path(folder)), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=", ".join(SUBJECTS))
    parser.add_argument("--rounds", type=int, default=7, help="at most; default 7")
    asked = parser.parse_args()
    if unknown := [name for name in asked.subjects if name not in SUBJECTS]:
        parser.error(f"no subject {unknown[0]!r}; expected {', '.join(SUBJECTS)}")
    if len(asked.subjects) == 1:
        tables_of(asked.subjects[0], asked.rounds)
        return
    for subject in asked.subjects or SUBJECTS:
        command = [sys.executable, str(HERE), subject, "--rounds", str(asked.rounds)]
        subprocess.run(command, check=True)


if __name__ == "__main__":
    main()

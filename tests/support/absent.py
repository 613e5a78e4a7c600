"""What a run did not test, for want of data or of a program, as one list at its end.

``def pytest_terminal_summary(terminalreporter): list_absent(terminalreporter)`` prints it.
"""

from collections import Counter


def list_absent(reporter):
    """Print the reasons of all skipped cases, each once with its number of cases."""
    skipped = reporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    if reasons:
        reporter.section("not tested, for want of data or of a program")
        for reason, cases in sorted(reasons.items()):
            reporter.line(f"{cases} case{'s' * (cases > 1)}: {reason}")

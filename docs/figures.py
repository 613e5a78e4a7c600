"""Numbers of the stored proofs for the blocks of cog in the pages.

``python -m cogapp -r docs/PAGE.md``, from the root, puts the numbers of now into a page.
"""

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "proofs"))
from runner import PROOFS, stored

__all__ = "number percent proofs row share stored tools within word".split()
WORDS = (
    "no one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen"
).split()


def number(value: float, form: str) -> str:
    """The number in a format of Python, with an exponent as short as it can be."""
    return re.sub(r"e\+?(-?)0*(\d)", r"e\1\2", format(value, form))


def percent(share: float, form: str) -> str:
    return f"{100 * share:{form}} %"


def word(count: float, none: str = "no") -> str:
    return WORDS[round(count)] if round(count) else none


def share(found: Mapping[str, Any]) -> str:
    """A share and its number of records."""
    return f"{100 * found['share']:.1f} % of {found['records']}" if found["records"] else "-"


def within(found: Mapping[str, Any], form: str, scale: float = 1.0) -> str:
    """A value and its interval."""
    value, low, high = (f"{scale * found[name]:{form}}" for name in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def row(*cells: object) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(str, cells))} |".replace("|  |", "| |")


def proofs(folder: str = "") -> str:
    """The table of the proofs; `folder` is where their files are, seen from the page."""
    lines = [row("claim", "command", "minutes, about", "result"), "|---|---|---|---|"]
    for name, (_, minutes) in PROOFS.items():
        found, command = stored(name), f"`python proofs/runner.py {name}`"
        result = f"[{found['says']}]({folder}{name}.json)"
        lines.append(row(found["claim"], command, minutes, result))
    return "\n".join(lines)


HOSTS = (  # as shown, as stored, which rows of the loop FMU and of law ports
    ("FMPy 0.3.32", "fmpy", {"kind": "CoSimulation"}, None),
    ("CasADi 3.8.2", "casadi", {"tolerance": 1e-8}, None),
    ("PathSim 0.27.1", "pathsim", {"kind": "CoSimulation"}, {"file": "law"}),
    ("CoFmuPy 1.0.0", "cofmupy", None, {"method": "jacobi"}),
    ("SysSimX 0.4.3", "syssimx", None, {"method": "jacobi"}),
    ("estim8 0.1.6", "estim8", {}, None),
    ("gemseo-fmu 3.1.1", "gemseo", {}, None),
    ("libcosimpy 0.0.6", "libcosim", {"file": "loop 2"}, {"file": "law"}),
    ("ecospy 0.7.2", "ecos", {"file": "loop 2"}, {"file": "law"}),
    ("sofirpy 1.0.2", "sofirpy", {"file": "loop 2"}, {"file": "law"}),
    ("jaxonomy 3.4.1", "jaxonomy", {"kind": "CoSimulation"}, None),
    ("fmuloader 0.1.2rc0", "fmuloader", {}, None),
    ("FMU container 2.0", "fmucontainer", None, {}),
)


def tools() -> str:
    """The table of the largest errors of iol in other tools."""
    lines = [row("tool", "loop FMU", "law ports"), "|---|---|---|"]
    for shown, tool, *ways in HOSTS:
        cells = ["-", "-"]
        for k, asked in enumerate(ways):
            if asked is not None:
                want = {**asked, "tool": tool, "controller": "iol"}
                rows = [r for r in stored("tools")["rows"] if want.items() <= r.items()]
                cells[k] = number(max(r["error"] for r in rows), ".1e")
        lines.append(row(shown, *cells))
    return "\n".join(lines)

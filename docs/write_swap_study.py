"""Write the tables and the picture of ``swap-study.md`` from a finished study.

ballscrew study docs/examples/swap_study.toml --out out/study
python docs/write_swap_study.py out/study
"""

import json
import shutil
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from figures import row

import ballscrew
from ballscrew.orchestration.loop.shown import shown_unit

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "swap-study.md"
PRACTICE = "+sampled+position_encoder+velocity_estimate+current_sensor"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = [*head]
    return "\n".join([row(*head), row(*["---"] * len(head)), *(row(*cells) for cells in rows)])


def answers(study: Mapping[str, Any]) -> str:
    """Who is best at each duty, and by how much."""
    rows = []
    for answer in study["answers"]:
        best, *others = answer["best"]
        cells = [answer["duty"], f"`{best}`", _rms(study, answer["duty"], best)]
        cells.append(", ".join(f"`{n}`" for n in others) or "-")
        rows.append(cells)
    return table(("duty", "best", "rms error (90 %)", "equal to it within 10 %"), rows)


def _rms(study: Mapping[str, Any], duty: str, name: str) -> str:
    found = study["intervals"][duty][name]["rms_error"]
    factor, unit = shown_unit(found["mean"], "m")
    mean, low, high = (f"{factor * found[k]:.3g}" for k in ("mean", "low", "high"))
    return f"{mean} {unit} ({low} to {high})"


def errors(study: Mapping[str, Any]) -> str:
    """Mean rms error of every controller at every duty, in um."""
    duties = study["intervals"]
    rows = (
        [f"`{name}`", *(f"{1e6 * d[name]['rms_error']['mean']:.3g}" for d in duties.values())]
        for name in study["tunings"]
    )
    return table(["controller", *duties], rows)


def size(study: Mapping[str, Any]) -> str:
    """How many tunings, plants and candidates."""
    tuning, plants = study["plan"]["tuning"], study["plan"]["plants"]
    return (
        f"All are tuned in the same way on two other motions: {tuning['seeds']} times, "
        f"with {tuning['budget']} candidates.\nMeans are geometric, over {plants} plants "
        f"and {tuning['seeds']} tunings; in brackets 90 % intervals over plants and noise."
    )


def checks(study: Mapping[str, Any]) -> str:
    """Result of the runs over FMUs."""
    found = study["over_fmus"]
    differ = [
        f"`{run['controller']}` at {run['duty']}, by {1e9 * run['apart']:.2g} nm, with a limit of "
        f"{1e9 * run['allowed']:.2g} nm"
        for run in found
        if not run["agrees"]
    ]
    which = f" ({'; '.join(differ)})" if differ else ""
    unsure = sum(run["coupling"] not in ("", "trusted") for run in found)
    return (
        f"{len(found)} runs were repeated over FMUs, and {len(differ) or 'none'} differed"
        f"{which}.\nFor {unsure} of these the master's "
        "verdict is not converged (1 %): its runs with shorter steps read other counts of the "
        "encoder, and the\ncurrent follows each count."
    )


def thesis_step() -> str:
    """The thesis' step of 8 cm with nominal friction, 20 % less and 20 % more."""
    nominal = {p.name: p.default for p in ballscrew.component("plant").all_parameters}
    rows = []
    for name in ("iol", "iol_observed", "nctf", "pid", "p_pi"):
        for where, behind in (("ideal", ""), ("1 kHz, instruments", PRACTICE)):
            cells = [f"`{name}`", where]
            for factor in (1.0, 0.8, 1.2):
                result = ballscrew.run(
                    name + behind, stop=5.0, step=1e-3, fmus=False,
                    plant_values={n: factor * nominal[n] for n in ("Fc", "Fs", "sigma2")},
                    controller_values={"sample_time": 1e-3} if behind else {},
                )  # fmt: skip
                cells.append(_outcome(result.run))
            rows.append(cells)
    return table("controller|sensors|nominal friction|20 % less|20 % more".split("|"), rows)


def _outcome(run: Any) -> str:
    """Time to 2 % and the error at the end, or that it was lost."""
    error = np.abs(0.08 - run.outputs["x"])
    if run.stopped or error[-1] > 0.08:
        return "**lost**"
    inside = np.flatnonzero(error > 0.02 * 0.08)[-1] + 1
    settled = f"{run.time[inside]:.3g} s" if inside < len(error) else "-"
    return f"{settled}; {1e6 * error[-1]:.2g} um"


def main(folder: Path) -> None:
    study = json.loads((folder / "study.json").read_text("utf-8"))
    weak = "".join(f"\n- {w}" for w in study["weaknesses"])
    made = {"verdict": f"**{study['verdict']}.**\n{weak}", "thesis step": thesis_step()}
    made |= {f.__name__: f(study) for f in (size, checks, answers, errors)}
    page = PAGE.read_text("utf-8")
    for name, text in made.items():
        before, begin, rest = page.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise SystemExit(f"{PAGE.name} has no <!-- {name} --> and <!-- end --> after it")
        page = f"{before}{begin}\n{text}\n\n{end}{after}"
    PAGE.write_text(page, "utf-8")
    shutil.copyfile(folder / "study.png", ROOT / "docs" / "images" / "swap_study.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
